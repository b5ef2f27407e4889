"""Look at where the head is now (so the robot looks at where it was): the baseline."""

from __future__ import annotations

import numpy as np

from gazempc.controllers.controller import Plan, Situation
from gazempc.neck.kinematics import look_at_rad, unwrap_pan
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# Long enough to bridge a late frame, short enough that the watchdog stops a gaze that gets no news.
_HOLD_S = 1.0


class Reactive:
    """Commands the look-at angles of the latest filtered head position and holds them until the next.

    Args:
        neck: The neck.

    Attributes:
        neck: The same.
    """

    def __init__(self, neck: NeckSpec) -> None:
        self.neck = neck

    def reset(self) -> None:
        """Nothing to forget."""

    def forecast_times_s(self, start_s: float, newest_capture_s: float) -> FloatArray:
        """See `gazempc.controllers.controller.Controller.forecast_times_s`."""
        return np.array([newest_capture_s])

    def plan(self, situation: Situation) -> Plan:
        """See `gazempc.controllers.controller.Controller.plan`."""
        angles = look_at_rad(self.neck.geometry, situation.forecast.means_base_m)
        limits = self.neck.command_limits
        angles = unwrap_pan(
            angles,
            float(situation.command.position_rad[0]),
            float(limits.position_min_rad[0]),
            float(limits.position_max_rad[0]),
        )
        hold = np.zeros((1, 2))
        return Plan(situation.start_s, _HOLD_S, limits.clip_position(angles[:1]), hold, hold.copy())
