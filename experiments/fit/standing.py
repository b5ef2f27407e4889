"""People who stand: variants of recorded ones, and the idle motion of a person before a walk and after it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from experiments.fit.variants import GaplessWalk, mirror, smooth_step
from gazempc.types import FloatArray

# Sway: s.d. and correlation time.
_SWAY_M, _SWAY_TIME_S = (0.002, 0.012), (0.5, 1.5)
# Weight shifts (a new place for the head) and fidgets (there and back), as in prolonged standing (Duarte & Zatsiorsky
# 1999); leans of a person who talks, reaches or gestures are larger. Mean intervals are shorter than published ones,
# so that 5 s of an example hold some.
_SHIFT_EVERY_S, _SHIFT_M, _SHIFT_TIME_S = (1.5, 15.0), (0.01, 0.15), (0.5, 1.8)
_LEAN_EVERY_S, _LEAN_M, _LEAN_TIME_S, _HOLD_S = (1.5, 15.0), (0.02, 0.35), (0.4, 1.4), (0.0, 2.0)
# A step aside or back, after which the person stands again.
_STEP_EVERY_S, _STEP_M, _STEP_TIME_S = (3.0, 20.0), (0.1, 0.5), (0.6, 1.4)
# No head on the spot is faster than this at its peak; motion that would be takes longer.
_FASTEST_M_S, _PEAK_OF_SMOOTH_STEP = 0.45, 1.875
# Sitting down, standing up and bending: the head goes down or up, and a little aside.
_RISE_EVERY_S, _RISE_M, _RISE_ASIDE_M, _RISE_TIME_S = (3.0, 20.0), (0.1, 0.5), (0.02, 0.3), (0.8, 2.0)
# A turn on the spot moves the head about an axis beside it.
_TURN_EVERY_S, _TURN_DEG, _TURN_TIME_S, _AXIS_M = (3.0, 20.0), (15.0, 180.0), (0.5, 2.0), (0.0, 0.15)
_GLANCE_EVERY_S, _GLANCE_DEG, _GLANCE_TIME_S = (1.0, 8.0), (10.0, 70.0), (0.3, 0.8)
_GLANCE_AXIS_M = 0.06  # the face swings about the neck
# Variants of recorded people: their motion is played faster or slower, larger or smaller.
_PACE, _SIZE, _LONGEST_S = (0.7, 1.35), (0.4, 1.5), 6.0
_YAW_OFFSET_SD_DEG = 6.0


@dataclass(frozen=True)
class Idle:
    """RegimeMotion on the spot.

    Attributes:
        head_m: Displacement of the head, shape (N, 3), metres.
        pelvis_yaw_rad: Rotation of the pelvis, shape (N,).
        head_yaw_rad: Rotation of the head, shape (N,).
    """

    head_m: FloatArray
    pelvis_yaw_rad: FloatArray
    head_yaw_rad: FloatArray


def idle(n: int, step_s: float, rng: np.random.Generator) -> Idle:
    """RegimeMotion of a person who stays: sway, weight shifts, steps, leans, sitting down, turns, glances.

    Args:
        n: Number of frames.
        step_s: Time between them, seconds.
        rng: Draws all of it.

    Returns:
        The motion.
    """
    t: FloatArray = np.arange(n, dtype=np.float64) * step_s
    head, pelvis_yaw, head_yaw = sway(n, step_s, rng), np.zeros(n), np.zeros(n)
    if rng.random() < 0.4:
        for at_s in _events(t, _SHIFT_EVERY_S, rng):
            step_m = _direction(rng, _SHIFT_M)
            head += smooth_step((t - at_s) / _slow_enough(rng.uniform(*_SHIFT_TIME_S), step_m))[:, None] * step_m
    if rng.random() < 0.12:
        for at_s in _events(t, _STEP_EVERY_S, rng):
            step_m = _direction(rng, _STEP_M)
            head += smooth_step((t - at_s) / _slow_enough(rng.uniform(*_STEP_TIME_S), step_m))[:, None] * step_m
    if rng.random() < 0.3:
        for at_s in _events(t, _LEAN_EVERY_S, rng):
            step_m = _direction(rng, _LEAN_M)
            step_m[2] -= 0.4 * np.linalg.norm(step_m) * rng.random()  # a lean lowers the head
            out_s, back_s = (_slow_enough(rng.uniform(*_LEAN_TIME_S), step_m) for _ in range(2))
            until_s = at_s + out_s + rng.uniform(*_HOLD_S)
            there = smooth_step((t - at_s) / out_s) - smooth_step((t - until_s) / back_s)
            head += there[:, None] * step_m
    if rng.random() < 0.2:
        up = rng.choice([-1.0, 1.0])
        for at_s in _events(t, _RISE_EVERY_S, rng):
            step_m = _direction(rng, _RISE_ASIDE_M)
            step_m[2] = up * rng.uniform(*_RISE_M)
            head += smooth_step((t - at_s) / rng.uniform(*_RISE_TIME_S))[:, None] * step_m
            up = -up  # down again, or up
    if rng.random() < 0.35:
        for at_s in _events(t, _TURN_EVERY_S, rng):
            time_s = rng.uniform(*_TURN_TIME_S)
            angle = np.radians(rng.uniform(*_TURN_DEG)) * rng.choice([-1.0, 1.0])
            turned = angle * smooth_step((t - at_s) / time_s)
            pelvis_yaw += turned
            head_yaw += angle * smooth_step((t - at_s + rng.uniform(0.0, 0.3)) / time_s)
            head += _about_axis(turned, rng.uniform(*_AXIS_M), rng)
    if rng.random() < 0.5:
        for at_s in _events(t, _GLANCE_EVERY_S, rng):
            time_s, until_s = rng.uniform(*_GLANCE_TIME_S), at_s + rng.uniform(0.5, 3.0)
            angle = np.radians(rng.uniform(*_GLANCE_DEG)) * rng.choice([-1.0, 1.0])
            turned = angle * (smooth_step((t - at_s) / time_s) - smooth_step((t - until_s) / time_s))
            head_yaw += turned
            head += _about_axis(turned, rng.uniform(0.0, _GLANCE_AXIS_M), rng)
    return Idle(head, pelvis_yaw, head_yaw)


def sway(n: int, step_s: float, rng: np.random.Generator) -> FloatArray:
    """Sway of a person who stands, shape (N, 3), metres."""
    sd_m, time_s = rng.uniform(*_SWAY_M), rng.uniform(*_SWAY_TIME_S)
    found = gaussian_filter1d(rng.standard_normal((n + 200, 3)), time_s / step_s / 2, axis=0)[100 : 100 + n]
    found *= sd_m / max(float(found.std()), 1e-9)
    found[:, 2] *= 0.2
    return np.asarray(found)


def vary_standing(walk: GaplessWalk, rng: np.random.Generator) -> GaplessWalk:
    """A variant of a recorded person who stands: another pace and size of motion, mirrored, other yaw offsets.

    Args:
        walk: The recorded motion.
        rng: Draws all of it.

    Returns:
        The variant, at most 6 s long.
    """
    t = walk.times_s - walk.times_s[0]
    step_s = float(np.median(np.diff(t)))
    rate = float(np.exp(rng.uniform(*np.log(_PACE))))
    n = min(round(_LONGEST_S / step_s), int(t[-1] / rate / step_s)) + 1
    played = rng.uniform(0.0, max(t[-1] - rate * (n - 1) * step_s, 0.0)) + rate * step_s * np.arange(n)
    played = np.minimum(played, t[-1])
    mean = walk.head_m.mean(axis=0)
    size = float(np.exp(rng.uniform(*np.log(_SIZE))))
    offsets = np.radians(_YAW_OFFSET_SD_DEG) * rng.standard_normal(2)
    varied = GaplessWalk(
        walk.times_s[0] + step_s * np.arange(n),
        mean + size * (CubicSpline(t, walk.head_m)(played) - mean),
        np.interp(played, t, walk.pelvis_yaw_rad) + offsets[0],
        np.interp(played, t, walk.head_yaw_rad) + offsets[1],
    )
    return mirror(varied) if rng.random() < 0.5 else varied


def _events(t: FloatArray, every_s: tuple[float, float], rng: np.random.Generator) -> FloatArray:
    interval_s = rng.uniform(*every_s)
    count = rng.poisson((t[-1] - t[0] + 1.0) / interval_s)
    return np.sort(rng.uniform(t[0] - 1.0, t[-1], size=count))


def _direction(rng: np.random.Generator, size_m: tuple[float, float]) -> FloatArray:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    size = float(np.exp(rng.uniform(*np.log(size_m))))
    return size * np.array([np.cos(angle), np.sin(angle), 0.2 * rng.standard_normal()])


def _slow_enough(time_s: float, step_m: FloatArray) -> float:
    return max(time_s, _PEAK_OF_SMOOTH_STEP * float(np.linalg.norm(step_m)) / _FASTEST_M_S)


def _about_axis(turned_rad: FloatArray, axis_m: float, rng: np.random.Generator) -> FloatArray:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    c, s = np.cos(angle + turned_rad) - np.cos(angle), np.sin(angle + turned_rad) - np.sin(angle)
    return axis_m * np.stack([c, s, np.zeros_like(c)], axis=1)
