"""One gaze aversion: times, direction, and the gaze shifts there and back."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from gazempc.neck.kinematics import pan_tilt_rad, unit_vector, wrapped_rad
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray
from predictors import Forecast

# Contact ends and begins 2.6 deg from the person (see docs/metrics.md). As heads smooth the shift and forecasts have
# errors, it is planned for these angles: contact then ends and begins within 0.04 s of the plan. Eyes do not smooth it.
_HEAD_CONTACT_RAD, _EYE_CONTACT_RAD = math.radians(0.6), math.radians(2.4)
# Share of the limits for a shift; the rest is for the tracking of the person and changes of the forecast.
_LIMITS_SHARE = 0.8
# Shortest duration of a shift: a faster one startles people.
_QUICKEST_S = 0.25
# Peaks of a minimum-jerk motion of 1 rad in 1 s (Flash & Hogan 1985): velocity, acceleration, jerk.
PEAK_VELOCITY, _PEAK_ACCELERATION, _PEAK_JERK = 1.875, 5.774, 60.0
# Smallest angle of an aversion that is shortened to fit its time.
_SMALLEST_RAD = math.radians(6.0)


@dataclass(frozen=True)
class Aversion:
    """A gaze aversion.

    Attributes:
        start_s: End of contact, seconds.
        end_s: Time of renewed contact, seconds.
        aside_rad: Angle to the left of the person, radians.
        up_rad: Angle upwards, radians.
        why: ``listening``, ``speaking``, ``thinking``, ``speech`` or ``glance``.
        target_base_m: Gaze target, shape (3,), metres; None for a direction relative to the person.
    """

    start_s: float
    end_s: float
    aside_rad: float
    up_rad: float
    why: str
    target_base_m: FloatArray | None = None

    @property
    def angle_rad(self) -> float:
        """Angle between aversion and person, radians."""
        return math.hypot(self.aside_rad, self.up_rad)


@dataclass(frozen=True)
class GazeShift:
    """Timing of a gaze shift.

    Attributes:
        lasts_s: Duration of the shift away, and of the shift back, seconds.
        leaves_after_s: Time from the start of the shift to the end of contact, seconds.
    """

    lasts_s: float
    leaves_after_s: float


def shift_of(neck: NeckSpec, aside_rad: float, up_rad: float) -> GazeShift:
    """Fastest minimum-jerk shift within the limits of a neck.

    Args:
        neck: The neck.
        aside_rad: Angle to the side, radians.
        up_rad: Angle up, radians.

    Returns:
        The shift.
    """
    angles = np.abs([aside_rad, up_rad])
    limits = neck.command_limits
    lasts_s = np.max(
        [
            PEAK_VELOCITY * angles / (_LIMITS_SHARE * limits.velocity_max_rad_s[:2]),
            np.sqrt(_PEAK_ACCELERATION * angles / (_LIMITS_SHARE * limits.acceleration_max_rad_s2[:2])),
            np.cbrt(_PEAK_JERK * angles / (_LIMITS_SHARE * limits.jerk_max_rad_s3[:2])),
        ]
    )
    lasts_s = max(float(lasts_s), _QUICKEST_S)
    contact_rad = _HEAD_CONTACT_RAD if neck.eyes is None else _EYE_CONTACT_RAD
    share = contact_rad / max(math.hypot(aside_rad, up_rad), contact_rad)
    leaves_after: float = brentq(lambda x: float(minimum_jerk(np.float64(x))) - share, 0.0, 1.0)
    return GazeShift(lasts_s, leaves_after * lasts_s)


def fitted(aversion: Aversion, neck: NeckSpec) -> Aversion | None:
    """Reduce the angle of an aversion until the neck can execute it in its time.

    Args:
        aversion: The aversion.
        neck: The neck.

    Returns:
        The same, or one with a smaller angle; None if it is infeasible. The angle to a target is not reduced.
    """
    angle_rad = aversion.angle_rad
    while angle_rad >= _SMALLEST_RAD:
        scale = angle_rad / aversion.angle_rad
        shift = shift_of(neck, scale * aversion.aside_rad, scale * aversion.up_rad)
        if aversion.end_s - aversion.start_s >= 2.0 * (shift.lasts_s - shift.leaves_after_s):
            return replace(aversion, aside_rad=scale * aversion.aside_rad, up_rad=scale * aversion.up_rad)
        if aversion.target_base_m is not None:
            return None
        angle_rad *= 0.9
    return None


def with_aversion(forecast: Forecast, aversion: Aversion, shift: GazeShift) -> Forecast:
    """Set-point of the gaze from the forecast of a person and an aversion.

    The shift away begins before contact ends, and the shift back ends after contact begins, each by the time in which
    the gaze is within the cone of contact.

    Args:
        forecast: Forecast of the person.
        aversion: The aversion.
        shift: Timing of its shifts.

    Returns:
        The forecast, with shifted means during the aversion, and the person's covariances.
    """
    since_s = (forecast.times_s - aversion.start_s + shift.leaves_after_s) / shift.lasts_s
    until_s = (aversion.end_s + shift.leaves_after_s - forecast.times_s) / shift.lasts_s
    weight = minimum_jerk(np.clip(np.minimum(since_s, until_s), 0.0, 1.0))
    if not weight.any():
        return forecast
    person = _spherical(forecast.means_base_m)
    away = np.array([[aversion.aside_rad], [aversion.up_rad], [0.0]])
    if aversion.target_base_m is not None:
        away = _spherical(aversion.target_base_m[None]) - person
        away[0] = wrapped_rad(away[0])
    azimuth, elevation, range_m = person + weight * away
    elevation = np.clip(elevation, -1.5, 1.5)
    means = range_m[:, None] * np.stack(unit_vector(azimuth, elevation), axis=1)
    # Means outside of the aversion stay bitwise identical.
    return replace(forecast, means_base_m=np.where(weight[:, None] > 0.0, means, forecast.means_base_m))


def angles_to(target_base_m: FloatArray, person_base_m: FloatArray) -> tuple[float, float]:
    """Angles between a target and a person, as viewed from the neck.

    Args:
        target_base_m: Shape (3,), metres.
        person_base_m: Shape (3,), metres.

    Returns:
        Angles to the left and up, radians.
    """
    azimuth, elevation, _ = _spherical(np.stack([target_base_m, person_base_m]))
    return float(wrapped_rad(azimuth[0] - azimuth[1])), float(elevation[0] - elevation[1])


def _spherical(positions_m: FloatArray) -> FloatArray:
    """Azimuth, elevation and range of positions, shape (3, N), radians and metres."""
    x, y, z = positions_m.T
    return np.vstack([pan_tilt_rad(positions_m).T, np.hypot(np.hypot(x, y), z)])


def minimum_jerk(share: FloatArray | np.float64) -> FloatArray:
    """Normalised minimum-jerk profile: share of the distance at a share of the time, 0 to 1, of the same shape."""
    return np.asarray(share**3 * (10.0 - 15.0 * share + 6.0 * share**2))
