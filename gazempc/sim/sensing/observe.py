"""Simulated observations of a recording: selection of frames, random processes, errors of position and yaw."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from gazempc.errors import SettingsError
from gazempc.recordings.recording import Recording, Track, turned
from gazempc.sim.sensing.spec import AcrossError, AlongError, Bouts, Jumps, SensorSpec, YawError
from gazempc.types import BoolArray, FloatArray, IntArray, Sighting
from predictors import HeadObservation

# Independent random streams, so that enabling one process does not change the others. Noise of axes and yaws, and
# independent loss, share the stream without a number, for compatibility with earlier results.
_STREAMS = ("wander", "sight", "jumps", "loss", "head", "pelvis", "frames", "latency", "stamps")
# Tracker names of the recording's person and of the other one.
_NAMES = ("1", "2")


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
    other = sensor.other_person
    # At the end of each period, counted from the first frame; with a tolerance for frames at its boundary.
    shows_the_other = (times_s - times_s[0] + 1e-6) % other.every_s >= other.every_s - other.shown_s
    to_other_m = other.aside_m * sight_axes(track.head_position_m)[:, 1]
    shown_m = track.head_position_m + np.where(shows_the_other[:, None], to_other_m, 0.0)
    wander_m = sensor.position_wander_m * wander(times_s, sensor.position_wander_time_s, 3, streams["wander"])
    on_sight_m = sight_error(times_s, shown_m, sensor.along, sensor.across, streams["sight"])
    error_m = wander_m + on_sight_m + jump_error(times_s, sensor.jumps, streams["jumps"])
    positions_m = shown_m + noise_m + error_m
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
        stated_covariances(sensor, positions_m[seen]) if sensor.states_covariance else [None] * seen.size,
        _stated_yaws(sensor, sensor.head_yaw, head_known[seen]),
        _stated_yaws(sensor, sensor.pelvis_yaw, pelvis_known[seen]),
        [_NAMES[shows] if other.ids else None for shows in shows_the_other[seen].tolist()],
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


def _stated_yaws(sensor: SensorSpec, error: YawError, known: BoolArray) -> Sequence[float | None]:
    sd_rad = float(np.deg2rad(np.hypot(sensor.yaw_noise_deg, np.hypot(error.noise_deg, error.wander_deg))))
    stated = sd_rad if sensor.states_covariance and sd_rad > 0 else None
    return [stated if one else None for one in known]


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
    new = np.concatenate([[True], rng.random(times_s.size - 1) >= stays])
    return drawn[np.maximum.accumulate(np.where(new, np.arange(times_s.size), 0))]


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


# Above or below the sensor "left" is undefined; any horizontal direction is valid.
_VERTICAL = 1e-9


def sight_axes(positions_m: FloatArray) -> FloatArray:
    """Frames of the lines of sight from the origin: along, left, up.

    Args:
        positions_m: Shape (N, 3), metres.

    Returns:
        Shape (N, 3, 3), a unit vector a row.
    """
    range_m = np.linalg.norm(positions_m, axis=1, keepdims=True)
    along = np.divide(positions_m, range_m, out=np.tile([1.0, 0.0, 0.0], (len(positions_m), 1)), where=range_m > 0)
    level = np.hypot(along[:, 0], along[:, 1])[:, None]
    flat_left = np.stack([-along[:, 1], along[:, 0], np.zeros(len(along))], axis=1)
    left = np.where(level > _VERTICAL, flat_left / np.maximum(level, _VERTICAL), [0.0, 1.0, 0.0])
    return np.stack([along, left, np.cross(along, left)], axis=1)


def sight_sds(positions_m: FloatArray, along: AlongError, across: AcrossError) -> tuple[FloatArray, FloatArray]:
    """Standard deviations of white error and wander on the axes of `sight_axes`.

    Args:
        positions_m: Shape (N, 3), metres.
        along: Error of the range.
        across: Error across the line of sight.

    Returns:
        White error and wander, each of shape (N, 3), metres.
    """
    range_m = np.linalg.norm(positions_m, axis=1)
    white, slow = np.stack([error.sds_m(range_m) for error in (along, across, across)], axis=-1)
    return white, slow


def sight_error(
    times_s: FloatArray, positions_m: FloatArray, along: AlongError, across: AcrossError, rng: np.random.Generator
) -> FloatArray:
    """White error and wander along and across the line of sight.

    Args:
        times_s: Times of the frames, shape (N,), seconds.
        positions_m: True positions, shape (N, 3), metres, base frame; NaN while absent.
        along: Error of the range.
        across: Error across the line of sight.
        rng: Random generator.

    Returns:
        Error in the base frame, shape (N, 3), metres.
    """
    white, slow = sight_sds(positions_m, along, across)
    steps = [wander(times_s, along.wander_time_s, 1, rng), wander(times_s, across.wander_time_s, 2, rng)]
    on_axes = white * rng.standard_normal((times_s.size, 3)) + slow * np.concatenate(steps, axis=1)
    return np.asarray(np.einsum("na,nai->ni", on_axes, sight_axes(positions_m)))


def jump_error(times_s: FloatArray, jumps: Jumps, rng: np.random.Generator) -> FloatArray:
    """Jumps of the track.

    Args:
        times_s: Times of the frames, shape (N,), seconds.
        jumps: Frequency, duration and size.
        rng: Random generator.

    Returns:
        Error in the base frame, shape (N, 3), metres; 0 outside jumps.
    """
    number = bouts(times_s, jumps, rng)
    count = int(number.max()) + 1
    aside = rng.standard_normal((count, 3)) * ([1.0, 1.0, 0.0] if jumps.level else [1.0, 1.0, 1.0])
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    aside *= rng.uniform(jumps.size_min_m, jumps.size_max_m, count)[:, None]
    # The row after the last jump is for the frames outside of jumps, whose number is -1.
    return np.vstack([aside, np.zeros(3)])[number]


def stated_covariances(sensor: SensorSpec, measured_m: FloatArray) -> FloatArray:
    """Error covariance stated by a sensor: white error plus wander, at the measured range.

    Args:
        sensor: The sensor.
        measured_m: Measured positions, shape (N, 3), metres, base frame.

    Returns:
        Shape (N, 3, 3), square metres, base frame.
    """
    white, slow = sight_sds(measured_m, sensor.along, sensor.across)
    variances = white**2 + slow**2 + sensor.each_axis_sd_m**2
    axes = sight_axes(measured_m)
    return np.asarray(np.einsum("nai,na,naj->nij", axes, variances, axes))


def yaw_error(
    times_s: FloatArray, positions_m: FloatArray, quats_wxyz: FloatArray, error: YawError, rng: np.random.Generator
) -> tuple[FloatArray, BoolArray]:
    """Error and loss of a yaw.

    Args:
        times_s: Times of the frames, shape (N,), seconds.
        positions_m: True positions of the person, shape (N, 3), metres, base frame.
        quats_wxyz: True orientations of head or pelvis, shape (N, 4); NaN if unknown.
        error: Parameters of the error.
        rng: Random generator.

    Returns:
        Error, shape (N,), radians; mask of the frames with a yaw, shape (N,).
    """
    away = _faces_away(positions_m, quats_wxyz, error.away_deg)
    white = np.deg2rad(error.noise_deg) * rng.standard_normal(times_s.size)
    slow = np.deg2rad(error.wander_deg) * wander(times_s, error.wander_time_s, 1, rng)[:, 0]
    fate = held_uniform(times_s, error.hold_s, rng)
    lost = away & (fate < error.lost_share)
    flipped = away & ~lost & (fate < error.lost_share + error.flipped_share)
    # A recording may have positions only.
    known = np.isfinite(quats_wxyz).all(axis=1) & ~lost & error.reported
    return white + slow + np.pi * flipped, known


def _faces_away(positions_m: FloatArray, quats_wxyz: FloatArray, away_deg: float) -> BoolArray:
    """Mask of the frames with an orientation turned from the origin by more than an angle, about the vertical."""
    w, x, y, z = quats_wxyz.T
    yaw_rad = np.arctan2(2.0 * (x * y + w * z), w**2 + x**2 - y**2 - z**2)
    off_rad = yaw_rad - np.arctan2(-positions_m[:, 1], -positions_m[:, 0])
    return np.asarray(np.abs((off_rad + np.pi) % (2.0 * np.pi) - np.pi) > np.deg2rad(away_deg))
