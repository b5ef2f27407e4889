"""Random tracker models for the fit of the predictor, with errors of the size of real ones."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from experiments.fit.variants import GaplessWalk, log_uniform
from gazempc.recordings.recording import Labels, Recording, Track
from gazempc.sim.sensing.observe import wander
from gazempc.sim.sensor import SensorSpec, observe
from gazempc.types import FloatArray
from predictors import HeadObservation

# White noise from zero to twice the reference sensor's; proportional yaw noise, 2 deg for 10 mm.
_WHITE_M = (0.0, 0.0, 0.0025, 0.005, 0.01, 0.01, 0.01, 0.01, 0.015, 0.02)
_YAW_DEG_PER_M, _YAW_FACTORS = 200.0, (0.5, 1.0, 1.0, 1.0, 1.5)
# Probability of each kind, for unmodified walks and for others.
_KINDS = ("precise", "white", "wander", "camera", "jumps", "street")
_PLAIN_SHARES, _OTHER_SHARES = (0.14, 0.40, 0.21, 0.21, 0.04, 0.0), (0.14, 0.26, 0.13, 0.17, 0.0, 0.30)
# Precise trackers, such as motion capture: white noise of position and yaws; both orientations are measured.
_PRECISE_M, _PRECISE_YAW_DEG = (0.0, 0.0, 0.0005, 0.001, 0.002, 0.003), (0.0, 0.0, 0.5, 1.0, 2.0)
# Measured orientations (head, pelvis), with probabilities.
_ORIENTATIONS, _ORIENTATION_SHARES = (
    ((True, True), (False, False), (True, False), (False, True)),
    (0.64, 0.22, 0.07, 0.07),
)
# Tracks in streets: wander, white noise; smoothing of a wander that is added to the true path.
_WANDER_M, _WANDER_TIME_S, _STREET_WHITE_M, _WOBBLE_SD_S = (0.005, 0.04), (0.08, 0.5), (0.0005, 0.005), 0.05
# Body trackers: white noise, wander with its correlation time; yaws of head and pelvis. Centred on `body_tracker`.
_BODY_WHITE_M, _BODY_WANDER_M, _BODY_TIME_S = (0.002, 0.012), (0.008, 0.035), (0.2, 1.0)
_BODY_YAW_DEG, _BODY_YAW_WANDER_DEG, _BODY_YAW_TIME_S = (1.0, 3.0), ((2.0, 11.0), (2.0, 8.0)), (0.4, 1.5)
# Cameras: relative range error, bearing error; centred on those in bags of a real camera.
_RANGE_NOISE, _RANGE_WANDER, _RANGE_TIME_S = (0.005, 0.2), (0.01, 0.2), (0.5, 4.0)
_BEARING_DEG, _CAMERA_YAW_DEG = (0.04, 0.3), (2.0, 6.0)
# Persistent jumps, in the kinds `jumps`, `wander` and `street`; outliers of single frames, in trackers without jumps.
_JUMPS = {"duration_min_s": 0.1, "duration_max_s": 0.5, "size_min_m": 0.02}
_SPIKES = {"size_min_m": 0.1, "size_max_m": 0.5}
_JUMP_INTERVAL_S, _JUMP_SIZE_M, _SPIKE_INTERVAL_S = (1.0, 5.0), (0.04, 0.2), (0.3, 2.0)
# Probabilities of faults: a compromise between sufficient examples and accuracy without faults.
_WITH_JUMPS, _WITH_SPIKES, _WITH_FAULT = 0.3, 0.06, 0.1
_BODY_STATES, _CAMERA_STATES, _CAMERA_SEES_YAW = 0.2, 0.5, 0.7
_STREET_HZ, _SLOW_HZ, _FAST_HZ = (2.5, 5.0, 10.0, 16.0, 25.0, 30.0, 50.0), (2.5, 5.0, 7.5, 10.0, 15.0), (50.0, 60.0)
_DROPOUT, _LOSS_S, _JITTER_PERIODS = (0.05, 0.5), (0.2, 1.0), (0.1, 0.5)
_SLOW_SHARE, _FAST_SHARE = 0.15, 0.1
# Error of the first frames: s.d. on a horizontal axis (vertical: half of it), up to jumps of 10 cm, as at the start
# of tracks of waiting pedestrians; its duration; length of the examples.
_ONSET_M, _ONSET_S, _ONSET_LASTS_S = (0.02, 0.15), (0.03, 0.25), 1.0
_HEIGHT_M = 1.2
_NEAREST_M, _FARTHEST_M = 0.8, 5.0
# Upsampling rate of walks for higher frame rates, and for frames with jitter.
_FINE_HZ = 120.0
USUAL_HZ = 30.0


def draw_tracker(rng: np.random.Generator, plain: bool) -> tuple[str, SensorSpec]:
    """Draw a random tracker.

    Args:
        rng: Random generator.
        plain: Whether the walk is unmodified.

    Returns:
        Its kind (`precise`, `white`, `wander`, `camera`, `jumps` or `street`), and its model.
    """
    fields: dict[str, Any] = {"rate_hz": USUAL_HZ}
    kind = str(rng.choice(_KINDS, p=_PLAIN_SHARES if plain else _OTHER_SHARES))
    if kind == "precise":
        fields["rate_hz"] = _draw_rate_hz(rng)
        fields |= {"position_noise_m": rng.choice(_PRECISE_M), "yaw_noise_deg": rng.choice(_PRECISE_YAW_DEG)}
        return kind, _make_sensor(kind, fields, rng)
    head, pelvis = _ORIENTATIONS[rng.choice(4, p=_ORIENTATION_SHARES)]
    yaws: list[dict[str, Any]] = [{}, {}]
    if kind in {"white", "jumps"}:
        fields["position_noise_m"] = white_m = float(rng.choice(_WHITE_M))
        fields["yaw_noise_deg"] = white_m * _YAW_DEG_PER_M * float(rng.choice(_YAW_FACTORS))
    if kind == "jumps" or (kind in {"wander", "street"} and rng.random() < _WITH_JUMPS):
        fields["jumps"] = {
            **_JUMPS,
            "mean_interval_s": rng.uniform(*_JUMP_INTERVAL_S),
            "size_max_m": rng.uniform(*_JUMP_SIZE_M),
            "level": kind == "street",
        }
    if kind == "wander":
        fields["position_noise_m"] = rng.uniform(*_BODY_WHITE_M)
        fields["position_wander_m"] = rng.uniform(*_BODY_WANDER_M)
        fields["position_wander_time_s"] = log_uniform(rng, *_BODY_TIME_S)
        fields["yaw_noise_deg"] = rng.uniform(*_BODY_YAW_DEG)
        fields["states_covariance"] = bool(rng.random() < _BODY_STATES)
        yaws = [
            {"wander_deg": rng.uniform(*wander_deg), "wander_time_s": rng.uniform(*_BODY_YAW_TIME_S)}
            for wander_deg in _BODY_YAW_WANDER_DEG
        ]
    if kind == "camera":
        fields["along"] = {
            "noise_share": log_uniform(rng, *_RANGE_NOISE),
            "wander_share": log_uniform(rng, *_RANGE_WANDER),
            "wander_time_s": rng.uniform(*_RANGE_TIME_S),
        }
        fields["across"] = {"noise_deg": rng.uniform(*_BEARING_DEG)}
        fields["yaw_noise_deg"] = rng.uniform(*_CAMERA_YAW_DEG)
        fields["states_covariance"] = bool(rng.random() < _CAMERA_STATES)
        head, pelvis = bool(rng.random() < _CAMERA_SEES_YAW), False
    if kind == "street":
        head = pelvis = False
        fields["rate_hz"] = float(rng.choice(_STREET_HZ))
    else:
        fields["rate_hz"] = _draw_rate_hz(rng)
    fields["head_yaw"], fields["pelvis_yaw"] = ({"reported": r, **y} for r, y in zip((head, pelvis), yaws, strict=True))
    return kind, _make_sensor(kind, fields, rng)


def _make_sensor(kind: str, fields: dict[str, Any], rng: np.random.Generator) -> SensorSpec:
    return SensorSpec(name=kind, source="drawn at random", latency_s=0.0, **fields, **_faults(rng, kind, fields))


def wobble(walk: GaplessWalk, rng: np.random.Generator) -> GaplessWalk:
    """Add a random low-frequency displacement beyond gait, as in a crowd or in the tracks of a data set."""
    slow = rng.uniform(*_WANDER_M) * wander(walk.times_s, log_uniform(rng, *_WANDER_TIME_S), 3, rng)
    slow[:, 2] = 0.0
    step_s = float(np.median(np.diff(walk.times_s)))
    return replace(walk, head_m=walk.head_m + gaussian_filter1d(slow, _WOBBLE_SD_S / step_s, axis=0))


def _street_error_m(times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """White noise and wander of a planar tracker, shape (N, 3), metres."""
    slow = rng.uniform(*_WANDER_M) * wander(times_s, log_uniform(rng, *_WANDER_TIME_S), 3, rng)
    error = slow + rng.uniform(*_STREET_WHITE_M) * rng.standard_normal((times_s.size, 3))
    error[:, 2] = 0.0
    return np.asarray(error)


def beside(walk: GaplessWalk, rng: np.random.Generator) -> GaplessWalk:
    """The walk in the frame of a robot at a random position beside it, 1.2 m high."""
    away_rad, away_m = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(_NEAREST_M, _FARTHEST_M)
    direction = np.array([np.cos(away_rad), np.sin(away_rad)])
    # Beyond the walk's extent in that direction, so that it does not pass through the robot.
    at = walk.head_m[:, :2].mean(axis=0)
    at = at + direction * (away_m + float(np.max((walk.head_m[:, :2] - at) @ direction)))
    return replace(walk, head_m=walk.head_m - [*at, _HEIGHT_M])


def seen_through(walk: GaplessWalk, kind: str, sensor: SensorSpec, rng: np.random.Generator) -> list[HeadObservation]:
    """Observations of a walk by a tracker.

    Args:
        walk: The walk, in the tracker's frame.
        kind: Kind of the tracker.
        sensor: Model of the tracker.
        rng: Random generator of its errors.

    Returns:
        The observations, in order of capture.
    """
    frames = USUAL_HZ / sensor.rate_hz
    if sensor.timing.frame_jitter_s > 0 or frames < 1.0 or abs(frames - round(frames)) > 1e-9:
        walk = _finer(walk)
    positions = walk.head_m + _street_error_m(walk.times_s, rng) if kind == "street" else walk.head_m
    head, pelvis = (_quats(yaw) for yaw in (walk.head_yaw_rad, walk.pelvis_yaw_rad))
    n = walk.times_s.size
    track = Track(positions, head, np.full((n, 3), np.nan), pelvis)
    recording = Recording("walk", "fit", "motion capture", walk.times_s, track, None, True, Labels("walk"))
    return [s.observation for s in observe(recording, sensor, int(rng.integers(2**31)))]


def with_onset_error(observations: list[HeadObservation], rng: np.random.Generator) -> list[HeadObservation]:
    """The first second of a track with an error of its first frames, which ends with a jump or decays linearly.

    Standard deviation and duration are log-uniform: 2 to 15 cm and 0.03 to 0.25 s.

    Args:
        observations: Observations of the track, in order of capture time.
        rng: Random generator.

    Returns:
        The observations less than one second newer than the first, with erroneous positions.
    """
    error_m = log_uniform(rng, *_ONSET_M) * rng.standard_normal(3) * [1.0, 1.0, 0.5]
    lasts_s, decays = log_uniform(rng, *_ONSET_S), rng.random() < 0.5
    found = []
    for each in observations:
        age_s = each.capture_time_s - observations[0].capture_time_s
        share = max(0.0, 1.0 - age_s / lasts_s) if decays else float(age_s < lasts_s)
        if age_s < _ONSET_LASTS_S:
            found.append(replace(each, head_position_base_m=each.head_position_base_m + share * error_m))
    return found


def _finer(walk: GaplessWalk) -> GaplessWalk:
    t = np.arange(walk.times_s[0], walk.times_s[-1] + 1e-9, 1.0 / _FINE_HZ)
    yaws = (np.interp(t, walk.times_s, yaw) for yaw in (walk.pelvis_yaw_rad, walk.head_yaw_rad))
    return GaplessWalk(t, CubicSpline(walk.times_s, walk.head_m)(t), *yaws)


def _draw_rate_hz(rng: np.random.Generator) -> float:
    draw = rng.random()
    if draw < _SLOW_SHARE:
        return float(rng.choice(_SLOW_HZ))
    return float(rng.choice(_FAST_HZ)) if draw < _SLOW_SHARE + _FAST_SHARE else USUAL_HZ


def _faults(rng: np.random.Generator, kind: str, fields: dict[str, Any]) -> dict[str, Any]:
    faults: dict[str, Any] = {}
    if rng.random() < _WITH_FAULT:
        faults["dropout_probability"] = rng.uniform(*_DROPOUT)
    if rng.random() < _WITH_FAULT:
        longest_s = rng.uniform(*_LOSS_S)
        faults["loss"] = {"mean_interval_s": 2.0, "duration_min_s": _LOSS_S[0], "duration_max_s": longest_s}
    if "jumps" not in fields and rng.random() < _WITH_SPIKES:
        faults["jumps"] = {"mean_interval_s": rng.uniform(*_SPIKE_INTERVAL_S), **_SPIKES, "level": kind == "street"}
    if rng.random() < _WITH_FAULT:
        faults["timing"] = {"frame_jitter_s": rng.uniform(*_JITTER_PERIODS) / fields["rate_hz"]}
    return faults


def _quats(yaw_rad: FloatArray) -> FloatArray:
    zero = np.zeros(yaw_rad.size)
    return np.stack([np.cos(yaw_rad / 2), zero, zero, np.sin(yaw_rad / 2)], axis=1)
