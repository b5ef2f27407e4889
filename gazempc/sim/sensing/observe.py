"""Simulated observations of a recording."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import numpy as np

from gazempc.errors import SettingsError
from gazempc.recordings.recording import Recording, Track, turned
from gazempc.sim.sensing.errors import (
    bouts,
    frames_taken,
    jump_error,
    sight_axes,
    sight_error,
    stated_covariances,
    wander,
    yaw_error,
)
from gazempc.sim.sensing.spec import OtherPerson, SensorSpec, YawError
from gazempc.types import BoolArray, FloatArray, IntArray, Sighting
from predictors import HeadObservation

# Independent random streams, so that enabling one process does not change the others. Noise of axes and yaws, and
# independent loss, share the stream without a number, for compatibility with earlier results.
_STREAMS = ("wander", "sight", "jumps", "loss", "head", "pelvis", "frames", "latency", "stamps")
# Tracker names of the recording's person and of the other one.
_NAMES = ("1", "2")
_Streams = dict[str, np.random.Generator]


def observe(placed: Recording, sensor: SensorSpec, seed: int) -> tuple[Sighting, ...]:
    """Simulate the observations of a recording by a sensor.

    A sensor on the head has an unlimited field of view here, as joint angles are known only in `gazempc.sim.replay`.

    Args:
        placed: The recording in the robot's base frame.
        sensor: The sensor.
        seed: Seed of all errors, combined with the recording's name: independent noise for each recording, the same
            for all controllers.

    Returns:
        The sightings in order of arrival.

    Raises:
        SettingsError: If the sensor is ``recorded`` but the recording has no measured track, or without observations.
    """
    track, times_s = _track_of(placed, sensor), placed.times_s
    entropy = [seed, zlib.crc32(placed.name.encode())]
    streams = {name: np.random.default_rng([*entropy, k]) for k, name in enumerate(_STREAMS, 1)}
    # One sample for every frame of the recording: the noise of a frame is independent of the selection of frames.
    rng = np.random.default_rng(entropy)
    noise_m = sensor.position_noise_m * rng.standard_normal((times_s.size, 3))
    yaw_noise_rad = np.deg2rad(sensor.yaw_noise_deg) * rng.standard_normal((times_s.size, 2))
    missed = rng.random(times_s.size) < sensor.dropout_probability

    # Errors and visibility apply to the person who is shown.
    shows_the_other = _shows_other(times_s, sensor.other_person)
    to_other_m = sensor.other_person.aside_m * sight_axes(track.head_position_m)[:, 1]
    shown_m = track.head_position_m + np.where(shows_the_other[:, None], to_other_m, 0.0)
    positions_m = shown_m + noise_m + _position_error(times_s, shown_m, sensor, streams)
    missed |= bouts(times_s, sensor.loss, streams["loss"]) >= 0
    visible = track.valid & ~missed & _within(sensor, shown_m, positions_m)
    taken = frames_taken(times_s, sensor.rate_hz, sensor.timing.frame_jitter_s, streams["frames"])
    seen = taken[visible[taken]]
    if not seen.size:
        raise SettingsError(
            f"sensor {sensor.name!r} never sees the person in {placed.name}: check its range, view and loss"
        )
    # Vectorised over frames: a single rotation takes as long.
    head_m, timing = track.head_position_m, sensor.timing
    head_rad, head_known = yaw_error(times_s, head_m, track.head_quat_wxyz, sensor.head_yaw, streams["head"])
    pelvis_rad, pelvis_known = yaw_error(times_s, head_m, track.pelvis_quat_wxyz, sensor.pelvis_yaw, streams["pelvis"])
    stamp_error_s = timing.stamp_offset_s + timing.stamp_noise_s * streams["stamps"].standard_normal(times_s.size)
    seen_as = zip(
        (times_s + stamp_error_s)[seen].tolist(),
        positions_m[seen],
        _turned(track.head_quat_wxyz, yaw_noise_rad[:, 0] + head_rad, head_known, seen),
        _turned(track.pelvis_quat_wxyz, yaw_noise_rad[:, 1] + pelvis_rad, pelvis_known, seen),
        _stated_positions(sensor, positions_m[seen]),
        _stated_yaws(sensor, sensor.head_yaw, head_known[seen]),
        _stated_yaws(sensor, sensor.pelvis_yaw, pelvis_known[seen]),
        [_NAMES[shows] if sensor.other_person.ids else None for shows in shows_the_other[seen].tolist()],
        strict=True,
    )
    latency_s = sensor.latency_s + timing.latency_jitter_s * streams["latency"].random(times_s.size)
    arrive_s = (times_s + latency_s)[seen]
    if timing.keeps_order:
        arrive_s = np.maximum.accumulate(arrive_s)
    sightings = [Sighting(at_s, HeadObservation(*each)) for at_s, each in zip(arrive_s.tolist(), seen_as, strict=True)]
    return tuple(sorted(sightings, key=lambda sighting: sighting.arrival_s))


def _track_of(placed: Recording, sensor: SensorSpec) -> Track:
    if sensor.measures == "truth":
        return placed.truth
    if placed.measured is None:
        raise SettingsError(
            f"sensor {sensor.name!r} replays what a body tracker measured, but {placed.name} ({placed.kind}) has "
            f"no such track; accepted: a sensor with measures = \"truth\", such as 'reference' or 'perfect'"
        )
    return placed.measured


def _shows_other(times_s: FloatArray, other: OtherPerson) -> BoolArray:
    """Mask of the frames that show the other person: at the end of each period, counted from the first frame."""
    # Tolerance for frames at the boundary of a period.
    in_period_s = (times_s - times_s[0] + 1e-6) % other.every_s
    return np.asarray(in_period_s >= other.every_s - other.shown_s)


def _position_error(times_s: FloatArray, true_m: FloatArray, sensor: SensorSpec, streams: _Streams) -> FloatArray:
    """Wander on each axis, errors along and across the line of sight, jumps: shape (N, 3), metres."""
    slow = sensor.position_wander_m * wander(times_s, sensor.position_wander_time_s, 3, streams["wander"])
    on_sight = sight_error(times_s, true_m, sensor.along, sensor.across, streams["sight"])
    return slow + on_sight + jump_error(times_s, sensor.jumps, streams["jumps"])


def _within(sensor: SensorSpec, true_m: FloatArray, measured_m: FloatArray) -> BoolArray:
    """Mask of the frames with the head in range (measured where possible) and in view, shape (N,)."""
    range_m = np.linalg.norm(measured_m, axis=1)
    in_range: BoolArray = (sensor.range_min_m <= range_m) & (range_m <= sensor.range_max_m)
    return in_range & sensor.view.contains(true_m) if sensor.view.on == "base" else in_range


def _turned(
    quats_wxyz: FloatArray, turn_rad: FloatArray, known: BoolArray, seen: IntArray
) -> Sequence[FloatArray | None]:
    """The observed orientations; None if unknown."""
    shown = turned(quats_wxyz[seen], turn_rad[seen])
    return [quat if is_known else None for quat, is_known in zip(shown, known[seen].tolist(), strict=True)]


def _stated_positions(sensor: SensorSpec, measured_m: FloatArray) -> Sequence[FloatArray | None]:
    if not sensor.states_covariance:
        return [None] * len(measured_m)
    return list(stated_covariances(measured_m, sensor.each_axis_sd_m, sensor.along, sensor.across))


def _stated_yaws(sensor: SensorSpec, error: YawError, known: BoolArray) -> Sequence[float | None]:
    sd_rad = float(np.deg2rad(np.hypot(sensor.yaw_noise_deg, np.hypot(error.noise_deg, error.wander_deg))))
    stated = sd_rad if sensor.states_covariance and sd_rad > 0 else None
    return [stated if one else None for one in known]
