"""Estimation of a tracker's errors from one track: white error, wander, jumps, yaws, times and latency.

Third differences of a track leave its white error and little of a person's motion. Half the mean square of the
differences at a lag h, the variogram, increases from the white error by the wander's:
white² + wander² (1 - exp(-h/τ)).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d, uniform_filter1d

from gazempc.identify.estimate import Interval
from gazempc.identify.servo_fit import Z_95
from gazempc.identify.tracker.read import HeadTrack
from gazempc.types import BoolArray, FloatArray, IntArray

# Window and limits for a person at rest; wider than a wander of 30 mm across the line of sight, or of 5 % of the range.
_STILL_S = 4.0
_ACROSS_M, _ALONG_SHARE, _ALONG_M = 0.12, 0.2, 0.3
_YAW_RAD = np.deg2rad(40.0)
_SMOOTH_S = 0.7
# Least time at rest for the estimation of a wander of one second.
_STILL_MIN_S = 8.0
# Postural sway of heads, 5 to 10 mm (s.d.; assumed): not an error of the tracker.
_SWAY_M = 0.01
# Bounds of a plausible delay: a shorter one is due to the recorder, a longer one to different clocks.
_DELAY_MIN_S, _DELAY_MAX_S = 0.005, 5.0
# Relative standard deviation of intervals above which the rate is irregular, unless successive intervals compensate
# each other; and minimum gap of an irregular rate, periods.
_IRREGULAR, _IRREGULAR_GAP = 0.25, 3.0
# Sum of the squares of the weights 1, -3, 3, -1.
_THIRD = 20.0
# Longest lag, seconds, and numbers of lags and correlation times in the grid.
_LONGEST_S, _LAGS, _TIMES = 4.0, 16, 30
# Number of blocks of the jackknife.
_BLOCKS = 10
# Detection of jumps: window of the median, threshold in standard deviations, and least share of the jump's size in its
# first step and in each of its frames. A person starts to move more slowly.
_MEDIAN_S, _GATE, _STEP_SHARE = 3.0, 5.0, 0.5


@dataclass(frozen=True)
class Errors:
    """Errors of axes with equal statistics, in the unit of their values, with 95 % intervals.

    Attributes:
        white: Standard deviation of the white error.
        wander: Standard deviation of the correlated error; None if unknown.
        correlation_s: Its correlation time, seconds; None if unknown.
        wander_is: `known`; `none`: not significant, or within a person's sway; `unknown`: the person moved, or the
            correlation time is too long for the recording.
        hidden: Whether `white` is an upper bound: masked by motion, or filtered by the tracker.
        used_s: Duration of the data, seconds.
    """

    white: Interval
    wander: Interval | None
    correlation_s: Interval | None
    wander_is: Literal["known", "none", "unknown"]
    hidden: bool
    used_s: float


@dataclass(frozen=True)
class FrameTimes:
    """Rate, jitter and losses, from the stamps.

    Attributes:
        rate_hz: Frame rate without losses.
        jitter_s: Standard deviation of the intervals without losses.
        regular: Whether the rate is constant: a late frame makes the next interval shorter.
        single_share: Share of single lost frames.
        gaps_s: Durations of losses of two frames or more, shape (K,), seconds.
        duration_s: Time from the first frame to the last, seconds.
    """

    rate_hz: float
    jitter_s: float
    regular: bool
    single_share: float
    gaps_s: FloatArray
    duration_s: float


@dataclass(frozen=True)
class TrackerErrors:
    """Measured errors of a tracker.

    Attributes:
        frames: Rate, jitter and losses.
        along: Relative error of the range.
        across: Error of the bearing on each of its two axes, radians.
        jump_durations_s: Durations of the jumps off the running median, shape (K,), seconds; 0 for a single frame.
        jump_sizes: Root mean square of each on each axis, shares of the range and radians, shape (K, 3).
        still_s: Time at rest of the person, seconds.
        range_m: Least, median and largest range, shape (3,), metres.
        head_yaw: Error of the yaw; None if unknown.
        pelvis_yaw: Error of the yaw; None if unknown.
        delay_s: Median from stamp to arrival, seconds; None if unknown.
    """

    frames: FrameTimes
    along: Errors
    across: Errors
    jump_durations_s: FloatArray
    jump_sizes: FloatArray
    still_s: float
    range_m: FloatArray
    head_yaw: Errors | None
    pelvis_yaw: Errors | None
    delay_s: float | None

    @property
    def moved(self) -> bool:
        """Whether the wander is not identifiable because of the person's motion."""
        return self.still_s < _STILL_MIN_S

    @property
    def latency_s(self) -> float | None:
        """Measured latency, seconds; None if the delay is implausible as latency."""
        return self.delay_s if self.delay_s is not None and _DELAY_MIN_S < self.delay_s < _DELAY_MAX_S else None

    @property
    def jump_sizes_m(self) -> tuple[FloatArray, FloatArray]:
        """Sizes of the jumps along and across the line of sight, each of shape (K,), metres."""
        sizes_m = self.jump_sizes * self.range_m[1]
        return sizes_m[:, 0], np.hypot(sizes_m[:, 1], sizes_m[:, 2])

    @property
    def jumps_across(self) -> bool:
        """Whether jumps have a component across the line of sight, larger than a person's sway."""
        along_m, across_m = self.jump_sizes_m
        # Least ratio of the sizes across and along the line of sight for a jump across it.
        return bool(along_m.size and np.median(across_m) > max(_SWAY_M, 0.3 * np.median(along_m)))


