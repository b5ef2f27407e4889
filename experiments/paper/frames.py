"""Errors of the paper's two forecasts at every frame of a video, as functions of the weight w."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from experiments.engine.job import Row, key_of, recording_hash
from experiments.paper.published import FRAME_RATE_HZ, HORIZON_S, PUBLISHED, RANGE_M
from gazempc.errors import LeftOutError
from gazempc.recordings.recording import Recording, TrueHead
from gazempc.sim.scene import make_scene
from gazempc.sim.sensor import SensorSpec, load_sensor, observe
from gazempc.types import FloatArray
from predictors import ConstantVelocity, HeadObservation, HeadPose

Rule = Literal["paper", "offset removed", "travel direction", "both", "waist itself"]
Against = Literal["filtered", "true"]

RULES: dict[Rule, dict[str, Any]] = {
    "paper": {},
    "offset removed": {"offset_removed": True},
    "travel direction": {"yaw_from": "travel"},
    "both": {"yaw_from": "travel", "offset_removed": True},
    # Control: tests whether any direction without the swing of the filter's velocity, not the head's, has the effect.
    "waist itself": {"yaw_from": "travel"},
}
# Horizon at 30 Hz, and at the half rate of a slower tracker.
HORIZONS_S = (HORIZON_S, 2.0 * HORIZON_S)
POSITION_NOISE_M = 0.01
# Longest gap between frames over which the filtered position is interpolated.
_GAP_S = 0.1
GROUPS = {p.label: p.group for p in PUBLISHED}


def filter_time_s(acceleration_psd: float, position_noise_m: float = POSITION_NOISE_M) -> float:
    """Time constant of a constant-velocity Kalman filter at 30 Hz.

    In the limit of many frames the filter is a second-order system with damping ratio 0.71 (Kalata 1984); this is the
    inverse of its natural frequency.

    Args:
        acceleration_psd: Power spectral density of the acceleration, m^2/s^3.
        position_noise_m: Standard deviation of a measurement.

    Returns:
        Seconds.
    """
    return float((position_noise_m**2 / FRAME_RATE_HZ / acceleration_psd) ** 0.25)


def acceleration_psd(time_s: float, position_noise_m: float = POSITION_NOISE_M) -> float:
    """Inverse of `filter_time_s`: power spectral density of the acceleration, m^2/s^3."""
    return position_noise_m**2 / FRAME_RATE_HZ / time_s**4


@dataclass(frozen=True)
class FrameJob:
    """Inputs of the errors on one recording.

    Attributes:
        recording: Synthetic name or path.
        filter_time_s: Time constant of the position filter, see `filter_time_s`.
        rules: Definitions of the relative yaw.
        seed: Seed of the sensor's noise, for a recording without a measured track.
    """

    recording: str
    filter_time_s: float
    rules: tuple[Rule, ...]
    seed: int

    def key(self) -> str:
        """See `experiments.engine.job.Job`."""
        return key_of(self, recording=recording_hash(self.recording))

    def run(self) -> Row:
        """Labels and, for each horizon, the errors relative to the filtered and to the true position."""
        recording, sensor = _observed(self.recording, tuple(recording_hash(self.recording)))
        labels = {"kind": recording.kind, "subject": recording.labels.subject, "group": recording.labels.group}
        try:
            return labels | _errors(recording, sensor, self)
        except LeftOutError as error:
            return labels | {"left_out": str(error)}


@dataclass(frozen=True)
class Frames:
    """Errors at the scored frames of one video, at one horizon.

    The forecast is linear in w (equations 4 and 5): its error is ``base_m + w turn_m``.

    Attributes:
        recording: Name.
        subject: Name of the person.
        group: R12, R34 or R56.
        base_m: Error of the baseline, forecast minus reference position, shape (F, 3), metres.
        turn_m: Change of the error for w = 1, shape (F, 3), metres.
        yaw_deg: Relative yaw of the rule, shape (F,), positive to the left; NaN without a recent orientation.
    """

    recording: str
    subject: str
    group: str
    base_m: FloatArray
    turn_m: FloatArray
    yaw_deg: FloatArray

    def error_mm(self, weight: float) -> FloatArray:
        """Euclidean error at each frame, shape (F,), mm.

        Args:
            weight: w; 0 is the baseline.
        """
        return np.asarray(1e3 * np.linalg.norm(self.base_m + weight * self.turn_m, axis=1))


def labelled(source: str, result: Row) -> Row:
    """A row for `frames_of`.

    Args:
        source: The recording as given by the user.
        result: Result of its job.

    Returns:
        Labels and result; unknown labels are None.
    """
    known = {"recording": Path(source).stem, "source": source, "kind": None}
    return known | {"subject": None, "group": None} | result


def frames_of(
    rows: Sequence[dict[str, Any]], against: Against = "filtered", rule: Rule = "paper", horizon_s: float = HORIZON_S
) -> list[Frames]:
    """Errors by one definition.

    Args:
        rows: Rows of `labelled`.
        against: Reference of the errors: the paper's filtered position, or the true one.
        rule: Definition of the relative yaw.
        horizon_s: One of `HORIZONS_S`.

    Returns:
        One entry per video, without those that failed, were left out, or have no known group or no scored frame.
    """
    found = []
    for row in rows:
        if row["failed"] or row["left_out"] or row["group"] not in GROUPS:
            continue
        errors = row["horizons"][HORIZONS_S.index(horizon_s)]
        base_m = np.array(errors[against])
        if not base_m.size:
            continue
        turn = errors["turn"][rule]
        yaw_deg = np.array([np.nan if y is None else y for y in turn["yaw_deg"]], dtype=np.float64)
        group = GROUPS[row["group"]]
        found.append(Frames(row["recording"], row["subject"], group, base_m, np.array(turn["turn_m"]), yaw_deg))
    return found


@lru_cache(maxsize=2)
def _observed(name: str, _: tuple[str, ...]) -> tuple[Recording, SensorSpec]:
    """The recording in the sensor's frame, and the sensor: a recorded tracker if there is one."""
    walk = make_scene(name).walk
    # Synthetic walks have both a true and a measured track.
    sensor = load_sensor("recorded" if walk.measured is not None else "reference")
    return walk, sensor.model_copy(update={"range_min_m": RANGE_M[0], "range_max_m": RANGE_M[1]})


