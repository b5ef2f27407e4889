"""Augmentation of a recorded walk for a fit: turns, reflection, other speeds, glances and stops."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from gazempc.errors import GazempcError
from gazempc.recordings.recording import Recording, stretches
from gazempc.types import FloatArray
from predictors.geometry import yaw_rad

# Human turns are short: 40 degrees in two thirds of a second, 90 in about one; long arcs are rarer.
_TURN_DEG, _TURN_TIME_S, _PEAK_RATE_DEG_S = (15.0, 120.0), (0.5, 2.2), (15.0, 160.0)
# Maximum relative reduction of the speed; measured in 90 degree turns: to 0.6-0.75 of the speed.
_SLOW_DOWN = 0.45
# Lead of the pelvis over the direction of travel, and of the head over the pelvis, seconds; measured: 0.1 to 0.25 s in
# all.
_PELVIS_LEAD_S, _HEAD_LEAD_S = (-0.05, 0.25), (-0.05, 0.2)
# Duration of the turns of pelvis and head as a share of the path's: shorter on average.
_PELVIS_TURN_SHARE, _HEAD_TURN_SHARE = (0.5, 1.05), (0.45, 1.0)
_OFFSET_SD_DEG = (6.0, 3.0)  # of head and pelvis yaw, in addition to the person's own
_GLANCE_DEG, _GLANCE_TIME_S, _GLANCE_RISE_S = (15.0, 60.0), (0.4, 4.0), 0.25
PEAK_OF_SMOOTH_STEP = 1.875  # largest slope of `smooth_step`, 15/8
_SHORTEST_S = 1.25


@dataclass(frozen=True)
class GaplessWalk:
    """Head positions and yaws of one walk, without gaps.

    Attributes:
        times_s: Shape (N,), seconds.
        head_m: Head positions, shape (N, 3), metres.
        pelvis_yaw_rad: Unwrapped, shape (N,), radians.
        head_yaw_rad: Unwrapped, shape (N,), radians.
    """

    times_s: FloatArray
    head_m: FloatArray
    pelvis_yaw_rad: FloatArray
    head_yaw_rad: FloatArray


def walk_of(recording: Recording) -> GaplessWalk:
    """Longest gapless part of a recording.

    Args:
        recording: The recording.

    Returns:
        Its longest stretch without a gap of more than 0.2 s.

    Raises:
        GazempcError: If it is shorter than 1.25 s, or an orientation is missing in a frame.
    """
    truth = recording.truth
    for part, known in (("head", truth.head_quat_wxyz), ("pelvis", truth.pelvis_quat_wxyz)):
        if np.isnan(known[truth.valid]).any():
            raise GazempcError(
                f"{recording.name}: the orientation of the {part} is unknown in some frames; a fit requires "
                "the orientations of head and pelvis"
            )
    rows = max(stretches(recording), key=len)
    times_s = recording.times_s[rows]
    if times_s[-1] - times_s[0] < _SHORTEST_S:
        raise GazempcError(
            f"{recording.name}: longest stretch without a gap {times_s[-1] - times_s[0]:.2f} s; a fit requires "
            f"at least {_SHORTEST_S} s"
        )
    pelvis, head = (
        np.unwrap([yaw_rad(q) for q in quats[rows]]) for quats in (truth.pelvis_quat_wxyz, truth.head_quat_wxyz)
    )
    return GaplessWalk(times_s, truth.head_position_m[rows], pelvis, head)


def vary(walk: GaplessWalk, rng: np.random.Generator, bend_it: bool, varies_pace: bool) -> GaplessWalk:
    """Random variant of a walk.

    Args:
        walk: The recorded walk.
        rng: Random generator.
        bend_it: Whether to add turns.
        varies_pace: Whether the pace is varied at random.

    Returns:
        The variant.
    """
    if varies_pace and rng.random() < 0.35:
        walk = change_pace(walk, rng)
    if bend_it:
        walk = bend(walk, rng)
    head_offset, pelvis_offset = np.radians(_OFFSET_SD_DEG) * rng.standard_normal(2)
    walk = replace(
        walk, head_yaw_rad=walk.head_yaw_rad + head_offset, pelvis_yaw_rad=walk.pelvis_yaw_rad + pelvis_offset
    )
    if rng.random() < 0.5:
        walk = mirror(walk)
    if rng.random() < 0.4:
        walk = glance(walk, rng)
    return walk


def mirror(walk: GaplessWalk) -> GaplessWalk:
    """Left-right reflection."""
    return replace(
        walk,
        head_m=walk.head_m * [1.0, -1.0, 1.0],
        head_yaw_rad=-walk.head_yaw_rad,
        pelvis_yaw_rad=-walk.pelvis_yaw_rad,
    )


def glance(walk: GaplessWalk, rng: np.random.Generator) -> GaplessWalk:
    """Add a temporary head turn, as by people who notice a robot.

    Args:
        walk: The walk.
        rng: Random generator of side, amplitude, start and duration.

    Returns:
        The walk with the glance.
    """
    angle = np.radians(rng.uniform(*_GLANCE_DEG)) * rng.choice([-1.0, 1.0])
    begin_s = rng.uniform(walk.times_s[0] - 1.0, walk.times_s[-1])
    end_s = begin_s + rng.uniform(*_GLANCE_TIME_S)
    share = np.clip((walk.times_s - begin_s) / _GLANCE_RISE_S, 0, 1) * np.clip(
        (end_s - walk.times_s) / _GLANCE_RISE_S, 0, 1
    )
    return replace(walk, head_yaw_rad=walk.head_yaw_rad + angle * share)


def change_pace(walk: GaplessWalk, rng: np.random.Generator) -> GaplessWalk:
    """Time-warp a walk (constant rate, slow modulation, an optional stop) and scale the person's size.

    Args:
        walk: The walk.
        rng: Random generator.

    Returns:
        The variant, at most as long as the walk.
    """
    t = walk.times_s - walk.times_s[0]
    wave = np.sin(2 * np.pi * (t / rng.uniform(2.0, 6.0) + rng.random()))
    rate = rng.uniform(0.8, 1.35) * np.exp(rng.uniform(0.0, 0.12) * wave)
    if rng.random() < 0.2:
        stops_s = rng.uniform(0.5, t[-1] + 0.5)
        rate = rate * (1.0 - smooth_step((t - stops_s) / rng.uniform(0.5, 1.2)) * rng.uniform(0.5, 1.0))
    warp_s = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))])
    n = int(np.searchsorted(warp_s, t[-1], side="right"))
    warp_s = warp_s[:n]
    return GaplessWalk(
        walk.times_s[:n],
        CubicSpline(t, walk.head_m)(warp_s) * rng.uniform(0.9, 1.1),
        np.interp(warp_s, t, walk.pelvis_yaw_rad),
        np.interp(warp_s, t, walk.head_yaw_rad),
    )


def bend(walk: GaplessWalk, rng: np.random.Generator) -> GaplessWalk:
    """Add one or two turns: each displacement, gait included, is rotated by the angle turned so far.

    Pelvis and head lead the path and turn in a shorter time; the walk is slower in the turn.

    Args:
        walk: The walk.
        rng: Random generator of turns, leads and deceleration.

    Returns:
        The walk with turns.
    """
    t = walk.times_s
    # Finer than the frames, and extended at both ends by the leads.
    fine_s = np.arange(t[0] - 1.5, t[-1] + 1.5, 1 / 120)
    path, pelvis, head = np.zeros_like(fine_s), np.zeros_like(fine_s), np.zeros_like(fine_s)
    for _ in range(rng.integers(1, 3)):
        angle_deg, duration_s = _draw_turn(rng)
        angle = np.radians(angle_deg) * rng.choice([-1.0, 1.0])
        middle_s = rng.uniform(t[0], t[-1] + 0.4)
        pelvis_lead_s = rng.uniform(*_PELVIS_LEAD_S)
        head_lead_s = pelvis_lead_s + rng.uniform(*_HEAD_LEAD_S)
        path += angle * smooth_step((fine_s - middle_s) / duration_s + 0.5)
        pelvis_s, head_s = duration_s * rng.uniform(*_PELVIS_TURN_SHARE), duration_s * rng.uniform(*_HEAD_TURN_SHARE)
        pelvis += angle * smooth_step((fine_s - middle_s + pelvis_lead_s) / pelvis_s + 0.5)
        head += angle * smooth_step((fine_s - middle_s + head_lead_s) / head_s + 0.5)
    rate = np.abs(np.gradient(path, fine_s))
    pace = 1.0 - rng.uniform(0.0, _SLOW_DOWN) * np.minimum(rate / np.radians(90.0), 1.0)
    shift_s = rng.uniform(-0.2, 0.2)
    turned, pace = np.interp(t, fine_s, path), np.interp(t + shift_s, fine_s, pace)
    steps = np.diff(walk.head_m[:, :2], axis=0) * (0.5 * (pace[1:] + pace[:-1]))[:, None]
    middle = 0.5 * (turned[1:] + turned[:-1])
    c, s = np.cos(middle), np.sin(middle)
    steps = np.stack([c * steps[:, 0] - s * steps[:, 1], s * steps[:, 0] + c * steps[:, 1]], axis=1)
    horizontal = walk.head_m[0, :2] + np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])
    return GaplessWalk(
        t,
        np.column_stack([horizontal, walk.head_m[:, 2]]),
        walk.pelvis_yaw_rad + np.interp(t, fine_s, pelvis),
        walk.head_yaw_rad + np.interp(t, fine_s, head),
    )


def _draw_turn(rng: np.random.Generator) -> tuple[float, float]:
    while True:
        angle_deg, duration_s = rng.uniform(*_TURN_DEG), rng.uniform(*_TURN_TIME_S)
        if _PEAK_RATE_DEG_S[0] < PEAK_OF_SMOOTH_STEP * angle_deg / duration_s < _PEAK_RATE_DEG_S[1]:
            return float(angle_deg), float(duration_s)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Log-uniform random number between two positive bounds."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def smooth_step(share: FloatArray) -> FloatArray:
    """Minimum-jerk step from 0 to 1 over [0, 1]: zero velocity and acceleration at both ends."""
    u = np.clip(share, 0.0, 1.0)
    return np.asarray(u**3 * (10.0 - 15.0 * u + 6.0 * u**2))