def measure_tracker(track: HeadTrack) -> TrackerErrors:
    """Measure a tracker.

    Args:
        track: Track of one person.

    Returns:
        Its errors.
    """
    x, y, z = track.position_m.T
    times_s, range_m, up = track.times_s, np.linalg.norm(track.position_m, axis=1), np.arctan2(z, np.hypot(x, y))
    middle_m = float(np.median(range_m))
    # Great-circle angle of an azimuth change: times the cosine of the elevation.
    left = np.unwrap(np.arctan2(y, x)) * np.cos(np.median(up))
    # Logarithm of the range (changes are relative), and both angles of the bearing.
    values = np.stack([np.log(range_m), left, up], axis=1)
    limits = np.array([max(_ALONG_SHARE, _ALONG_M / middle_m), _ACROSS_M / middle_m, _ACROSS_M / middle_m])
    stands = _stays(times_s, values, limits)
    still_s = duration_s(times_s, stands)
    is_still = still_s >= _STILL_MIN_S
    calm, jump_durations_s, jump_sizes = find_jumps(times_s, values, stands if is_still else np.ones_like(stands))
    along, across = (
        measure_errors(times_s, values[:, axes], calm, is_still, _SWAY_M / middle_m) for axes in ([0], [1, 2])
    )
    return TrackerErrors(
        frames=frame_times(times_s),
        along=along,
        across=across,
        jump_durations_s=jump_durations_s,
        jump_sizes=jump_sizes,
        still_s=still_s,
        range_m=np.array([range_m.min(), middle_m, range_m.max()]),
        head_yaw=_yaw(times_s, track.head_yaw_rad, stands),
        pelvis_yaw=_yaw(times_s, track.pelvis_yaw_rad, stands),
        delay_s=None if track.delays_s is None else float(np.median(track.delays_s)),
    )