def _errors(recording: Recording, sensor: SensorSpec, job: FrameJob) -> dict[str, Any]:
    psd = acceleration_psd(job.filter_time_s)
    baseline = ConstantVelocity(psd, POSITION_NOISE_M, gated=False)
    bent = {
        rule: HeadPose(1.0, psd, POSITION_NOISE_M, gated=False, **changes)
        for rule, changes in RULES.items()
        if rule in job.rules
    }
    horizons_s = np.array(HORIZONS_S)
    capture_s, filtered_m, forecast_m = [], [], []
    turned_m: dict[Rule, list[FloatArray]] = {rule: [] for rule in bent}
    yaw_deg: dict[Rule, list[float | None]] = {rule: [] for rule in bent}
    for sighting in observe(recording, sensor, job.seed):
        observation: HeadObservation = sighting.observation
        ahead_s = observation.capture_time_s + horizons_s
        baseline.update(observation)
        capture_s.append(observation.capture_time_s)
        filtered_m.append(baseline.state()[1][:3])
        forecast_m.append(baseline.forecast(ahead_s).means_base_m)
        for rule, predictor in bent.items():
            waist = replace(observation, head_quat_wxyz=observation.pelvis_quat_wxyz)
            predictor.update(waist if rule == "waist itself" else observation)
            turned_m[rule].append(predictor.forecast(ahead_s).means_base_m)
            yaw_rad = predictor.relative_yaw_rad()
            yaw_deg[rule].append(None if yaw_rad is None else round(float(np.degrees(yaw_rad)), 4))
    times_s, positions_m, forecasts_m = np.array(capture_s), np.array(filtered_m), np.array(forecast_m)
    true_head, errors = TrueHead(recording), []
    for i, horizon_s in enumerate(HORIZONS_S):
        at_s = times_s + horizon_s
        scored = _has_frame(times_s, at_s)
        then_m = np.stack([np.interp(at_s, times_s, positions_m[:, axis]) for axis in range(3)], axis=-1)
        errors.append(
            {
                "filtered": _plain((forecasts_m[:, i] - then_m)[scored]),
                "true": _plain(forecasts_m[scored, i] - true_head(at_s[scored])),
                "turn": {
                    rule: {
                        "turn_m": _plain((np.array(turned_m[rule])[:, i] - forecasts_m[:, i])[scored]),
                        "yaw_deg": [y for y, ok in zip(yaw_deg[rule], scored, strict=True) if ok],
                    }
                    for rule in bent
                },
            }
        )
    return {"horizons": errors, **_walk(true_head, times_s)}


def _plain(values_m: FloatArray) -> list[list[float]]:
    """Nested lists, rounded to a tenth of a micrometre for smaller files."""
    rounded: list[list[float]] = np.round(values_m, 7).tolist()
    return rounded


def _walk(true_head: TrueHead, times_s: FloatArray) -> dict[str, Any]:
    """Horizontal speed and turn of the true path, from one half second to the next."""
    middle_s = times_s[(times_s >= times_s[0] + HORIZON_S) & (times_s <= times_s[-1] - HORIZON_S)]
    if not middle_s.size:
        return {"speed_m_s": [], "turn_deg": []}
    steps_m = np.diff(np.stack([true_head(middle_s + d)[:, :2] for d in (-HORIZON_S, 0.0, HORIZON_S)]), axis=0)
    along = steps_m[..., 0] + 1j * steps_m[..., 1]
    return {
        "speed_m_s": np.round(np.abs(along[1]) / HORIZON_S, 4).tolist(),
        "turn_deg": np.round(np.degrees(np.angle(along[1] * np.conj(along[0]))), 3).tolist(),
    }


def _has_frame(times_s: FloatArray, at_s: FloatArray) -> NDArray[np.bool_]:
    """Mask, shape (F,), of the times with an observation, or with one closely before and one closely after."""
    after = np.clip(np.searchsorted(times_s, at_s - 1e-6), 1, times_s.size - 1)
    gap_s = times_s[after] - times_s[after - 1]
    at_frame = np.abs(times_s[after] - at_s) <= 1e-6
    return np.asarray((at_s <= times_s[-1] + 1e-6) & (at_frame | (gap_s <= _GAP_S + 1e-6)))
