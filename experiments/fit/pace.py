"""Recorded walks at other paces: steady from end to end, starting, stopping, standing."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from experiments.fit.standing import idle
from experiments.fit.variants import GaplessWalk, smooth_step
from gazempc.types import FloatArray

# Of these the target speeds are drawn; slower is a start or a stop, faster is no walk.
_SPEED_M_S = (0.3, 2.0)
# A person who starts or stops walks at a usual speed: slower motion is a lean, or a step aside.
_STARTING_M_S = (0.6, 1.9)
_RAMP_S = (0.4, 1.3)
_CHANGES_AT_S = (0.6, 3.5)
_LONGEST_S = 5.0
# A walk is slowed down and sped up by less than this: beyond it, gait is no gait.
_RATE = (0.0, 2.2)
_SLOWEST_OWN_M_S = 0.4
_STRIDE_SD_S = 0.3  # of the bell over which a walk's own speed is averaged: a stride, so that gait stays
# Over this time two stretches of gait are matched, and faded into each other.
_JOIN_S = 0.3
KINDS = ("own", "steady", "start", "stop", "stand")


def at_pace(walk: GaplessWalk, kind: str, rng: np.random.Generator) -> GaplessWalk:
    """The walk at another pace.

    Args:
        walk: The walk.
        kind: ``steady``, ``start``, ``stop`` or ``stand``.
        rng: Draws speeds and times.

    Returns:
        The walk, at most 5 s long.
    """
    t = walk.times_s - walk.times_s[0]
    step_s = float(np.median(np.diff(t)))
    velocity = gaussian_filter1d(np.gradient(walk.head_m[:, :2], t, axis=0), _STRIDE_SD_S / step_s, axis=0)
    own = np.maximum(np.linalg.norm(velocity, axis=1), _SLOWEST_OWN_M_S)
    new_s = np.arange(0.0, _LONGEST_S, step_s)
    speed = _profile(kind, new_s, rng)
    played = np.empty(new_s.size)
    played[0] = rng.uniform(0.0, 0.3) * t[-1] if kind in {"start", "stand"} else 0.0
    n = new_s.size
    for k in range(1, n):
        rate = np.clip(speed[k] / np.interp(played[k - 1], t, own), *_RATE)
        played[k] = played[k - 1] + rate * step_s
        if played[k] > t[-1]:
            n = k
            break
    played = played[:n]
    # Who stands sways; from 0.3 to 0.6 m/s gait takes its place, without a jump.
    sways = smooth_step(2.0 - speed[:n, None] / _SPEED_M_S[0])
    stays = idle(n, step_s, rng)
    if kind == "stop":  # the path ends where the person stands, and the idle motion begins there
        begins = int(np.argmax(sways[:, 0] > 0.0))
    else:  # a start takes the person from where the idle motion ended
        begins = int(np.flatnonzero(sways[:, 0] > 0.0)[-1]) if np.any(sways > 0.0) else 0
    head = CubicSpline(t, walk.head_m)(played) + sways * (stays.head_m - stays.head_m[begins])
    return GaplessWalk(
        walk.times_s[0] + new_s[:n],
        head,
        np.interp(played, t, walk.pelvis_yaw_rad) + sways[:, 0] * (stays.pelvis_yaw_rad - stays.pelvis_yaw_rad[begins]),
        np.interp(played, t, walk.head_yaw_rad) + sways[:, 0] * (stays.head_yaw_rad - stays.head_yaw_rad[begins]),
    )


def _profile(kind: str, t: FloatArray, rng: np.random.Generator) -> FloatArray:
    speed = rng.uniform(*(_STARTING_M_S if kind in {"start", "stop"} else _SPEED_M_S))
    wave = np.sin(2 * np.pi * (t / rng.uniform(2.0, 6.0) + rng.random()))
    steady = np.asarray(speed * np.exp(rng.uniform(0.0, 0.1) * wave))
    if kind == "steady":
        return steady
    if kind == "stand":
        return np.zeros(t.size)
    at_s = rng.uniform(*_CHANGES_AT_S)
    moved = smooth_step((t - at_s) / rng.uniform(*_RAMP_S))
    return steady * (moved if kind == "start" else 1.0 - moved)


def prolong(walk: GaplessWalk, duration_s: float) -> GaplessWalk:
    """A straight walk that goes on: its gait is repeated along its path, joined where it fits best.

    Args:
        walk: A straight walk.
        duration_s: How long it is to be.

    Returns:
        The walk, of that length, or as it was if that is longer.
    """
    t = walk.times_s - walk.times_s[0]
    step_s = float(np.median(np.diff(t)))
    n, join = t.size, max(2, round(_JOIN_S / step_s))
    wanted = round(duration_s / step_s) + 1
    if wanted <= n or n < 4 * join:
        return walk
    fifth = max(1, n // 5)
    slope = np.polyfit(t[fifth:-fifth], walk.head_m[fifth:-fifth], 1)[0]
    # Gait: what a quadratic in time leaves over.
    basis = np.stack([np.ones(n), t, t**2], axis=1)
    rest = np.column_stack([walk.head_m, walk.pelvis_yaw_rad, walk.head_yaw_rad])
    gait = rest - basis @ np.linalg.lstsq(basis, rest, rcond=None)[0]
    scale = gait.std(axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    long = gait.copy()
    while long.shape[0] < wanted:
        end = long[-join:] / scale
        starts = range(0, n // 2)
        best = min(starts, key=lambda k: float(np.sum((gait[k : k + join] / scale - end) ** 2)))
        fade = np.linspace(0.0, 1.0, join)[:, None]
        joined = (1.0 - fade) * long[-join:] + fade * gait[best : best + join]
        long = np.concatenate([long[:-join], joined, gait[best + join :]])
    long = long[:wanted]
    new_s = step_s * np.arange(wanted)
    trend = np.column_stack([walk.head_m.mean(axis=0) + (new_s[:, None] - t.mean()) * slope * [1.0, 1.0, 0.0]])
    return GaplessWalk(
        walk.times_s[0] + new_s,
        trend + long[:, :3],
        walk.pelvis_yaw_rad.mean() + long[:, 3],
        walk.head_yaw_rad.mean() + long[:, 4],
    )


def sway(walk: GaplessWalk, factor: float) -> GaplessWalk:
    """The walk with more or less gait: what departs from the path of a stride is multiplied, horizontally."""
    step_s = float(np.median(np.diff(walk.times_s)))
    path = gaussian_filter1d(walk.head_m[:, :2], _STRIDE_SD_S / step_s, axis=0, mode="nearest")
    head = walk.head_m.copy()
    head[:, :2] = path + factor * (walk.head_m[:, :2] - path)
    return GaplessWalk(walk.times_s, head, walk.pelvis_yaw_rad, walk.head_yaw_rad)


def flatten(walk: GaplessWalk) -> GaplessWalk:
    """The walk as a tracker has it that sees no heights."""
    head = walk.head_m.copy()
    head[:, 2] = head[:, 2].mean()
    return GaplessWalk(walk.times_s, head, walk.pelvis_yaw_rad, walk.head_yaw_rad)
