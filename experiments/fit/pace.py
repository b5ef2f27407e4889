"""Augmentation: walks at other speeds, starts, stops, and synthetic or varied motion of standing people."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from experiments.fit.variants import PEAK_OF_SMOOTH_STEP, GaplessWalk, log_uniform, mirror, smooth_step
from gazempc.types import FloatArray

# Range of target speeds; slower motion is a start or a stop, faster motion is running.
_SPEED_M_S = (0.3, 2.0)
# Walking speed of starts and stops; slower motion is a lean or a step aside.
_STARTING_M_S = (0.6, 1.9)
# Durations of starts and stops, shorter than published ones: longer ones increase contact with starting and stopping
# people and reduce it with walking people (`docs/predictors.md`).
_RAMP_S = (0.4, 1.3)
_CHANGES_AT_S = (0.6, 3.5)
_LONGEST_S = 5.0
# Range of the playback rate; gait is not realistic beyond it.
_RATE = (0.0, 2.2)
_SLOWEST_OWN_M_S = 0.4
_STRIDE_SD_S = 0.3  # of the Gaussian window over which the speed is averaged: about a stride, to retain gait
# Overlap over which two stretches of gait are matched and cross-faded.
_JOIN_S = 0.3


def at_pace(walk: GaplessWalk, kind: str, rng: np.random.Generator) -> GaplessWalk:
    """Time-warp a walk to another speed profile.

    Args:
        walk: The walk.
        kind: ``steady``, ``start``, ``stop`` or ``stand``.
        rng: Random generator.

    Returns:
        The walk, at most 5 s long.
    """
    t = walk.times_s - walk.times_s[0]
    step_s = float(np.median(np.diff(t)))
    velocity = gaussian_filter1d(np.gradient(walk.head_m[:, :2], t, axis=0), _STRIDE_SD_S / step_s, axis=0)
    own = np.maximum(np.linalg.norm(velocity, axis=1), _SLOWEST_OWN_M_S)
    new_s = np.arange(0.0, _LONGEST_S, step_s)
    speed = _profile(kind, new_s, rng)
    warp_s = np.empty(new_s.size)
    warp_s[0] = rng.uniform(0.0, 0.3) * t[-1] if kind in {"start", "stand"} else 0.0
    n = new_s.size
    for k in range(1, n):
        rate = np.clip(speed[k] / np.interp(warp_s[k - 1], t, own), *_RATE)
        warp_s[k] = warp_s[k - 1] + rate * step_s
        if warp_s[k] > t[-1]:
            n = k
            break
    warp_s = warp_s[:n]
    # Weight of the idle motion: 1 up to 0.3 m/s, 0 from 0.6 m/s, smooth between.
    blend = smooth_step(2.0 - speed[:n, None] / _SPEED_M_S[0])
    still = idle(n, step_s, rng)
    if kind == "stop":  # continuous at the start of the idle motion
        start = int(np.argmax(blend[:, 0] > 0.0))
    else:  # continuous at the end of the idle motion
        start = int(np.flatnonzero(blend[:, 0] > 0.0)[-1]) if np.any(blend > 0.0) else 0
    head = CubicSpline(t, walk.head_m)(warp_s) + blend * (still.head_m - still.head_m[start])
    return GaplessWalk(
        walk.times_s[0] + new_s[:n],
        head,
        np.interp(warp_s, t, walk.pelvis_yaw_rad) + blend[:, 0] * (still.pelvis_yaw_rad - still.pelvis_yaw_rad[start]),
        np.interp(warp_s, t, walk.head_yaw_rad) + blend[:, 0] * (still.head_yaw_rad - still.head_yaw_rad[start]),
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
    """Extend a straight walk: its gait is repeated along the path, joined at the best match.

    Args:
        walk: A straight walk.
        duration_s: Desired duration, seconds.

    Returns:
        The extended walk; unchanged if it is long enough, or too short to join.
    """
    t = walk.times_s - walk.times_s[0]
    step_s = float(np.median(np.diff(t)))
    n, join = t.size, max(2, round(_JOIN_S / step_s))
    wanted = round(duration_s / step_s) + 1
    if wanted <= n or n < 4 * join:
        return walk
    fifth = max(1, n // 5)
    slope = np.polyfit(t[fifth:-fifth], walk.head_m[fifth:-fifth], 1)[0]
    # Gait: residual of a quadratic fit in time.
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
    trend = walk.head_m.mean(axis=0) + (new_s[:, None] - t.mean()) * slope * [1.0, 1.0, 0.0]
    return GaplessWalk(
        walk.times_s[0] + new_s,
        trend + long[:, :3],
        walk.pelvis_yaw_rad.mean() + long[:, 3],
        walk.head_yaw_rad.mean() + long[:, 4],
    )


def sway(walk: GaplessWalk, factor: float) -> GaplessWalk:
    """Scale the horizontal gait, the deviation from the path averaged over a stride, by a factor.

    Within a stride of the ends the average lags or leads the path, so the speed is scaled there, too.

    Args:
        walk: The walk.
        factor: Factor of the amplitude.

    Returns:
        The variant.
    """
    step_s = float(np.median(np.diff(walk.times_s)))
    path = gaussian_filter1d(walk.head_m[:, :2], _STRIDE_SD_S / step_s, axis=0, mode="nearest")
    head = walk.head_m.copy()
    head[:, :2] = path + factor * (walk.head_m[:, :2] - path)
    return GaplessWalk(walk.times_s, head, walk.pelvis_yaw_rad, walk.head_yaw_rad)


def flatten(walk: GaplessWalk) -> GaplessWalk:
    """The walk at constant height, as measured by a planar tracker."""
    head = walk.head_m.copy()
    head[:, 2] = head[:, 2].mean()
    return GaplessWalk(walk.times_s, head, walk.pelvis_yaw_rad, walk.head_yaw_rad)


# Sway: s.d. and correlation time.
_SWAY_M, _SWAY_TIME_S = (0.002, 0.012), (0.5, 1.5)
# Share of people with a larger sway, who shift weight from foot to foot or step on the spot as they gesture, with turns
# of pelvis and head. Yaws are nominal: clips of few correlation times have up to three times as much. Share and size
# were chosen on the recorded person who directs traffic (held out), and on walking people.
_LARGE_SHARE, _LARGE_SWAY_M, _LARGE_SWAY_TIME_S, _LARGE_YAW_DEG = 0.6, (0.03, 0.2), (0.5, 1.5), (2.0, 20.0)
# Largest ratio of its s.d. to its correlation time: velocity s.d. up to 0.21 m/s on each axis, peaks above 1 m/s.
_SWAY_SPEED_M_S = 0.15
_MARGIN = 100  # frames cut off at each end, where the Gaussian filter reflects the noise
# Weight shifts (persistent displacement) and fidgets (out and back), as in prolonged standing (Duarte & Zatsiorsky
# 1999); leans while talking, reaching or gesturing are larger. Mean intervals are shorter than published ones, so that
# an example of 5 s contains some.
_SHIFT_EVERY_S, _SHIFT_M, _SHIFT_TIME_S = (1.5, 15.0), (0.01, 0.15), (0.5, 1.8)
_LEAN_EVERY_S, _LEAN_M, _LEAN_TIME_S, _HOLD_S = (1.5, 15.0), (0.02, 0.35), (0.4, 1.4), (0.0, 2.0)
# A step aside or back, after which the person stands again.
_STEP_EVERY_S, _STEP_M, _STEP_TIME_S = (3.0, 20.0), (0.1, 0.5), (0.6, 1.4)
# Peak speed of a standing person's head: faster displacements are slowed down to it.
_FASTEST_M_S = 0.45
# Sitting down, standing up and bending: vertical displacement, with a small horizontal one.
_RISE_EVERY_S, _RISE_M, _RISE_ASIDE_M, _RISE_TIME_S = (3.0, 20.0), (0.1, 0.5), (0.02, 0.3), (0.8, 2.0)
# A turn on the spot rotates the head about an axis at this distance.
_TURN_EVERY_S, _TURN_DEG, _TURN_TIME_S, _AXIS_M = (3.0, 20.0), (15.0, 180.0), (0.5, 2.0), (0.0, 0.15)
_GLANCE_EVERY_S, _GLANCE_DEG, _GLANCE_TIME_S = (1.0, 8.0), (10.0, 70.0), (0.3, 0.8)
_GLANCE_AXIS_M = 0.06  # from the neck's axis to the face
# Variants of recorded standing people: ranges of playback rate and amplitude, and duration.
_PACE, _SIZE, _LONGEST_STANDING_S = (0.7, 1.35), (0.4, 1.5), 6.0
_YAW_OFFSET_SD_DEG = 6.0


def idle(n: int, step_s: float, rng: np.random.Generator) -> GaplessWalk:
    """Synthetic motion of a standing person: sway, weight shifts, steps, leans, sitting down, turns, glances.

    Args:
        n: Number of frames.
        step_s: Frame interval, seconds.
        rng: Random generator.

    Returns:
        The motion about the origin: `n` frames from time 0.
    """
    t: FloatArray = np.arange(n, dtype=np.float64) * step_s
    head, pelvis_yaw, head_yaw = _sway_of_standing(n, step_s, rng)
    for share, every_s, size_m, takes_s in (
        (0.4, _SHIFT_EVERY_S, _SHIFT_M, _SHIFT_TIME_S),
        (0.12, _STEP_EVERY_S, _STEP_M, _STEP_TIME_S),
    ):
        for at_s in _events(t, every_s, rng) if rng.random() < share else ():
            step_m = _direction(rng, size_m)
            head += smooth_step((t - at_s) / _bounded_duration_s(rng.uniform(*takes_s), step_m))[:, None] * step_m
    for at_s in _events(t, _LEAN_EVERY_S, rng) if rng.random() < 0.3 else ():
        step_m = _direction(rng, _LEAN_M)
        step_m[2] -= 0.4 * np.linalg.norm(step_m) * rng.random()  # a lean lowers the head
        out_s, back_s = (_bounded_duration_s(rng.uniform(*_LEAN_TIME_S), step_m) for _ in range(2))
        until_s = at_s + out_s + rng.uniform(*_HOLD_S)
        there = smooth_step((t - at_s) / out_s) - smooth_step((t - until_s) / back_s)
        head += there[:, None] * step_m
    if rng.random() < 0.2:
        up = rng.choice([-1.0, 1.0])
        for at_s in _events(t, _RISE_EVERY_S, rng):
            step_m = _direction(rng, _RISE_ASIDE_M)
            step_m[2] = up * rng.uniform(*_RISE_M)
            head += smooth_step((t - at_s) / rng.uniform(*_RISE_TIME_S))[:, None] * step_m
            up = -up
    for at_s in _events(t, _TURN_EVERY_S, rng) if rng.random() < 0.35 else ():
        time_s = rng.uniform(*_TURN_TIME_S)
        angle = np.radians(rng.uniform(*_TURN_DEG)) * rng.choice([-1.0, 1.0])
        turned = angle * smooth_step((t - at_s) / time_s)
        pelvis_yaw += turned
        head_yaw += angle * smooth_step((t - at_s + rng.uniform(0.0, 0.3)) / time_s)
        head += _about_axis(turned, rng.uniform(*_AXIS_M), rng)
    for at_s in _events(t, _GLANCE_EVERY_S, rng) if rng.random() < 0.5 else ():
        time_s, until_s = rng.uniform(*_GLANCE_TIME_S), at_s + rng.uniform(0.5, 3.0)
        angle = np.radians(rng.uniform(*_GLANCE_DEG)) * rng.choice([-1.0, 1.0])
        turned = angle * (smooth_step((t - at_s) / time_s) - smooth_step((t - until_s) / time_s))
        head_yaw += turned
        head += _about_axis(turned, rng.uniform(0.0, _GLANCE_AXIS_M), rng)
    return GaplessWalk(t, head, pelvis_yaw, head_yaw)


def _sway_of_standing(n: int, step_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sway of a standing person: head position, shape (N, 3), metres, and yaws of pelvis and head, radians."""
    sd_m, time_s, yaws_rad = rng.uniform(*_SWAY_M), rng.uniform(*_SWAY_TIME_S), np.zeros(2)
    if rng.random() < _LARGE_SHARE:
        sd_m = log_uniform(rng, *_LARGE_SWAY_M)
        time_s = max(rng.uniform(*_LARGE_SWAY_TIME_S), sd_m / _SWAY_SPEED_M_S)
        yaws_rad = np.radians(rng.uniform(*_LARGE_YAW_DEG, size=2))
    noise = rng.standard_normal((n + 2 * _MARGIN, 5))
    found = gaussian_filter1d(noise, time_s / step_s / 2, axis=0)[_MARGIN : _MARGIN + n]
    found *= [sd_m, sd_m, 0.2 * sd_m, *yaws_rad] / np.maximum(found[:, :3].std(), 1e-9)
    return found[:, :3], found[:, 3], found[:, 4]


