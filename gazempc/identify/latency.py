"""Latency of a sensor's observations of a known motion."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from gazempc.identify.estimate import Interval
from gazempc.identify.record import IdentificationError
from gazempc.identify.servo_fit import Z_95, fit
from gazempc.results.log import Log
from gazempc.types import FloatArray

_FEWEST_OBSERVATIONS = 30
_SCAN_STEP_S = 0.01
_EARLIEST_S = -0.2
_WIDEST_S = 0.02


def estimate_latency(
    known_time_s: FloatArray,
    known: FloatArray,
    observed_time_s: FloatArray,
    observed: FloatArray,
    latency_max_s: float = 1.0,
) -> Interval:
    """Estimate the delay of observations of a known motion by least squares; invariant to constant offsets.

    The motion may be a person's true track, or the encoder angles of a camera that rotates in front of a fixed target:
    then `known` is the direction of the target from the encoders.

    Args:
        known_time_s: Times of the known motion, shape (M,), increasing, seconds.
        known: The motion, shape (M, k), any unit; rows with NaN are removed.
        observed_time_s: Time stamps of the observations on the same clock, shape (F,), seconds. Arrival times yield the
            total latency, capture times the error of the stamps.
        observed: Observations, shape (F, k), the same unit.
        latency_max_s: Upper bound of the latency, seconds.

    Returns:
        Delay from the motion to the time stamp of its observation, seconds.

    Raises:
        IdentificationError: If the data are insufficient.
    """
    known_time_s, known = _finite(known_time_s, known)
    observed_time_s, observed = _finite(observed_time_s, observed)
    if known_time_s.size < _FEWEST_OBSERVATIONS or observed_time_s.size < _FEWEST_OBSERVATIONS:
        counts = f"{observed_time_s.size} observations of a motion known at {known_time_s.size} times"
        raise _refused(f"{counts}; at least {_FEWEST_OBSERVATIONS} of both are needed: record longer")
    motion = CubicSpline(known_time_s, known)

    def usable(earliest_s: float, latest_s: float) -> NDArray[np.bool_]:
        # The same observations for all compared latencies: those with a known motion at each of them.
        first, last = known_time_s[0] + latest_s, known_time_s[-1] + earliest_s
        return np.asarray((observed_time_s >= first) & (observed_time_s <= last))

    def residual(latency_s: float, used: NDArray[np.bool_]) -> FloatArray:
        difference = observed[used] - motion(observed_time_s[used] - latency_s)
        return np.asarray(difference - difference.mean(axis=0))

    # Coarse scan with separate observations for each latency: a short record has few that are valid for all.
    lags_s = np.arange(_EARLIEST_S, latency_max_s + 1e-9, _SCAN_STEP_S)
    candidates = [(lag_s, used) for lag_s in lags_s if (used := usable(lag_s, lag_s)).sum() >= _FEWEST_OBSERVATIONS]
    scores = {float(lag_s): float(np.mean(residual(lag_s, used) ** 2)) for lag_s, used in candidates}
    near_s = min(scores, key=scores.__getitem__, default=0.0)
    low_s, high_s = near_s - 3 * _SCAN_STEP_S, near_s + 3 * _SCAN_STEP_S
    used = usable(low_s, high_s)
    if used.sum() < _FEWEST_OBSERVATIONS:
        count = f"{used.sum()} observations while the motion is known"
        raise _refused(f"{count}; at least {_FEWEST_OBSERVATIONS} are needed: record longer")
    channels = observed.shape[1]
    best = fit(lambda values: residual(values[0], used).ravel(), [[near_s]], [low_s], [high_s], channels)
    latency_s = float(best.values[0])
    # Numerical precision of the model.
    half_s = max(Z_95 * math.sqrt(float(best.covariance[0, 0])), 1e-4)
    if min(latency_s - low_s, high_s - latency_s) < 1e-6 or near_s in (lags_s[0], lags_s[-1]):
        between = f"none between {_EARLIEST_S:g} and {latency_max_s:g} s"
        raise _refused(f"{between} aligns the observations with the motion: check that both are on one clock")
    if not half_s <= _WIDEST_S:
        widths = f"uncertain by +-{1e3 * half_s:.0f} ms; +-{1e3 * _WIDEST_S:.0f} ms are needed"
        raise _refused(f"{widths}: record more, and faster, motion")
    return Interval.around(latency_s, half_s)


def _refused(why: str) -> IdentificationError:
    return IdentificationError(f"sensor latency: {why}")


def log_latency(log: Log) -> tuple[Interval, Interval]:
    """Latency of a log's observations of the head, relative to its true motion.

    Args:
        log: A run.

    Returns:
        Delay from the true motion to the arrival, and to the stated capture time, which should be 0.

    Raises:
        IdentificationError: If the data are insufficient, or the log has no true motion.
    """
    arrived = estimate_latency(log.time_s, log.head_true_base_m, log.arrival_time_s, log.head_observed_base_m)
    captured = estimate_latency(log.time_s, log.head_true_base_m, log.capture_time_s, log.head_observed_base_m)
    return arrived, captured


def _finite(time_s: FloatArray, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    value = np.asarray(value, dtype=np.float64).reshape(len(time_s), -1)
    keep = np.isfinite(time_s) & np.isfinite(value).all(axis=1)
    return np.asarray(time_s, dtype=np.float64)[keep], value[keep]