def _stays(times_s: FloatArray, values: FloatArray, limits: FloatArray) -> BoolArray:
    """Mask of the frames in a window of 4 s in which the range of each value is within its limit."""
    period_s = float(np.median(np.diff(times_s)))
    grid_s = np.arange(times_s[0], times_s[-1] + 0.5 * period_s, period_s)
    window, smooth = (max(1, round(length_s / period_s)) for length_s in (_STILL_S, _SMOOTH_S))
    if grid_s.size < window:
        return np.zeros(times_s.size, dtype=np.bool_)
    quiet = np.ones(grid_s.size, dtype=np.bool_)
    for column, limit in zip(values.T, limits, strict=True):
        path = uniform_filter1d(np.interp(grid_s, times_s, column), smooth, mode="nearest")
        quiet &= maximum_filter1d(path, window) - minimum_filter1d(path, window) < limit
    # Incomplete windows at the ends.
    quiet[: window // 2] = quiet[window // 2]
    quiet[-(window // 2) :] = quiet[-(window // 2) - 1]
    around = maximum_filter1d(quiet.astype(np.uint8), window // 2) > 0
    return np.asarray(around[np.clip(np.rint((times_s - grid_s[0]) / period_s).astype(int), 0, grid_s.size - 1)])


def _yaw(times_s: FloatArray, yaw_rad: FloatArray, stands: BoolArray) -> Errors | None:
    known = np.isfinite(yaw_rad)
    if known.mean() < 0.1 or known.sum() < 30:
        return None
    at_s, angle_rad = times_s[known], np.unwrap(yaw_rad[known])
    # Threshold of the yaw change between frames for a flip.
    if (np.abs(np.angle(np.exp(1j * np.diff(angle_rad)))) > np.deg2rad(150.0)).any():
        # In twice the angle, half turns disappear.
        angle_rad = np.unwrap(2.0 * angle_rad) / 2.0
    values = angle_rad[:, None]
    stays = stands[known] & _stays(at_s, values, np.array([_YAW_RAD]))
    is_still = duration_s(at_s, stays) >= _STILL_MIN_S
    return measure_errors(at_s, values, stays if is_still else np.ones_like(stays), is_still)


def frame_times(times_s: FloatArray) -> FrameTimes:
    """Measure rate, jitter and losses.

    Args:
        times_s: Stamps, shape (N,), seconds, strictly increasing.

    Returns:
        Rate, jitter and losses.
    """
    intervals_s = np.diff(times_s)
    duration_s = float(times_s[-1] - times_s[0])
    period_s = float(np.median(intervals_s))
    usual = intervals_s < _IRREGULAR_GAP * period_s
    if _varies_freely(intervals_s, usual):
        gaps_s = intervals_s[~usual] - period_s
        kept_s = intervals_s[usual]
        return FrameTimes(1.0 / float(kept_s.mean()), float(kept_s.std()), False, 0.0, gaps_s, duration_s)
    missing = np.zeros(intervals_s.size, dtype=np.intp)
    for _ in range(3):
        missing = _missing(intervals_s, period_s)
        # Mean over the track: late frames cancel out.
        period_s = duration_s / float(intervals_s.size + missing.sum())
    return FrameTimes(
        1.0 / period_s,
        float(intervals_s[missing == 0].std()),
        True,
        float((missing == 1).sum() / (times_s.size + missing.sum())),
        np.asarray(missing[missing > 1] * period_s, dtype=np.float64),
        duration_s,
    )


def _varies_freely(intervals_s: FloatArray, usual: BoolArray) -> bool:
    kept_s = intervals_s[usual]
    if kept_s.std() < _IRREGULAR * kept_s.mean():
        return False
    # Intervals with losses at a constant rate are integer multiples of the period.
    periods = kept_s / np.quantile(kept_s, 0.2)
    if np.abs(periods - np.rint(periods)).mean() < 0.1:
        return False
    beside = usual[1:] & usual[:-1]
    # Threshold of the correlation of successive intervals: -0.5 if each late frame shortens the next interval.
    return bool(np.corrcoef(intervals_s[:-1][beside], intervals_s[1:][beside])[0, 1] > -0.25)


def _missing(intervals_s: FloatArray, period_s: float) -> IntArray:
    """Number of missing frames in each interval, shape (N - 1,).

    A late frame is followed by a short interval; a missing one is not.
    """
    beside_s = np.minimum(np.concatenate([[period_s], intervals_s, [period_s]]), period_s)
    around = np.rint((beside_s[:-2] + intervals_s + beside_s[2:]) / period_s).astype(np.intp) - 3
    # Interval in periods above which frames are lost.
    return np.where(intervals_s > 1.5 * period_s, np.maximum(around, 0), 0)


def runs(flags: BoolArray) -> IntArray:
    """Index of the first frame, and one past the last, of each run of true flags.

    Args:
        flags: Shape (N,).

    Returns:
        Shape (K, 2).
    """
    return np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]]))).reshape(-1, 2)


