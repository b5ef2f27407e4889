"""Excitation for the identification of dead time and servo: steps of several sizes, then a band-limited multisine."""

from __future__ import annotations

import math
from itertools import cycle
from typing import Literal

import numpy as np
from pydantic import Field

from gazempc.errors import SettingsError
from gazempc.neck.spec import NeckSpec
from gazempc.robots.robot import move_rad, stop_trajectory
from gazempc.settings import Settings
from gazempc.types import FloatArray

ExcitedAxes = tuple[Literal["all", "pan", "tilt", "eye_pan", "eye_tilt", "body_yaw"], ...]

# Share of the command limits in use: limits of an unidentified neck may be optimistic.
_MARGIN = 0.9
# Targets of the steps, in amplitudes: all sizes, both directions.
_TARGETS = (1.0, 0.0, -0.5, 0.5, -1.0, -0.75, 0.25, 0.0)
_LOWEST_HZ, _HIGHEST_HZ = 0.2, 3.0


class ExcitationSettings(Settings):
    """Parameters of the excitation."""

    axes: ExcitedAxes = Field(
        default=("all",),
        min_length=1,
        description="all joints, or the named ones; the others keep their values of the neck file",
    )
    duration_s: float = Field(default=24.0, ge=8, le=300, description="Length of the motion of an axis")
    amplitude_deg: float = Field(default=20.0, gt=0, le=90, description="Largest angle from the middle of the motion")
    seed: int = Field(default=0, ge=0, description="Seed of the times of the steps and the phases of the sines")


def excite(neck: NeckSpec, start_rad: FloatArray, settings: ExcitationSettings) -> FloatArray:
    """Plan the motion.

    Velocity, acceleration and jerk stay within 0.9 of `NeckSpec.command_limits`, and so does the position once inside
    them; amplitudes are reduced if limits are tight.

    Args:
        neck: The neck with limits and servo rate.
        start_rad: Initial command, at rest, shape (N,), radians.
        settings: Joints, duration, amplitude and seed.

    Returns:
        Angles of all joints, one row per servo period, shape (K, N), radians: from the start to the middle of the
        motion, the motion, and back to rest in the middle.

    Raises:
        SettingsError: If the neck has no such joint.
    """
    moving, limits = moving_joints(neck, settings.axes), neck.command_limits
    samples = round(settings.duration_s * neck.servo_rate_hz)
    # The rest after the motion is longer than any plausible dead time, to record the response to the last command.
    rests = [round(rest_s * neck.servo_rate_hz) for rest_s in (1.0, 1.5)]
    columns = []
    for axis, name in enumerate(neck.joint_names):
        start = centre = float(start_rad[axis])
        motion = np.zeros(samples)
        if name in moving:
            low, high = float(limits.position_min_rad[axis]), float(limits.position_max_rad[axis])
            amplitude = min(math.radians(settings.amplitude_deg), 0.5 * _MARGIN * (high - low))
            # Centre of the motion: as near to the rest angle as the amplitude allows.
            centre = float(np.clip(neck.rest_rad[axis], low + amplitude, high - amplitude))
            rng = np.random.default_rng([settings.seed, axis])
            steps = _steps(neck, axis, amplitude, samples, rng)
            motion = np.concatenate([steps, _multisine(neck, axis, amplitude, samples - steps.size, rng)])
        # At a reduced speed, as the response is unknown.
        columns.append((_move(neck, axis, start, centre, 0.3), centre + np.pad(motion, rests)))
    # Joints wait for the longest approach.
    waits = max(len(approach) for approach, _ in columns)
    position = [np.concatenate([approach, np.full(waits - len(approach), part[0]), part]) for approach, part in columns]
    return np.stack(position, axis=1)


def moving_joints(neck: NeckSpec, axes: ExcitedAxes) -> tuple[str, ...]:
    """Names of the joints that move.

    Args:
        neck: The neck.
        axes: The choice.

    Returns:
        The names, in the order of `NeckSpec.joint_names`.

    Raises:
        SettingsError: If the neck has no such joint.
    """
    for name in axes:
        if name not in ("all", *neck.joint_names):
            names = ", ".join(neck.joint_names)
            raise SettingsError(f"--axes {name}: neck {neck.name!r} has no such joint; accepted: all, {names}")
    return tuple(name for name in neck.joint_names if name in axes or "all" in axes)


