"""Frame selection, arrival times, stamps, and random processes of a sensor's errors."""

from __future__ import annotations

from itertools import accumulate

import numpy as np

from gazempc.sim.sensing.tables import Bouts, Timing
from gazempc.types import BoolArray, FloatArray, IntArray


def wander(times_s: FloatArray, time_s: float, axes: int, rng: np.random.Generator) -> FloatArray:
    """Ornstein-Uhlenbeck process of unit variance, stationary from the first frame, exact for any spacing.

    Args:
        times_s: Times of the frames, shape (N,), seconds, increasing.
        time_s: Correlation time: the autocorrelation is exp(-lag / time_s).
        axes: Number A of independent processes.
        rng: Random generator.

    Returns:
        Shape (N, A).
    """
    values = rng.standard_normal((times_s.size, axes))
    keeps = np.exp(-np.diff(times_s) / time_s)
    kicks = values[1:] * np.sqrt(1.0 - keeps**2)[:, None]
    # Python floats: operations on small arrays take ten times as long.
    kept = keeps.tolist()
    for a, start in enumerate(values[0].tolist()):
        steps = zip(kept, kicks[:, a].tolist(), strict=True)
        values[:, a] = list(accumulate(steps, lambda value, step: step[0] * value + step[1], initial=start))
    return values


def bouts(times_s: FloatArray, spec: Bouts, rng: np.random.Generator) -> IntArray:
    """Assign frames to the bouts of an error.

    Args:
        times_s: Times of the frames, shape (N,), seconds, increasing.
        spec: Intervals and durations.
        rng: Random generator.

    Returns:
        Index of the bout at each frame, from 0, shape (N,); -1 outside of bouts.
    """
    number = np.full(times_s.size, -1, dtype=np.intp)
    if spec.mean_interval_s == np.inf:
        return number
    count, end_s = 0, float(times_s[0])
    while True:
        start_s = end_s + rng.exponential(spec.mean_interval_s)
        first = int(np.searchsorted(times_s, start_s))
        if first == times_s.size:
            return number
        end_s = start_s + rng.uniform(spec.duration_min_s, spec.duration_max_s)
        # A bout between two frames affects the next one: a spike has zero duration.
        after = max(int(np.searchsorted(times_s, end_s)), first + 1)
        number[first:after] = count
        count += 1


def held_uniform(times_s: FloatArray, hold_s: float, rng: np.random.Generator) -> FloatArray:
    """Piecewise-constant uniform process on 0 to 1, with exponential holding times.

    Args:
        times_s: Times of the frames, shape (N,), seconds, increasing.
        hold_s: Mean holding time; 0 for an independent value each frame.
        rng: Random generator.

    Returns:
        Shape (N,).
    """
    drawn = rng.random(times_s.size)
    stays = np.exp(-np.diff(times_s) / hold_s) if hold_s > 0 else np.zeros(times_s.size - 1)
    new: BoolArray = np.concatenate([[True], rng.random(times_s.size - 1) >= stays])
    held: FloatArray = drawn[np.maximum.accumulate(np.where(new, np.arange(times_s.size), 0))]
    return held


def frames_taken(times_s: FloatArray, rate_hz: float, jitter_s: float, rng: np.random.Generator) -> IntArray:
    """Select the frames of a recording that a sensor captures.

    All frames of a recording at (nearly) the sensor's rate or below; a faster one is decimated to the frames nearest to
    the sensor's ticks. With jitter it is always resampled, each frame at most once.

    Args:
        times_s: Times of the recording's frames, shape (N,), seconds.
        rate_hz: Maximum rate of the sensor.
        jitter_s: Maximum of the uniform delay relative to the nominal rate.
        rng: Random generator.

    Returns:
        Indices of the frames, increasing.
    """
    if jitter_s > 0:
        most = int((times_s[-1] - times_s[0]) * rate_hz) + 2
        waits = 1.0 / rate_hz + jitter_s * rng.random(most)
        ticks = times_s[0] + np.concatenate([[0.0], np.cumsum(waits)])
        ticks = ticks[ticks <= times_s[-1] + 1e-9]
    elif float(np.median(np.diff(times_s))) * rate_hz > 0.9:
        return np.arange(times_s.size)
    else:
        ticks = np.arange(times_s[0], times_s[-1] + 1e-9, 1.0 / rate_hz)
    after = np.clip(np.searchsorted(times_s, ticks), 1, times_s.size - 1)
    nearer_before = ticks - times_s[after - 1] < times_s[after] - ticks
    return np.unique(after - nearer_before)


def arrivals(times_s: FloatArray, latency_s: float, timing: Timing, rng: np.random.Generator) -> FloatArray:
    """Arrival times of frames, before in-order delivery.

    Args:
        times_s: True capture times, shape (N,), seconds.
        latency_s: Minimum latency.
        timing: Jitter of the latency.
        rng: Random generator.

    Returns:
        Shape (N,), seconds.
    """
    return np.asarray(times_s + (latency_s + timing.latency_jitter_s * rng.random(times_s.size)))


def stamps(times_s: FloatArray, timing: Timing, rng: np.random.Generator) -> FloatArray:
    """Stamped capture times.

    Args:
        times_s: True capture times, shape (N,), seconds.
        timing: Error of the stamps.
        rng: Random generator.

    Returns:
        Shape (N,), seconds.
    """
    return times_s + (timing.stamp_offset_s + timing.stamp_noise_s * rng.standard_normal(times_s.size))