def duration_s(times_s: FloatArray, used: BoolArray) -> float:
    """Sum of the intervals between frames that are used, seconds."""
    return float(np.diff(times_s)[used[1:] & used[:-1]].sum())


def find_jumps(times_s: FloatArray, values: FloatArray, wanted: BoolArray) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Find the jumps of a track: runs of frames off its running median.

    Args:
        times_s: Shape (N,), seconds.
        values: Shape (N, A).
        wanted: Mask of the tested frames, shape (N,).

    Returns:
        Mask of the tested frames without jumps, shape (N,); durations of the jumps, shape (K,), seconds, 0 for a single
        frame; and their root mean square on each axis, in the unit of the values, shape (K, A).
    """
    window = 2 * int(0.5 * _MEDIAN_S / np.median(np.diff(times_s))) + 1
    aside = values - median_filter(values, (window, 1), mode="nearest")
    # Standard deviation of a normal distribution over its median absolute deviation.
    gate = _GATE * 1.4826 * np.median(np.abs(aside[wanted]), axis=0)
    steps = np.abs(np.diff(values, axis=0, prepend=values[:1]))
    calm, durations_s, sizes = wanted.copy(), [], []
    for first, last in runs(wanted & (np.abs(aside) > gate).any(axis=1)):
        way = np.abs(aside[first:last])
        axis = int(np.argmax(way.max(axis=0) / np.maximum(gate, 1e-12)))
        least = _STEP_SHARE * way[:, axis].max()
        if steps[first, axis] >= least:
            there = way[:, axis] >= least
            calm[first:last] &= ~there
            durations_s.append(float(np.ptp(times_s[first:last][there])))
            sizes.append(np.sqrt((way[there] ** 2).mean(axis=0)))
    return calm, np.array(durations_s), np.reshape(sizes, (-1, values.shape[1]))


def measure_errors(times_s: FloatArray, values: FloatArray, used: BoolArray, still: bool, sway: float = 0.0) -> Errors:
    """Estimate the white error and, for a person at rest, the wander.

    The intervals are by a block jackknife with ten blocks.

    Args:
        times_s: Shape (N,), seconds.
        values: Values of axes with equal error statistics, shape (N, A).
        used: Mask of the frames to use, shape (N,).
        still: Whether the person is at rest in these frames; else the wander is not estimated.
        sway: Standard deviation of a person's sway: lower bound of the wander.

    Returns:
        The errors.
    """
    period_s, used_s = float(np.median(np.diff(times_s))), duration_s(times_s, used)
    longest = int(min(_LONGEST_S / period_s, times_s.size / 4)) if still else 0
    lags = np.unique(np.geomspace(1, longest, _LAGS).astype(int)) if longest > 2 else np.array([], dtype=int)
    block = np.minimum(np.cumsum(used) * _BLOCKS // max(int(used.sum()), 1), _BLOCKS - 1)
    thirds, whole = np.diff(values, 3, axis=0), used[3:] & used[2:-1] & used[1:-2] & used[:-3]
    squares, at_s = [_in_blocks(thirds / np.sqrt(_THIRD), np.flatnonzero(whole), block)], [0.0]
    for lag in lags:
        apart_s = times_s[lag:] - times_s[:-lag]
        pairs = np.flatnonzero(used[lag:] & used[:-lag] & (apart_s < 1.5 * lag * period_s))
        if pairs.size:
            squares.append(_in_blocks((values[lag:] - values[:-lag]) / np.sqrt(2.0), pairs, block))
            at_s.append(float(apart_s[pairs].mean()))
    white, wander, correlation_s = _jackknife(squares, at_s, period_s)
    # Significance threshold of the wander's variance, times white² / √N: 1 to 5 % false positives for N values.
    seen = wander.value > max(sway, np.sqrt(6.0 / np.sqrt(used.sum() * values.shape[1])) * white.value)
    # Least duration of the data, in correlation times of the wander.
    known = seen and used_s >= 8.0 * correlation_s.value
    if not known:
        # Third differences suppress the smooth sway of a person.
        white, *_ = _jackknife(squares[:1], at_s[:1], period_s)
    beside = whole[1:] & whole[:-1]
    # Neighbouring third differences of white noise have a correlation of -0.75; of smooth motion 1.
    alike = float((thirds[1:] * thirds[:-1])[beside].sum()) > -0.375 * float((thirds[1:][beside] ** 2).sum())
    return Errors(
        white=white,
        wander=wander if known else None,
        correlation_s=correlation_s if known else None,
        wander_is="known" if known else "unknown" if seen or not still else "none",
        hidden=alike and not known,
        used_s=used_s,
    )


def _jackknife(squares: list[FloatArray], at_s: list[float], period_s: float) -> list[Interval]:
    """White error, wander and correlation time with their intervals, of `_in_blocks` at the lags `at_s`."""
    sums, lags_s = np.array(squares), np.array(at_s[1:])

    def estimate(blocks: FloatArray) -> FloatArray:
        total, count = blocks.sum(axis=2).T
        return _white_and_wander(total / np.maximum(count, 1.0), count, lags_s, period_s)

    each = np.array([estimate(np.delete(sums, k, axis=2)) for k in range(_BLOCKS)])
    halves = Z_95 * np.sqrt((_BLOCKS - 1) * np.mean((each - each.mean(axis=0)) ** 2, axis=0))
    return [Interval.around(value, half) for value, half in zip(estimate(sums), halves, strict=True)]


def _in_blocks(differences: FloatArray, chosen: IntArray, block: IntArray) -> FloatArray:
    """Sum of the squares of the chosen differences and their number in each block, shape (2, blocks)."""
    sums = np.bincount(block[chosen], (differences[chosen] ** 2).sum(axis=1), _BLOCKS)
    return np.array([sums, differences.shape[1] * np.bincount(block[chosen], minlength=_BLOCKS)])


def _white_and_wander(squares: FloatArray, counts: FloatArray, lags_s: FloatArray, period_s: float) -> FloatArray:
    """White error, wander and its correlation time, shape (3,).

    Args:
        squares: Mean square of the third differences, then of those at the lags, shape (1 + L,); for white noise alone
            each equals its variance.
        counts: Number of squares in each, shape (1 + L,).
        lags_s: Shape (L,), seconds.
        period_s: Frame interval, seconds.
    """
    third, variogram = squares[0], squares[1:]
    if not lags_s.size:
        return np.array([np.sqrt(third), 0.0, 0.0])
    tried_s = np.geomspace(2.0 * period_s, lags_s[-1], _TIMES)
    decay = np.exp(-period_s / tried_s)
    # Contributions of a wander of unit variance to the third differences and to the variogram.
    in_third = (20.0 - 30.0 * decay + 12.0 * decay**2 - 2.0 * decay**3) / _THIRD
    shape = 1.0 - np.exp(-lags_s / tried_s[:, None]) - in_third[:, None]
    weight = counts[1:] / np.maximum(variogram, 1e-30) ** 2
    variance = (shape * (variogram - third) * weight).sum(axis=1) / (shape**2 * weight).sum(axis=1)
    variance = np.clip(variance, 0.0, 0.95 * third / in_third)
    error = ((variogram - third - variance[:, None] * shape) ** 2 * weight).sum(axis=1)
    best = int(np.argmin(error))
    white = np.sqrt(third - variance[best] * in_third[best])
    return np.array([white, np.sqrt(variance[best]), tried_s[best]])
