"""All errors of a tracker from one track: white error, wander, jumps, yaws, times and latency."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from gazempc.identify.tracker.errors import GroupFit, TrackJumps, measure_errors, runs
from gazempc.identify.tracker.likelihood import Stretches
from gazempc.identify.tracker.read import HeadTrack
from gazempc.identify.tracker.timing import FrameTimes, frame_times
from gazempc.types import BoolArray, FloatArray

# A person within these limits for this long stands or sits still. A wander of 30 mm across the line of sight, or of
# 5 % of the range, stays within them, too.
_STILL_S = 4.0
_ACROSS_M, _ALONG_SHARE, _ALONG_M = 0.12, 0.2, 0.3
_YAW_RAD = np.deg2rad(40.0)
_SMOOTH_S = 0.7
# Long enough for a wander of two seconds; enough stretches to estimate a standard deviation.
_STRETCH_S = (8.0, 20.0)
_STRETCHES = 8
_PIECE_MIN_S = 3.0
# A shorter time is too short to estimate a wander of one second.
_STILL_MIN_S = 8.0
# A wander is known from this many of its correlation times on.
_CORRELATIONS = 8.0
# Heads of people who stand sway by 5 to 10 mm (s.d.; assumed): less is no error of a tracker.
_SWAY_M = 0.01
# A shorter delay comes from the recorder. A longer one means that the clocks differ.
_DELAY_MIN_S, _DELAY_MAX_S = 0.005, 5.0
# A jump counts as across the line of sight if its size there is beyond this share of its size along it.
_SIDEWAYS = 0.3
# A yaw that turns by more than this from frame to frame was flipped, not turned.
_FLIP_RAD = np.deg2rad(150.0)


@dataclass(frozen=True)
class DirectionError:
    """Error in one direction, or of a yaw.

    Attributes:
        fit: The fit, as a share of the range or in radians.
        wander: `known`, `none` (the data show none, or no more than a person's sway), or `unknown` (the person moved).
        used_s: Seconds that were used.
    """

    fit: GroupFit
    wander: Literal["known", "none", "unknown"]
    used_s: float


@dataclass(frozen=True)
class TrackerErrors:
    """Measured errors of a tracker.

    Attributes:
        frames: Rate, jitter and losses.
        along: Error of the range, shares of it.
        across: Error of the bearing on each of its two axes, radians.
        jumps: Jumps of the track; sizes are shares of the range and radians.
        still_s: Seconds in which the person stood or sat still.
        range_m: Least, median and largest range, shape (3,), metres.
        head_yaw: None where it is not known.
        pelvis_yaw: None where it is not known.
        delay_s: Median from stamp to arrival, seconds; None where unknown.
    """

    frames: FrameTimes
    along: DirectionError
    across: DirectionError
    jumps: TrackJumps
    still_s: float
    range_m: FloatArray
    head_yaw: DirectionError | None
    pelvis_yaw: DirectionError | None
    delay_s: float | None

    @property
    def used_s(self) -> float:
        """Seconds of data used for the position errors."""
        return self.along.used_s

    @property
    def moved(self) -> bool:
        """Whether the person moved too much to separate the tracker's wander from the motion."""
        return self.still_s < _STILL_MIN_S

    @property
    def latency_s(self) -> float | None:
        """Latency, as far as it is measured: a shorter delay is that of the recorder alone."""
        return self.delay_s if self.delay_s is not None and _DELAY_MIN_S < self.delay_s < _DELAY_MAX_S else None

    @property
    def jump_sizes_m(self) -> tuple[FloatArray, FloatArray]:
        """How far each jump goes along and across the line of sight, each of shape (K,), metres."""
        sizes_m = self.jumps.sizes * self.range_m[1]
        return sizes_m[:, 0], np.hypot(sizes_m[:, 1], sizes_m[:, 2])

    @property
    def jumps_across(self) -> bool:
        """Whether jumps go across the line of sight as well as along it, farther than a person sways."""
        along_m, across_m = self.jump_sizes_m
        return bool(along_m.size and np.median(across_m) > max(_SWAY_M, _SIDEWAYS * np.median(along_m)))


def measure_tracker(track: HeadTrack, report: Callable[[float], None]) -> TrackerErrors:
    """Measure a tracker.

    Args:
        track: Track of one person.
        report: Called with the share that is done, 0 to 1.

    Returns:
        Its errors.
    """
    values = along_and_across(track.position_m)
    times_s, range_m = track.times_s, np.exp(values[:, 0])
    stands = still(times_s, values)
    data = cut(times_s, values, range_m, stands)
    still_s = data.duration_s
    if moved := still_s < _STILL_MIN_S:
        data = cut(times_s, values, range_m, np.ones(times_s.size, dtype=np.bool_))
    fits, jumps = measure_errors(data, (0, 1, 1), not moved, lambda share: report(0.6 * share))
    used_s, middle_m = data.duration_s, float(np.median(range_m))
    along, across = (_direction(fit, used_s, moved, _SWAY_M / middle_m) for fit in fits)
    head = _yaw(times_s, track.head_yaw_rad, stands, lambda share: report(0.6 + 0.2 * share))
    pelvis = _yaw(times_s, track.pelvis_yaw_rad, stands, lambda share: report(0.8 + 0.2 * share))
    return TrackerErrors(
        frames=frame_times(times_s),
        along=along,
        across=across,
        jumps=jumps,
        still_s=still_s,
        range_m=np.array([range_m.min(), middle_m, range_m.max()]),
        head_yaw=head,
        pelvis_yaw=pelvis,
        delay_s=None if track.delays_s is None else float(np.median(track.delays_s)),
    )


def along_and_across(position_m: FloatArray) -> FloatArray:
    """Logarithm of the range, and both angles of the bearing.

    Small changes of the first value are shares of the range. Those of the others are angles at the sensor, radians.

    Args:
        position_m: Shape (N, 3), metres, the sensor at the origin.

    Returns:
        Shape (N, 3).
    """
    x, y, z = position_m.T
    up = np.arctan2(z, np.hypot(x, y))
    # A change of azimuth is a smaller angle at the sensor if the elevation is large.
    left = np.unwrap(np.arctan2(y, x)) * np.cos(np.median(up))
    return np.stack([np.log(np.linalg.norm(position_m, axis=1)), left, up], axis=1)


def still(times_s: FloatArray, values: FloatArray) -> BoolArray:
    """Frames in which the person stands or sits still, shape (N,).

    Args:
        times_s: Shape (N,), seconds.
        values: As of `along_and_across`, shape (N, 3).
    """
    range_m = float(np.exp(np.median(values[:, 0])))
    along = max(_ALONG_SHARE, _ALONG_M / range_m)
    return _stays(times_s, values, np.array([along, _ACROSS_M / range_m, _ACROSS_M / range_m]))


def _stays(times_s: FloatArray, values: FloatArray, limits: FloatArray) -> BoolArray:
    """Frames in a window in which no value travels farther than its limit."""
    period_s = float(np.median(np.diff(times_s)))
    grid_s = np.arange(times_s[0], times_s[-1] + 0.5 * period_s, period_s)
    window, smooth = (max(1, round(length_s / period_s)) for length_s in (_STILL_S, _SMOOTH_S))
    if grid_s.size < window:
        return np.zeros(times_s.size, dtype=np.bool_)
    quiet = np.ones(grid_s.size, dtype=np.bool_)
    for column, limit in zip(values.T, limits, strict=True):
        path = uniform_filter1d(np.interp(grid_s, times_s, column), smooth, mode="nearest")
        quiet &= maximum_filter1d(path, window) - minimum_filter1d(path, window) < limit
    # Windows at the ends contain less than their length.
    quiet[: window // 2] = quiet[window // 2]
    quiet[-(window // 2) :] = quiet[-(window // 2) - 1]
    around = maximum_filter1d(quiet.astype(np.uint8), window // 2) > 0
    return np.asarray(around[np.clip(np.rint((times_s - grid_s[0]) / period_s).astype(int), 0, grid_s.size - 1)])


def cut(times_s: FloatArray, values: FloatArray, scales_m: FloatArray, wanted: BoolArray) -> Stretches:
    """Cut the wanted frames of a track into stretches.

    Args:
        times_s: Shape (N,), seconds.
        values: Shape (N, A).
        scales_m: Metres of a unit of `values` in each frame, shape (N,).
        wanted: Frames to use, shape (N,). Pieces shorter than three seconds are left out.

    Returns:
        The stretches; of B = 0 where nothing is long enough.
    """
    long = [np.arange(a, b) for a, b in runs(wanted) if times_s[b - 1] - times_s[a] >= _PIECE_MIN_S]
    total_s = sum(float(times_s[run[-1]] - times_s[run[0]]) for run in long)
    length_s = float(np.clip(total_s / _STRETCHES, *_STRETCH_S))
    pieces = []
    for run in long:
        count = max(1, int((times_s[run[-1]] - times_s[run[0]]) / length_s))
        pieces += np.array_split(run, count)
    frames = max((piece.size for piece in pieces), default=0)
    shape = (frames, len(pieces))
    intervals_s, used = np.zeros(shape), np.zeros(shape, dtype=np.bool_)
    cut_values = np.zeros((frames, values.shape[1], len(pieces)))
    scale_m = np.ones(len(pieces))
    for b, piece in enumerate(pieces):
        intervals_s[1 : piece.size, b] = np.diff(times_s[piece])
        used[: piece.size, b] = True
        cut_values[: piece.size, :, b] = values[piece]
        cut_values[piece.size :, :, b] = values[piece[-1]]
        scale_m[b] = np.median(scales_m[piece])
    return Stretches(intervals_s, cut_values, used, scale_m)


def _direction(fit: GroupFit, used_s: float, moved: bool, sway: float) -> DirectionError:
    wander: Literal["known", "none", "unknown"] = "known"
    if moved or (fit.correlation_s is not None and used_s < _CORRELATIONS * fit.correlation_s.value):
        wander = "unknown"
    elif fit.wander is None or fit.wander.value < sway:
        wander = "none"
    return DirectionError(fit, wander, used_s)


def _yaw(
    times_s: FloatArray, yaw_rad: FloatArray, stands: BoolArray, report: Callable[[float], None]
) -> DirectionError | None:
    known = np.isfinite(yaw_rad)
    if known.mean() < 0.1 or known.sum() < 30:
        return None
    at_s, angle_rad = times_s[known], np.unwrap(yaw_rad[known])
    if (np.abs(np.angle(np.exp(1j * np.diff(angle_rad)))) > _FLIP_RAD).any():
        # In twice the angle, half turns disappear.
        angle_rad = np.unwrap(2.0 * angle_rad) / 2.0
    values, ones = angle_rad[:, None], np.ones(at_s.size)
    data = cut(at_s, values, ones, stands[known] & _stays(at_s, values, np.array([_YAW_RAD])))
    if moved := data.duration_s < _STILL_MIN_S:
        data = cut(at_s, values, ones, ones > 0)
    if not data.used.any():
        return None
    (fit,), _ = measure_errors(data, (0,), True, report)
    return _direction(fit, data.duration_s, moved, 0.0)
