"""One line of prediction: command the angle forecast for when the command will show."""

from __future__ import annotations

import math

import numpy as np

from gazempc.controllers.controller import Plan, Situation
from gazempc.neck.kinematics import look_at_rad, unwrap_pan
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# The plan reaches this far so that there is something to follow while the next one is late.
_PLAN_S = 0.4


class LookAhead:
    """Commands the low-passed look-at angles of the forecast for the time at which the command will show.

    The low-pass makes up for its own delay: the forecast is asked for as much later. Somebody who turns the gaze
    steadily is followed without lag, whatever the time constant.

    Args:
        neck: The neck; its dead time and servo lag (2 zeta / wn) say how far to look ahead on each axis.
        smoothing_time_s: Time constant of a first-order low-pass on the commanded angles: smoother, and slower to
            follow what was not forecast. 0 for none.

    Attributes:
        neck: The neck.
    """

    def __init__(self, neck: NeckSpec, smoothing_time_s: float = 0.1) -> None:
        self.neck = neck
        self._knots_s = neck.control_period_s * np.arange(round(_PLAN_S / neck.control_period_s) + 1)
        self._keep = math.exp(-neck.control_period_s / smoothing_time_s) if smoothing_time_s > 0 else 0.0
        self._ahead_s = neck.dead_time_s + neck.servo_lag_s + smoothing_time_s
        # The low-pass over the knots: what each counts in each later one, and what is kept of where it stood.
        age = np.subtract.outer(np.arange(self._knots_s.size), np.arange(self._knots_s.size))
        self._weights: FloatArray = (1.0 - self._keep) * np.tril(self._keep ** np.maximum(age, 0))
        self._kept: FloatArray = self._keep ** np.arange(1.0, self._knots_s.size + 1.0)
        self.reset()

    def reset(self) -> None:
        """Forget where the low-pass stands."""
        self._smoothed_rad: FloatArray | None = None

    def forecast_times_s(self, start_s: float, newest_capture_s: float) -> FloatArray:
        """The knots' times ahead by each axis's delay, pan first, then tilt, shape (2 K,)."""
        return np.concatenate([start_s + ahead_s + self._knots_s for ahead_s in self._ahead_s])

    def plan(self, situation: Situation) -> Plan:
        """See `gazempc.controllers.controller.Controller.plan`."""
        angles = unwrap_pan(
            look_at_rad(self.neck.geometry, situation.forecast.means_base_m),
            float(situation.command.position_rad[0]),
            float(self.neck.command_limits.position_min_rad[0]),
            float(self.neck.command_limits.position_max_rad[0]),
        )
        knots = self._knots_s.size
        wanted = np.stack([angles[:knots, 0], angles[knots:, 1]], axis=-1)
        position = self.neck.command_limits.clip_position(self._low_pass(wanted, situation.command.position_rad))
        # Central differences, as of numpy.gradient, which takes several times as long.
        velocity = np.empty_like(position)
        velocity[1:-1] = (position[2:] - position[:-2]) / (2.0 * self.neck.control_period_s)
        velocity[0] = (position[1] - position[0]) / self.neck.control_period_s
        velocity[-1] = (position[-1] - position[-2]) / self.neck.control_period_s
        return Plan(situation.start_s, self.neck.control_period_s, position, velocity, np.zeros_like(position))

    def _low_pass(self, wanted_rad: FloatArray, command_rad: FloatArray) -> FloatArray:
        if self._keep == 0.0:
            return wanted_rad
        # It starts where the command stands, and goes on from the first knot of the last plan.
        now = command_rad if self._smoothed_rad is None else self._smoothed_rad
        smoothed: FloatArray = self._weights @ wanted_rad + np.outer(self._kept, now)
        self._smoothed_rad = smoothed[0]
        return smoothed