def brake(neck: NeckSpec, last_rad: FloatArray) -> FloatArray:
    """Stop a motion within the limits of velocity, acceleration and jerk.

    Args:
        neck: The neck with limits and servo rate.
        last_rad: The last three commands, one per servo period, shape (3, N), radians.

    Returns:
        The following commands, shape (K, N), radians.
    """
    period_s = neck.servo_period_s
    velocity_rad_s = np.diff(last_rad, axis=0)[-1] / period_s
    acceleration_rad_s2 = np.diff(last_rad, 2, axis=0)[-1] / period_s**2
    stop = stop_trajectory(last_rad[-1], velocity_rad_s, acceleration_rad_s2, neck.command_limits, period_s)
    return np.array([stop.at_time((k + 1) * period_s)[0] for k in range(int(np.ceil(stop.duration / period_s)) + 1)])


def _steps(neck: NeckSpec, axis: int, amplitude: float, samples: int, rng: np.random.Generator) -> FloatArray:
    """Steps around 0, at rest at both ends, in less than half of the samples; shape (K,), radians."""
    # The largest step is 1.5 amplitudes; a longer one would be a slow ramp, with little information.
    while len(_move(neck, axis, 0.0, 1.5 * amplitude, 1.0)) > 1.0 * neck.servo_rate_hz + 1:
        amplitude *= 0.8
    parts: list[FloatArray] = []
    at, count, targets = 0.0, 0, cycle(_TARGETS)
    while True:
        target = amplitude * next(targets)
        hold = np.full(round(rng.uniform(0.25, 0.8) * neck.servo_rate_hz), target)
        step = np.concatenate([_move(neck, axis, at, target, 1.0), hold])
        home = _move(neck, axis, target, 0.0, 1.0)
        if count + len(step) + len(home) > round(0.45 * samples):
            return np.concatenate([*parts, _move(neck, axis, at, 0.0, 1.0)])
        parts.append(step)
        at, count = target, count + len(step)


def _multisine(neck: NeckSpec, axis: int, amplitude: float, samples: int, rng: np.random.Generator) -> FloatArray:
    """A band-limited motion around 0, at rest at both ends; shape (samples,), radians."""
    period_s, limits = neck.servo_period_s, neck.command_limits
    time_s = np.arange(samples) * period_s
    frequency_hz = np.geomspace(_LOWEST_HZ, min(_HIGHEST_HZ, neck.servo_rate_hz / 8), 18)
    phase_rad = rng.uniform(0, 2 * np.pi, frequency_hz.size)
    # Amplitudes proportional to 1/frequency: a flat velocity spectrum.
    waves = np.sin(2 * np.pi * frequency_hz[:, None] * time_s + phase_rad[:, None]) / frequency_hz[:, None]
    taper_s = min(1.0, time_s[-1] / 3)
    ramp = np.clip(np.minimum(time_s, time_s[-1] - time_s) / taper_s, 0.0, 1.0)
    # Three derivatives vanish at both ends of the ramp: continuous jerk.
    shape = waves.sum(axis=0) * ramp**4 * (35 - 84 * ramp + 70 * ramp**2 - 20 * ramp**3)
    # At rest before and after: the differences across the ends count too.
    padded = np.pad(shape, 3)
    bounds = (amplitude, *(_MARGIN * limit[axis] for limit in limits.derivatives))
    peaks = [float(np.abs(np.diff(padded, order)).max()) / period_s**order for order in range(4)]
    return np.asarray(shape * min(bound / peak for bound, peak in zip(bounds, peaks, strict=True)))


def _move(neck: NeckSpec, axis: int, start_rad: float, target_rad: float, speed_share: float) -> FloatArray:
    """Rest to rest as fast as the margin allows; shape (K,) from one period after the start, radians."""
    shares = (speed_share * _MARGIN, _MARGIN, _MARGIN)
    limits = zip(shares, neck.command_limits.derivatives, strict=True)
    each = [share * limit[axis : axis + 1] for share, limit in limits]
    return move_rad(np.array([start_rad]), np.array([target_rad]), each, neck)[:, 0]
