"""The baseline without prediction: track the present head position, with the lag of dead time and servo."""

from __future__ import annotations

import numpy as np

from gazempc.controllers.chain import Chain
from gazempc.controllers.controller import Plan, Situation
from gazempc.neck.kinematics import eye_angles_rad, head_angles_rad
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# Bridges a late frame, and ends early enough for the watchdog to stop a gaze without observations.
_HOLD_S = 1.0


class Reactive:
    """Commands the look-at angles of the latest filtered head position and holds them until the next.

    A body turns to the person; head and eyes compensate the measured angles of the slower joints.

    Args:
        neck: The neck.

    Attributes:
        neck: The same.
    """

    def __init__(self, neck: NeckSpec) -> None:
        self.neck = neck
        self._chain = Chain(neck, np.zeros(1))

    def reset(self) -> None:
        """See `gazempc.controllers.controller.Controller.reset`; the control law is static."""

    def forecast_times_s(self, start_s: float, newest_capture_s: float) -> FloatArray:
        """See `gazempc.controllers.controller.Controller.forecast_times_s`."""
        return np.array([newest_capture_s])

    def plan(self, situation: Situation) -> Plan:
        """See `gazempc.controllers.controller.Controller.plan`."""
        neck, limits = self.neck, self.neck.command_limits
        angles = self._chain.head_rad(situation, situation.forecast.means_base_m[:1])
        wanted = np.zeros((1, neck.joints))
        wanted[:, :2] = angles
        if neck.body is not None:
            wanted[:, -1] = np.clip(angles[:, 0], limits.position_min_rad[-1], limits.position_max_rad[-1])
            wanted[:, 0] -= situation.joint_position_rad[-1]
        if neck.eyes is not None:
            head_rad = head_angles_rad(situation.joint_position_rad)
            wanted[:, 2:4] = eye_angles_rad(neck.geometry, head_rad, situation.forecast.means_base_m[:1])
        hold = np.zeros_like(wanted)
        return Plan(situation.start_s, _HOLD_S, limits.clip_position(wanted), hold, hold.copy())
