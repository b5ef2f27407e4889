"""A track along and across the line of sight, and the frames in which the person is still."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from gazempc.identify.tracker.likelihood import Stretches
from gazempc.types import BoolArray, FloatArray, IntArray

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
    middle = np.median(up)
    # A change of azimuth is a smaller angle at the sensor if the elevation is large.
    return np.stack([np.log(np.linalg.norm(position_m, axis=1)), np.unwrap(np.arctan2(y, x)) * np.cos(middle), up], 1)


def still(times_s: FloatArray, position_m: FloatArray) -> BoolArray:
    """Where the person stands or sits still, shape (N,).

    Args:
        times_s: Shape (N,), seconds.
        position_m: Shape (N, 3), metres.
    """
    seen = along_and_across(position_m)
    range_m = float(np.exp(np.median(seen[:, 0])))
    along = max(_ALONG_SHARE, _ALONG_M / range_m)
    limits = np.array([along, _ACROSS_M / range_m, _ACROSS_M / range_m])
    return _stays(times_s, seen, limits)


def still_yaw(times_s: FloatArray, yaw_rad: FloatArray) -> BoolArray:
    """Where the person keeps looking in one direction, shape (N,); `yaw_rad` unwrapped, finite."""
    return _stays(times_s, yaw_rad[:, None], np.array([_YAW_RAD]))


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


def runs(flags: BoolArray) -> IntArray:
    """First and one past the last frame of each run of true flags.

    Args:
        flags: Shape (N,).

    Returns:
        Shape (K, 2).
    """
    return np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]]))).reshape(-1, 2)


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
