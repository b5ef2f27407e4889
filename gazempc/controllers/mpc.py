"""Model-predictive gaze: plan the neck's motion over the forecast, behind its dead time and within its limits."""

from __future__ import annotations

import math

import numpy as np

from gazempc.controllers.controller import (
    FloatArray,
    Plan,
    Situation,
    SolverFailed,
    SolverTimedOut,
)
from gazempc.controllers.ocp import AxisModel, AxisOcp, SolverFailedError
from gazempc.controllers.qp import Daqp
from gazempc.errors import SettingsError
from gazempc.kinematics import angle_deviations_rad, look_at_rad, unwrap_pan
from gazempc.neck import NeckSpec
from gazempc.servo import DeadTimeRoll

_FIRST_SOLVERS = ("gain", Daqp.name)
# Doubt makes the smoothing time up to 2^(8/4) = 4 times as long, in steps of a quarter of an octave.
_LEVELS_PER_OCTAVE = 4
_LEVELS = 9
# With more steps a solve can take longer than a control period.
_STEPS_MAX = 200
# The doubt that counts is that of the forecast for this long after the dead time: what is planned now shows there.
_DOUBT_AT_S = 0.2


class Mpc:
    """Optimises the command's jerk over a horizon that starts where the dead time ends.

    What the joint does within the dead time is settled by the commands already sent; it is rolled forward exactly.
    From there on, the forecast head positions give reference angles, and a quadratic program for each joint
    (`gazempc.controllers.ocp`) finds the smoothest motion that follows them within the limits. Where the forecast is
    in doubt the joint follows it more smoothly: with sigma the standard deviation of the reference angle the smoothing
    time is ``T sqrt(1 + (sigma / doubt)^2)``.

    Args:
        neck: The neck.
        horizon_s: Length of the optimised motion after the dead time, seconds.
        smoothing_time_s: T: gaze motion faster than the inverse of this time (in rad/s) is smoothed rather than
            followed; larger is smoother and less exact.
        doubt_deg: Standard deviation of the forecast direction from which on smoothing outweighs exactness; large for
            no regard to the forecast's covariance.

    Raises:
        SettingsError: If the horizon is longer than 200 steps.

    Attributes:
        ocps: The programs of pan and of tilt, each for longer and longer smoothing times.
    """

    def __init__(
        self, neck: NeckSpec, horizon_s: float = 0.8, smoothing_time_s: float = 0.075, doubt_deg: float = 2.0
    ) -> None:
        self._neck = neck
        self._steps = max(2, round(horizon_s / neck.control_period_s))
        if self._steps > _STEPS_MAX:
            raise SettingsError(
                f"mpc.horizon_s: {horizon_s} s is {self._steps} steps at {neck.control_rate_hz:g} plans a second; "
                f"accepted: at most {_STEPS_MAX} steps, {_STEPS_MAX * neck.control_period_s:g} s"
            )
        self._doubt_rad = math.radians(doubt_deg)
        times_s = [smoothing_time_s * 2.0 ** (level / _LEVELS_PER_OCTAVE) for level in range(_LEVELS)]
        models = [AxisModel(neck, i, self._steps) for i in range(2)]
        self.ocps = [[AxisOcp(model, time_s) for time_s in times_s] for model in models]
        self._rolls = [DeadTimeRoll(axis, neck.servo_period_s) for axis in neck.axes]
        # The first jerk acts from the last command before the plan on, so that the first command sent is
        # already a new one; the joint answers one dead time later.
        steps_s = neck.control_period_s * np.arange(1, self._steps + 1)
        dead_times_s = neck.dead_time_s if neck.dead_time_s[0] != neck.dead_time_s[1] else neck.dead_time_s[:1]
        self._ahead_s = np.concatenate([dead_s + steps_s for dead_s in dead_times_s])
        doubted = min(round(_DOUBT_AT_S / neck.control_period_s), self._steps) - 1
        self._doubted = (doubted, doubted - self._steps)

    def reset(self) -> None:
        """Forget where the solvers stand; all else of a plan is made from the situation alone."""
        for ocps in self.ocps:
            for ocp in ocps:
                ocp.reset()

    def forecast_times_s(self, start_s: float, newest_capture_s: float) -> FloatArray:
        """End of each step of the horizon, one dead time late, shape (N,).

        With dead times of their own for pan and tilt first those of pan, then those of tilt, shape (2 N,).
        """
        return start_s + self._ahead_s

    def plan(self, situation: Situation) -> Plan:
        """See `gazempc.controllers.controller.Controller.plan`."""
        n, command, forecast = self._steps, situation.command, situation.forecast
        limits = self._neck.command_limits
        angles = unwrap_pan(
            look_at_rad(self._neck.geometry, forecast.means_base_m),
            float(command.position_rad[0]),
            float(limits.position_min_rad[0]),
            float(limits.position_max_rad[0]),
        )
        knots = np.empty((3, n + 1, 2))
        knots[0, 0], knots[1, 0], knots[2, 0] = (
            command.position_rad,
            command.velocity_rad_s,
            command.acceleration_rad_s2,
        )
        state = np.empty(5)
        events: tuple[str, ...] = ()
        for i, reference in enumerate((angles[:n, 0], angles[-n:, 1])):
            # Counted without its offset, the joint follows the command as the model says.
            offset_rad = situation.joint_offset_rad[i]
            state[:2] = self._rolls[i](
                situation.joint_position_rad[i] - offset_rad,
                situation.joint_velocity_rad_s[i],
                situation.sent_rad[:, i],
                situation.committed_rad[:, i],
            )
            state[2:] = knots[:, 0, i]
            k = self._doubted[i]
            sigma_rad = angle_deviations_rad(forecast.means_base_m[k], forecast.covariances_m2[k])[i]
            try:
                solution = self.ocps[i][self._level(sigma_rad)].solve(state, reference - offset_rad)
            except SolverFailedError as error:
                raise (SolverTimedOut if error.timed_out else SolverFailed)(str(error)) from None
            if solution.softened:
                events += ("limits_softened",)
            if solution.solver not in _FIRST_SOLVERS:
                events += ("second_solver",)
            knots[:, 1:, i] = solution.command
        start_s = situation.start_s - self._neck.servo_period_s
        return Plan(start_s, self._neck.control_period_s, knots[0], knots[1], knots[2], events)

    def _level(self, sigma_rad: float) -> int:
        if not sigma_rad < math.inf:
            return _LEVELS - 1
        octaves = 0.5 * math.log2(1.0 + (sigma_rad / self._doubt_rad) ** 2)
        return min(round(_LEVELS_PER_OCTAVE * octaves), _LEVELS - 1)