def vary_standing(walk: GaplessWalk, rng: np.random.Generator) -> GaplessWalk:
    """Random variant of a recorded standing person: rate and amplitude of the motion, reflection, yaw offsets.

    Args:
        walk: The recorded motion.
        rng: Random generator.

    Returns:
        The variant, at most 6 s long.
    """
    t = walk.times_s - walk.times_s[0]
    step_s = float(np.median(np.diff(t)))
    rate = log_uniform(rng, *_PACE)
    n = min(round(_LONGEST_STANDING_S / step_s), int(t[-1] / rate / step_s)) + 1
    warp_s = rng.uniform(0.0, max(t[-1] - rate * (n - 1) * step_s, 0.0)) + rate * step_s * np.arange(n)
    warp_s = np.minimum(warp_s, t[-1])
    mean = walk.head_m.mean(axis=0)
    size = log_uniform(rng, *_SIZE)
    offsets = np.radians(_YAW_OFFSET_SD_DEG) * rng.standard_normal(2)
    varied = GaplessWalk(
        walk.times_s[0] + step_s * np.arange(n),
        mean + size * (CubicSpline(t, walk.head_m)(warp_s) - mean),
        np.interp(warp_s, t, walk.pelvis_yaw_rad) + offsets[0],
        np.interp(warp_s, t, walk.head_yaw_rad) + offsets[1],
    )
    return mirror(varied) if rng.random() < 0.5 else varied


def _events(t: FloatArray, every_s: tuple[float, float], rng: np.random.Generator) -> FloatArray:
    interval_s = rng.uniform(*every_s)
    count = rng.poisson((t[-1] - t[0] + 1.0) / interval_s)
    return np.sort(rng.uniform(t[0] - 1.0, t[-1], size=count))


def _direction(rng: np.random.Generator, size_m: tuple[float, float]) -> FloatArray:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    size = log_uniform(rng, *size_m)
    return size * np.array([np.cos(angle), np.sin(angle), 0.2 * rng.standard_normal()])


def _bounded_duration_s(time_s: float, step_m: FloatArray) -> float:
    return max(time_s, PEAK_OF_SMOOTH_STEP * float(np.linalg.norm(step_m)) / _FASTEST_M_S)


def _about_axis(turned_rad: FloatArray, axis_m: float, rng: np.random.Generator) -> FloatArray:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    c, s = np.cos(angle + turned_rad) - np.cos(angle), np.sin(angle + turned_rad) - np.sin(angle)
    return axis_m * np.stack([c, s, np.zeros_like(c)], axis=1)
