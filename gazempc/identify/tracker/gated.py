"""Fit errors without the jumps of a track, and measure the jumps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gazempc.identify.tracker.fit import GroupFit, Known, fit_errors
from gazempc.identify.tracker.likelihood import Stretches, likelihood
from gazempc.identify.tracker.sight import runs
from gazempc.types import BoolArray, FloatArray

# A normal innovation is larger once in 150,000 frames and axes.
_GATE = 4.5
_ROUNDS = 3
# The variance of third differences of white noise is this many times its own.
_THIRD_DIFFERENCES = 20.0
# If the fitted white error is below this share of the third differences, the person's motion hides it.
_HIDDEN = 0.4
# Each frame of a jump, also the first, is at least this share of its size away. A person starts to move more slowly.
_STEP_SHARE = 0.5
# No tracker has less error; the fit of a logarithm needs a positive start.
_LEAST = 1e-5


@dataclass(frozen=True)
class TrackJumps:
    """Jumps of a track: frames far from the position interpolated between frames before and after.

    Attributes:
        durations_s: Of each, shape (K,), seconds; 0 for a single frame.
        sizes: Root mean square of each on each axis, in the unit of the values, shape (K, A).
    """

    durations_s: FloatArray
    sizes: FloatArray


@dataclass(frozen=True)
class Errors:
    """Errors of groups of axes.

    Attributes:
        groups: One fit a group.
        hidden: Groups whose white error is lost in the person's motion or smoothed away by the tracker; its value is
            then an upper bound.
        jumps: What was left out of the fits.
        used_s: Seconds that were used.
    """

    groups: tuple[GroupFit, ...]
    hidden: tuple[bool, ...]
    jumps: TrackJumps
    used_s: float


def measure_errors(
    data: Stretches, groups: tuple[tuple[int, ...], ...], one_person: bool, tell: Callable[[float], None]
) -> Errors:
    """Fit errors, leave jumps out, and fit again.

    Args:
        data: Stretches of the track.
        groups: Axes that share their errors.
        one_person: Whether the person's acceleration is alike on all axes.
        tell: Called with the share that is done, 0 to 1.

    Returns:
        Errors and jumps.
    """
    rough = np.array([_third_differences(data, group) for group in groups])
    start, used = rough, data.used
    for k in range(_ROUNDS):
        tell(k / _ROUNDS)
        fits, model = fit_errors(replace(data, used=used), groups, one_person, start)
        sizes = np.abs(np.nan_to_num(likelihood(data, model, _GATE).surprise)).max(axis=1)
        calm = data.used & ~_jumps_in(data, data.used & (sizes > _GATE))
        start = np.maximum([fit.white.value for fit in fits], _LEAST)
        if (calm == used).all():
            break
        used = calm
    hidden = tuple(
        fit.wander is None and fit.white.value < _HIDDEN * most for fit, most in zip(fits, rough, strict=True)
    )
    fits = tuple(
        replace(fit, white=Known(float(most), 0.0)) if hides else fit
        for fit, most, hides in zip(fits, rough, hidden, strict=True)
    )
    return Errors(fits, hidden, _jumps(data, used), float(data.intervals_s[data.used].sum()))


def _third_differences(data: Stretches, group: tuple[int, ...]) -> float:
    """White error plus the fast part of the person's motion. The median ignores jumps."""
    found = []
    for b in range(data.used.shape[1]):
        values = data.values[data.used[:, b]][:, list(group), b]
        found.append(np.abs(np.diff(values, 3, axis=0)).ravel())
    return max(_LEAST, 1.4826 * float(np.median(np.concatenate(found))) / math.sqrt(_THIRD_DIFFERENCES))


def _jumps_in(data: Stretches, odd: BoolArray) -> BoolArray:
    """Which odd frames are in jumps, reached in one step, shape (F, B). The others are the person's motion."""
    jumps = odd.copy()
    for b in range(odd.shape[1]):
        aside = np.abs(_aside(data, odd, b))
        for first, last in runs(odd[: len(aside), b]):
            way = aside[first:last].max(axis=0)
            axis = int(np.argmax(way))
            # After a jump the filter needs time to accept the track again. Frames back on the track are no part of it.
            there = aside[first:last, axis] >= _STEP_SHARE * way[axis]
            jumps[first:last, b] = there & there[0]
    return jumps


def _aside(data: Stretches, out: BoolArray, b: int) -> FloatArray:
    """Distance of each frame of a stretch from the path interpolated between the kept frames, shape (F, A)."""
    frames = int(data.used[:, b].sum())
    kept = ~out[:frames, b]
    times_s, values = np.cumsum(data.intervals_s[:frames, b]), data.values[:frames, :, b]
    if not kept.any():
        return np.zeros_like(values)
    expected = [np.interp(times_s, times_s[kept], column[kept]) for column in values.T]
    return np.asarray(values - np.transpose(expected))


def _jumps(data: Stretches, used: BoolArray) -> TrackJumps:
    durations_s: list[float] = []
    sizes: list[FloatArray] = []
    for b in range(used.shape[1]):
        aside = _aside(data, ~used, b)
        times_s = np.cumsum(data.intervals_s[: len(aside), b])
        for first, last in runs(~used[: len(aside), b]):
            durations_s.append(float(times_s[last - 1] - times_s[first]))
            sizes.append(np.sqrt((aside[first:last] ** 2).mean(axis=0)))
    return TrackJumps(np.array(durations_s), np.reshape(sizes, (-1, data.values.shape[1])))
