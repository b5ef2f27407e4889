"""White error, wander and jumps of a measured value, by its variogram and a jackknife.

Third differences of a track leave its white error and little of a person's motion. Half the mean square of the
differences at a lag h, the variogram, increases from the white error by the wander's:
white² + wander² (1 - exp(-h/τ)).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.ndimage import median_filter

from gazempc.identify.estimate import Interval
from gazempc.identify.servo_fit import Z_95
from gazempc.types import BoolArray, FloatArray, IntArray

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
