"""A neck that moves as people do: limits of head and eyes, and the head's share of a gaze.

A joint that is moved over an angle A as fast as its acceleration a allows, and whose servo has the lag T, reaches about
the peak velocity v of ``A = v (v / a + T)``. So a law of the peak velocity of people gives the acceleration.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

from gazempc.errors import SettingsError
from gazempc.neck.spec import Axis, Eyes, NeckSpec

Motion = Literal["robot", "human"]
MOTION_MEANS = "robot: the neck's own limits; human: limits with which head and eyes move like people's"

# Share of the head at the end of a shift of gaze, sideways, up and down.
HEAD_SHARE_PAN, HEAD_SHARE_UP, HEAD_SHARE_DOWN = 0.69, 0.52, 0.08
# Guitton & Volle (1987): peak velocity of the head in deg/s is this times its amplitude in degrees, and this more.
HEAD_VELOCITY_1_S, HEAD_VELOCITY_DEG_S = 4.39, 106.0
# Baloh et al. (1975): peak velocity of the eye in deg/s is this times 1 - exp(-amplitude / this in degrees).
EYE_VELOCITY_DEG_S, EYE_AMPLITUDE_DEG = 551.0, 14.0

# The laws are met between these amplitudes: of the head, as in shifts of gaze of 30 and 70 deg, and of the eye.
_HEAD_BETWEEN_RAD = tuple(math.radians(HEAD_SHARE_PAN * shift_deg) for shift_deg in (30.0, 70.0))
_EYE_BETWEEN_RAD = tuple(map(math.radians, (10.0, 25.0)))


def head_velocity_rad_s(amplitude_rad: float) -> float:
    """Peak velocity of a person's head in a shift of gaze.

    Args:
        amplitude_rad: How far the head turns, radians.

    Returns:
        rad/s.
    """
    return HEAD_VELOCITY_1_S * amplitude_rad + math.radians(HEAD_VELOCITY_DEG_S)


def eye_velocity_rad_s(amplitude_rad: float) -> float:
    """Peak velocity of a person's eye in a saccade, the main sequence.

    Args:
        amplitude_rad: How far the eye turns in the head, radians.

    Returns:
        rad/s.
    """
    return math.radians(EYE_VELOCITY_DEG_S) * -math.expm1(-amplitude_rad / math.radians(EYE_AMPLITUDE_DEG))


def motor_scale(axis: Axis) -> float:
    """By how much a person's head motion is slowed down so that a motor bears it, at most 1.

    Args:
        axis: A joint of the head.

    Returns:
        Share of the velocity.
    """
    reached = (min(_peak_rad_s(axis, amplitude), axis.velocity_max_rad_s) for amplitude in _HEAD_BETWEEN_RAD)
    shares = (v / head_velocity_rad_s(amplitude) for v, amplitude in zip(reached, _HEAD_BETWEEN_RAD, strict=True))
    return min(1.0, *shares)


def with_motion(neck: NeckSpec, motion: Motion) -> NeckSpec:
    """The neck with the limits and shares of a kind of motion.

    Args:
        neck: The neck.
        motion: ``robot`` for the neck as it is, ``human`` for head and eyes that share a gaze as people do.

    Returns:
        The neck; no limit is higher than before.

    Raises:
        SettingsError: If motion is ``human`` and the neck has no eyes.
    """
    if motion == "robot":
        return neck
    if neck.eyes is None:
        raise SettingsError(f"--motion human: neck {neck.name!r} has no eyes that turn; accepted: --motion robot")
    # One scale, so that an oblique shift is a straight one.
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
    """Greatest velocity of a joint over an angle, if only its acceleration limits it."""
    lag_s, most_rad_s2 = axis.servo_lag_s, axis.acceleration_max_rad_s2
    return 0.5 * most_rad_s2 * (math.sqrt(lag_s**2 + 4.0 * amplitude_rad / most_rad_s2) - lag_s)


def _by_law(axis: Axis, velocity_rad_s: Callable[[float], float], between_rad: tuple[float, ...]) -> Axis:
    """The joint with limits that a law of its peak velocities asks for; none is higher than before."""
    needed = []
    for amplitude_rad in between_rad:
        peak_rad_s = velocity_rad_s(amplitude_rad)
        ramps_s = amplitude_rad / peak_rad_s - axis.servo_lag_s
        # A servo that is slower than the law cannot be compensated by acceleration.
        needed.append(peak_rad_s / ramps_s if ramps_s > 0.0 else math.inf)
    limits = {
        "full_speed_rad_s": axis.full_rad_s,
        "velocity_max_rad_s": min(axis.velocity_max_rad_s, velocity_rad_s(between_rad[-1])),
        "acceleration_max_rad_s2": min(axis.acceleration_max_rad_s2, sum(needed) / len(needed)),
    }
    return axis.model_copy(update=limits)
