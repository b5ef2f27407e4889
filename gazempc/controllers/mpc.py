"""Model-predictive gaze: plan the neck's motion over the forecast, behind its dead time and within its limits."""

from __future__ import annotations

import numpy as np

from gazempc.controllers.controller import ControllerError, FloatArray, Plan, Situation
from gazempc.controllers.ocp import AxisOcp, SolverFailedError, servo_step
from gazempc.kinematics import gaze_turn, look_at, unwrap_pan
from gazempc.neck import NeckSpec
from gazempc.servo import DeadTimeRoll, zero_order_hold


class Mpc:
    """Optimises the command's jerk over a horizon that starts where the dead time ends.

    What the joint does within the dead time is settled by the commands already sent; it is rolled forward exactly.
    From there on, the forecast head positions give reference angles, and a quadratic program for each joint
    (`gazempc.controllers.ocp`) finds the smoothest motion that follows them within the limits.

    Args:
        neck: The neck.
        horizon_s: Length of the optimised motion after the dead time, seconds.
        smoothing_time_s: Gaze motion faster than the inverse of this time (in rad/s) is smoothed rather than
            followed; larger is smoother and less exact.

    Attributes:
        ocps: The programs of pan and tilt.
    """

    def __init__(self, neck: NeckSpec, horizon_s: float = 0.8, smoothing_time_s: float = 0.11) -> None:
        self._neck = neck
        self._steps = max(2, round(horizon_s / neck.control_period_s))
        self.ocps = [AxisOcp(neck, i, self._steps, smoothing_time_s) for i in range(2)]
        self._rolls = [DeadTimeRoll(axis, neck.servo_period_s) for axis in neck.axes]
        self._servo = [zero_order_hold(axis, neck.servo_period_s) for axis in neck.axes]
        self._models = [servo_step(axis, neck.servo_period_s) for axis in neck.axes]
        # The first jerk acts from the last command before the plan on, so that the first command sent is
        # already a new one; the joint answers one dead time later.
        self._steps_s = neck.control_period_s * np.arange(1, self._steps + 1)

    def reset(self) -> None:
        """Nothing to forget: every plan is made from the situation alone."""

    def forecast_times_s(self, start_s: float, newest_capture_s: float) -> FloatArray:
        """End of each step of the horizon, one dead time late, for pan, then for tilt, shape (2 N,)."""
        return np.concatenate([start_s + dead_s + self._steps_s for dead_s in self._neck.dead_time_s])

    def plan(self, situation: Situation) -> Plan:
        """See `gazempc.controllers.controller.Controller.plan`."""
        n = self._steps
        angles = unwrap_pan(
            look_at(self._neck.geometry, situation.forecast.means_base_m).angles_rad,
            float(situation.command.position_rad[0]),
            float(self._neck.command_limits.position_min_rad[0]),
            float(self._neck.command_limits.position_max_rad[0]),
        )
        references = (angles[:n, 0], angles[n:, 1])
        turns = gaze_turn(self._neck.geometry, angles, situation.forecast.means_base_m)
        weights = (turns[:n, 0] ** 2, turns[n:, 1] ** 2)
        knots = np.empty((n + 1, 2, 3))
        for i in range(2):
            state = self._state_after_dead_time(situation, i)
            try:
                solution = self.ocps[i].solve(state, references[i], weights[i])
            except SolverFailedError as error:
                raise ControllerError(str(error)) from None
            knots[:, i] = self._roll_command(i, state[2:], solution.jerk_rad_s3)
        return Plan(
            start_s=situation.start_s - self._neck.servo_period_s,
            step_s=self._neck.control_period_s,
            position_rad=knots[..., 0],
            velocity_rad_s=knots[..., 1],
            acceleration_rad_s2=knots[..., 2],
        )

    def _state_after_dead_time(self, situation: Situation, i: int) -> FloatArray:
        joint = self._rolls[i](
            float(situation.joint_position_rad[i]),
            float(situation.joint_velocity_rad_s[i]),
            situation.sent_rad[:, i],
        )
        for command_rad in situation.committed_rad[:, i]:
            joint = self._servo[i] @ np.array([joint[0], joint[1], command_rad])
        command = situation.command
        return np.array(
            [
                joint[0],
                joint[1],
                command.position_rad[i],
                command.velocity_rad_s[i],
                command.acceleration_rad_s2[i],
            ]
        )

    def _roll_command(self, i: int, command: FloatArray, jerk_rad_s3: FloatArray) -> FloatArray:
        M, m = self._models[i]
        knots = np.empty((len(jerk_rad_s3) + 1, 3))
        knots[0] = now = command
        for k, jerk in enumerate(jerk_rad_s3, start=1):
            for _ in range(self._neck.servo_ticks_per_plan):
                now = M[2:, 2:] @ now + m[2:] * jerk
            knots[k] = now
        return knots
