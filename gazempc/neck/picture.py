"""Framing of a head in the picture of a camera on the neck: reference position and dead zone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from gazempc.errors import SettingsError
from gazempc.neck.spec import AXES, NeckSpec
from gazempc.specfiles import Strict
from gazempc.types import FloatArray

# Rate of the head's direction at which three quarters of the lead room are used, pictures a second: between sway and a
# person who crosses the picture in four seconds.
_LEADS_FROM_PER_S = 0.25
# Widening of the zone against reversals, in standard deviations of the forecast direction.
_TURNS_BACK_SDS = 1.5
# Shares of the zone that plans use, for a person at rest and for one who crosses the picture.
_RESTS_IN, _FOLLOWS_IN = 0.9, 0.5
# A response to an excursion that ends within the delay causes two unnecessary moves. Of 1, 1.5 and 2 delays the first
# has a third more reversals on the slowest camera, the last up to a point less time in the zone (`docs/rivals.md`).
_EXCURSION_DELAYS, _SHORTEST_EXCURSION_S = 1.5, 0.02
_Share = Annotated[float, Field(ge=0, le=1)]
_View = Annotated[float, Field(gt=0, le=180)]


class Framing(Strict):
    """A head in the picture of a camera that the neck turns; lengths are shares of the picture, so any zoom fits."""

    subject: Literal["no", "one", "all"] = Field(
        default="one",
        description="Keep in the picture: the attended person, or the box of all people (with --attend); no: the "
        "gaze meets the head",
    )
    view_deg: tuple[_View, _View] | None = Field(
        default=None,
        description="Angles of the picture at its zoom, width and height; default: the neck's head_view_deg",
    )
    zone: tuple[_Share, _Share] = Field(
        default=(0.33, 0.33), description="Width and height of the zone in which the head may be while the camera rests"
    )
    headroom: _Share = Field(default=0.4, description="Share of the picture above the head; 0.5: in the middle")
    lead_room: float = Field(default=0.08, ge=0, le=0.4, description="Share by which a walker is behind the middle")
    hysteresis_per_s: float = Field(
        default=0.5,
        ge=0,
        le=5,
        description="Before the camera turns back, the zone is wider on that side by this share of its half width for "
        "each second of delay; larger: fewer reversals, less time in the zone",
    )
    smoothing_time_s: float = Field(default=0.2, gt=0, le=1, description="T of the program; larger is calmer")
    horizon_s: float = Field(default=1.2, ge=0.1, le=5, description="Length of the plan after the dead time")
    acceleration_max: float = Field(default=3.0, gt=0, description="Limit in widths of the picture, 1/s^2")
    jerk_max: float = Field(default=20.0, gt=0, description="Limit in widths of the picture, 1/s^3")


@dataclass(frozen=True)
class FramedPicture:
    """A framing in angles; a share of the picture is converted to the same share of its field of view.

    Attributes:
        framing: The framing.
        view_rad: Width and height, radians.
    """

    framing: Framing
    view_rad: tuple[float, float]

    @staticmethod
    def of(framing: Framing, neck: NeckSpec) -> FramedPicture | None:
        """The picture of a framing on a neck; None for a disabled framing.

        Raises:
            SettingsError: If the field of view is unknown.
        """
        if framing.subject == "no":
            return None
        view_deg = framing.view_deg or neck.head_view_deg
        if view_deg is None:
            why = f"missing, and neck {neck.name!r} has no head_view_deg"
            raise SettingsError(f"framing.view_deg: {why}; accepted: angles of the picture, such as 60 34")
        return FramedPicture(framing, (math.radians(view_deg[0]), math.radians(view_deg[1])))

    @property
    def zone_rad(self) -> tuple[float, float]:
        """Half width and half height of the zone, radians."""
        return 0.5 * self.framing.zone[0] * self.view_rad[0], 0.5 * self.framing.zone[1] * self.view_rad[1]

    def aim_rad(self, head_rad: FloatArray, turning_rad_s: FloatArray | float) -> FloatArray:
        """Reference angles of the camera: below the head by the headroom, ahead of it by the lead room.

        Args:
            head_rad: Look-at angles of the head, shape (..., 2), radians.
            turning_rad_s: Rate of this pan, shape (...), rad/s.

        Returns:
            Pan and tilt, shape (..., 2), radians.
        """
        share = np.tanh(np.asarray(turning_rad_s) / (_LEADS_FROM_PER_S * self.view_rad[0]))
        aim_rad = np.array(head_rad, dtype=np.float64)
        aim_rad[..., 0] += self.framing.lead_room * self.view_rad[0] * share
        aim_rad[..., 1] -= (0.5 - self.framing.headroom) * self.view_rad[1]
        return aim_rad

    def planned_zone_rad(self, axis: int, turning_rad_s: float) -> float:
        """Half width of the zone in a plan: larger for a person at rest; the rest is a margin for forecast error.

        Args:
            axis: 0 for pan, 1 for tilt.
            turning_rad_s: Rate of the look-at angle, rad/s.
        """
        return self.zone_rad[axis] * (_RESTS_IN + self._moves(axis, turning_rad_s) * (_FOLLOWS_IN - _RESTS_IN))

    def turns_back_rad(self, axis: int, delay_s: float, deviation_rad: FloatArray) -> FloatArray:
        """Hysteresis: widening of the zone against reversals; at most to the edge of the picture.

        Args:
            axis: 0 for pan, 1 for tilt.
            delay_s: Delay from the newest picture to the motion in response, seconds.
            deviation_rad: Standard deviation of the forecast's angle, any shape, radians.

        Returns:
            Of the same shape, radians.
        """
        zone_rad, edge_rad = self.zone_rad[axis], 0.5 * self.view_rad[axis]
        wider_rad = self.framing.hysteresis_per_s * delay_s * zone_rad + _TURNS_BACK_SDS * deviation_rad
        return np.minimum(wider_rad, edge_rad - zone_rad)

    def excursion_s(self, delay_s: float) -> float:
        """Minimum duration of an excursion that causes a response, for a person at rest.

        Args:
            delay_s: Delay from the newest picture to the motion in response, seconds.
        """
        return max(_EXCURSION_DELAYS * delay_s, _SHORTEST_EXCURSION_S)

    def widening_rad(self, axis: int, turning_rad_s: float, share: float) -> float:
        """Widening of the zone on both sides for a person at rest, early in an excursion.

        Args:
            axis: 0 for pan, 1 for tilt.
            turning_rad_s: Significant part of the rate of the look-at angle, rad/s.
            share: Duration of the excursion as a share of `excursion_s`, 0 to 1.
        """
        edge_rad = 0.5 * self.view_rad[axis] - self.zone_rad[axis]
        return (1.0 - self._moves(axis, turning_rad_s)) * (1.0 - share) * edge_rad

    def _moves(self, axis: int, turning_rad_s: float) -> float:
        """Motion indicator: 0 for a person at rest, towards 1 for one who crosses the picture."""
        return math.tanh(abs(turning_rad_s) / (_LEADS_FROM_PER_S * self.view_rad[axis]))

    def calmed(self, neck: NeckSpec) -> NeckSpec:
        """The neck with pan and tilt within the framing's limits of acceleration and jerk."""
        axes = {}
        # At least the smallest limits that a neck file can have.
        for name, axis in zip(AXES, neck.axes, strict=False):
            acceleration = min(
                axis.acceleration_max_rad_s2, max(self.framing.acceleration_max * self.view_rad[0], 0.01)
            )
            jerk = min(axis.jerk_max_rad_s3, max(self.framing.jerk_max * self.view_rad[0], 0.1))
            axes[name] = axis.model_copy(update={"acceleration_max_rad_s2": acceleration, "jerk_max_rad_s3": jerk})
        return neck.with_axes(axes)
