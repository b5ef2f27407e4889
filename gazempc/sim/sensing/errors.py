"""Frame selection, random processes, errors of position and yaw, and the covariance stated by a sensor."""

from __future__ import annotations

from itertools import accumulate

import numpy as np

from gazempc.sim.sensing.spec import AcrossError, AlongError, Bouts, Jumps, YawError
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


def stated_covariances(
    measured_m: FloatArray, each_axis_m: float, along: AlongError, across: AcrossError
) -> FloatArray:
    """Error covariance stated by a sensor: white error plus wander, at the measured range.

    Args:
        measured_m: Measured positions, shape (N, 3), metres, base frame.
        each_axis_m: Standard deviation of the isotropic error, metres.
        along: Error of the range.
        across: Error across the line of sight.

    Returns:
        Shape (N, 3, 3), square metres, base frame.
    """
    white, slow = sight_sds(measured_m, along, across)
    variances = white**2 + slow**2 + each_axis_m**2
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
