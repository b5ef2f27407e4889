"""Jumps of a track: frames far from the path between the frames before and after."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gazempc.identify.tracker.likelihood import Stretches
from gazempc.types import BoolArray, FloatArray, IntArray

# Each frame of a jump, also the first, is at least this share of its size away. A person starts to move more slowly.
_STEP_SHARE = 0.5


@dataclass(frozen=True)
class TrackJumps:
    """Jumps of a track: frames far from the position interpolated between the frames before and after.

    Attributes:
        durations_s: Of each, shape (K,), seconds; 0 for a single frame.
        sizes: Root mean square of each on each axis, in the unit of the values, shape (K, A).
    """

    durations_s: FloatArray
    sizes: FloatArray


def runs(flags: BoolArray) -> IntArray:
    """First and one past the last frame of each run of true flags.

    Args:
        flags: Shape (N,).

    Returns:
        Shape (K, 2).
    """
    return np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]]))).reshape(-1, 2)


def jumps_in(data: Stretches, odd: BoolArray) -> BoolArray:
    """Odd frames that belong to jumps; the others are the person's motion.

    Args:
        data: Stretches of the track.
        odd: Frames whose innovation is outside of the gate, shape (F, B).

    Returns:
        Frames of jumps, shape (F, B); a jump is reached in one step.
    """
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


def track_jumps(data: Stretches, used: BoolArray) -> TrackJumps:
    """Durations and sizes of the jumps that a fit leaves out.

    Args:
        data: Stretches of the track.
        used: Frames that the fit uses, shape (F, B).

    Returns:
        One entry for each run of frames that it does not use.
    """
    durations_s: list[float] = []
    sizes: list[FloatArray] = []
    for b in range(used.shape[1]):
        aside = _aside(data, ~used, b)
        times_s = np.cumsum(data.intervals_s[: len(aside), b])
        for first, last in runs(~used[: len(aside), b]):
            durations_s.append(float(times_s[last - 1] - times_s[first]))
            sizes.append(np.sqrt((aside[first:last] ** 2).mean(axis=0)))
    return TrackJumps(np.array(durations_s), np.reshape(sizes, (-1, data.values.shape[1])))
