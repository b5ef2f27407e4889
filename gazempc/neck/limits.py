"""Limits of a neck for a run: a reduced range and speed, and human-like motion.

Human-like motion: in a time-optimal motion over an angle A, a joint with acceleration limit a and servo lag T has about
the peak velocity v with ``A = v (v / a + T)``. So an empirical law of human peak velocities gives the acceleration
limit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import numpy as np

from gazempc.errors import SettingsError
from gazempc.neck.picture import FramedPicture, Framing
from gazempc.neck.spec import Axis, Eyes, NeckSpec

Motion = Literal["robot", "human"]
MOTION_MEANS = "robot: the neck's own limits; human: limits with which head and eyes move like people's"

# Head contribution to a gaze shift, sideways, up and down.
HEAD_SHARE_PAN, HEAD_SHARE_UP, HEAD_SHARE_DOWN = 0.69, 0.52, 0.08
# Guitton & Volle (1987): slope and intercept of the head's peak velocity in deg/s over its amplitude in degrees.
HEAD_VELOCITY_1_S, HEAD_VELOCITY_DEG_S = 4.39, 106.0
# Baloh et al. (1975): peak velocity of the eye in deg/s = first * (1 - exp(-amplitude / second)), amplitude in degrees.
EYE_VELOCITY_DEG_S, EYE_AMPLITUDE_DEG = 551.0, 14.0

# Amplitudes at which the laws are met: of the head in gaze shifts of 30 and 70 deg, and of the eye.
_HEAD_BETWEEN_RAD = tuple(math.radians(HEAD_SHARE_PAN * shift_deg) for shift_deg in (30.0, 70.0))
_EYE_BETWEEN_RAD = tuple(map(math.radians, (10.0, 25.0)))


def head_velocity_rad_s(amplitude_rad: float) -> float:
    """Peak velocity of a person's head in a gaze shift.

    Args:
        amplitude_rad: Amplitude of the head, radians.

    Returns:
        rad/s.
    """
    return HEAD_VELOCITY_1_S * amplitude_rad + math.radians(HEAD_VELOCITY_DEG_S)


def eye_velocity_rad_s(amplitude_rad: float) -> float:
    """Peak velocity of a person's eye in a saccade, the main sequence.

    Args:
        amplitude_rad: Amplitude of the eye in the head, radians.

    Returns:
        rad/s.
    """
    return math.radians(EYE_VELOCITY_DEG_S) * -math.expm1(-amplitude_rad / math.radians(EYE_AMPLITUDE_DEG))


def motor_scale(axis: Axis) -> float:
    """Scale of human head velocities for a motor, at most 1.

    Args:
        axis: A joint of the head.

    Returns:
        Factor of the velocity.
    """
    reached = (min(_peak_rad_s(axis, amplitude), axis.velocity_max_rad_s) for amplitude in _HEAD_BETWEEN_RAD)
    shares = (v / head_velocity_rad_s(amplitude) for v, amplitude in zip(reached, _HEAD_BETWEEN_RAD, strict=True))
    return min(1.0, *shares)


def with_motion(neck: NeckSpec, motion: Motion) -> NeckSpec:
    """The neck with the limits and head contributions of a kind of motion.

    Args:
        neck: The neck.
        motion: ``robot`` for the neck unchanged, ``human`` for human-like contributions of head and eyes.

    Returns:
        The neck; no limit is increased.

    Raises:
        SettingsError: If motion is ``human`` and the neck has no eyes.
    """
    if motion == "robot":
        return neck
    if neck.eyes is None:
        raise SettingsError(f"--motion human: neck {neck.name!r} has no eyes that turn; accepted: --motion robot")
    # One scale for both joints: straight oblique shifts.
    scale = min(motor_scale(neck.pan), motor_scale(neck.tilt))

    def head(amplitude_rad: float) -> float:
        return scale * head_velocity_rad_s(amplitude_rad)

    eyes = Eyes(
        pan=_by_law(neck.eyes.pan, eye_velocity_rad_s, _EYE_BETWEEN_RAD),
        tilt=_by_law(neck.eyes.tilt, eye_velocity_rad_s, _EYE_BETWEEN_RAD),
        head_share_pan=HEAD_SHARE_PAN,
        head_share_up=HEAD_SHARE_UP,
        head_share_down=HEAD_SHARE_DOWN,
    )
    pan, tilt = (_by_law(axis, head, _HEAD_BETWEEN_RAD) for axis in (neck.pan, neck.tilt))
    return neck.model_copy(update={"pan": pan, "tilt": tilt, "eyes": eyes})


def _peak_rad_s(axis: Axis, amplitude_rad: float) -> float:
    """Peak velocity of a joint over an angle, under its acceleration limit."""
    lag_s, most_rad_s2 = axis.servo_lag_s, axis.acceleration_max_rad_s2
    return 0.5 * most_rad_s2 * (math.sqrt(lag_s**2 + 4.0 * amplitude_rad / most_rad_s2) - lag_s)


def _by_law(axis: Axis, velocity_rad_s: Callable[[float], float], between_rad: tuple[float, ...]) -> Axis:
    """The joint with the limits of an empirical law of peak velocities; no limit is increased."""
    needed = []
    for amplitude_rad in between_rad:
        peak_rad_s = velocity_rad_s(amplitude_rad)
        ramps_s = amplitude_rad / peak_rad_s - axis.servo_lag_s
        # Acceleration cannot compensate a servo slower than the law.
        needed.append(peak_rad_s / ramps_s if ramps_s > 0.0 else math.inf)
    limits = {
        "full_speed_rad_s": axis.full_rad_s,
        "velocity_max_rad_s": min(axis.velocity_max_rad_s, velocity_rad_s(between_rad[-1])),
        "acceleration_max_rad_s2": min(axis.acceleration_max_rad_s2, sum(needed) / len(needed)),
    }
    return axis.model_copy(update=limits)


# Least and greatest pan, least and greatest tilt of the gaze, degrees.
Region = tuple[float, float, float, float]
# Kinematic chains of the gaze, from the base: about the vertical, and up or down.
_CHAINS = (("body_yaw", "pan", "eye_pan"), ("tilt", "eye_tilt"))


def narrowed(
    neck: NeckSpec, gaze_region_deg: Region | None, speed_max_rad_s: float | None, framing: Framing | None = None
) -> NeckSpec:
    """Narrow a neck's limits, for controllers, smoother and robot.

    The width of the region is distributed over the joints of a chain in proportion to their ranges, its offset goes to
    the lowest joint as far as possible: the others keep their middle. The sum of the angles is always in the region.

    Args:
        neck: The neck.
        gaze_region_deg: Least and greatest pan, least and greatest tilt of the gaze, degrees; None for all.
        speed_max_rad_s: Greatest speed of each joint, rad/s; None for the joint's own.
        framing: Limits of acceleration and jerk.

    Returns:
        The neck with all these limits.

    Raises:
        SettingsError: If the region is out of the neck's range.
    """
    picture = None if framing is None else FramedPicture.of(framing, neck)
    neck = neck if picture is None else picture.calmed(neck)
    axes = dict(zip(neck.joint_names, neck.axes, strict=True))
    if speed_max_rad_s is not None:
        for name, axis in axes.items():
            speeds = {"velocity_max_rad_s": min(axis.velocity_max_rad_s, speed_max_rad_s)}
            axes[name] = axis.model_copy(update={**speeds, "full_speed_rad_s": axis.full_rad_s})
    if gaze_region_deg is not None:
        ends_deg = gaze_region_deg[::2], gaze_region_deg[1::2]
        for what, chain, low_deg, high_deg in zip(("pan", "tilt"), _CHAINS, *ends_deg, strict=True):
            joints = {name: axes[name] for name in chain if name in axes}
            axes |= _within(joints, low_deg, high_deg, f"neck {neck.name!r}, {what} of the gaze")
    return neck.with_axes(axes)


def _within(joints: dict[str, Axis], low_deg: float, high_deg: float, what: str) -> dict[str, Axis]:
    least_deg = sum(axis.position_min_deg for axis in joints.values())
    most_deg = sum(axis.position_max_deg for axis in joints.values())
    low_deg, high_deg = max(low_deg, least_deg), min(high_deg, most_deg)
    if low_deg >= high_deg:
        accepted = f"a region within {least_deg:g} to {most_deg:g}, least before greatest"
        raise SettingsError(
            f"loop.gaze_region_deg: {what} would be {low_deg:g} to {high_deg:g} deg; accepted: {accepted}"
        )

    limits = np.array([(axis.position_min_deg, axis.position_max_deg) for axis in joints.values()])
    share = (high_deg - low_deg) / (most_deg - least_deg)
    # Ranges of the upper joints about zero: controllers distribute the gaze over the joints relative to zero.
    middle_deg = np.clip(0.0, limits[:, :1], limits[:, 1:])
    ranges_deg = middle_deg + share * (limits - middle_deg)
    ranges_deg[0] = (low_deg, high_deg) - ranges_deg[1:].sum(axis=0)
    # What exceeds the lowest joint's own limits is distributed over the others.
    beyond_deg = max(ranges_deg[0, 1] - limits[0, 1], 0.0) + min(ranges_deg[0, 0] - limits[0, 0], 0.0)
    ranges_deg[0] -= beyond_deg
    room_deg = (limits - ranges_deg)[1:, int(beyond_deg > 0.0)]
    ranges_deg[1:] += (beyond_deg * room_deg / (room_deg.sum() or 1.0))[:, None]
    return {
        name: axis.model_copy(update={"position_min_deg": low, "position_max_deg": high})
        for (name, axis), (low, high) in zip(joints.items(), ranges_deg.tolist(), strict=True)
    }
