"""Model-predictive gaze: plan the neck's motion over the forecast, behind its dead time and within its limits."""

from __future__ import annotations

import numpy as np

from gazempc.controllers.chain import Chain, head_time_s, slopes
from gazempc.controllers.controller import Plan, Situation
from gazempc.controllers.mpc.acquisition import ACQUISITION_DAMPING, Acquisition
from gazempc.controllers.mpc.axis_model import axis_model, growing_steps
from gazempc.controllers.mpc.ocp import AxisOcp, Solution
from gazempc.controllers.mpc.qp import iterations_within
from gazempc.errors import SettingsError
from gazempc.neck.servo import DeadTimeRoll
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# The plan reaches this far so that there is something to follow while the next one is late.
_PLAN_S = 0.4
# The head of a neck with eyes: smooth, as the eyes make up for it.
_HEAD_TIME_S = 0.35
# Share of a control period that the solvers of both joints together may take.
_SOLVERS_SHARE = 0.5


class Mpc:
    """Optimises the command's jerk over a horizon that starts where the dead time ends.

    Dead time: the joint's motion is fixed by commands already sent. It is rolled forward exactly. After the dead time
    the forecast head positions give reference angles. A quadratic program a joint (`gazempc.controllers.mpc.ocp`)
    finds the smoothest motion that follows them within the limits. A joint that is far off the person goes by a second
    program, quicker and damped (`gazempc.controllers.mpc.acquisition`).

    Args:
        neck: The neck.
        horizon_s: Length of the optimised motion after the dead time, seconds.
        smoothing_time_s: T: gaze motion faster than the inverse of this time (in rad/s) is smoothed rather than
            followed; larger is smoother and less exact.
        acquisition_time_s: The same on the way to somebody who is off the gaze; not more than T is used.
        head_smoothing_time_s: T of the head of a neck with eyes, which look where it does not point yet. None: 0.35, or
            0.1 for a head that leaves a share to the eyes, which people turn as quickly as they can.

    Raises:
        SettingsError: If the horizon is shorter than two smoothing times: then its end shows in the gaze.

    Attributes:
        neck: The neck.
        ocps: The programs of pan and of tilt.
        acquisition_ocps: The same on the way to somebody who is off the gaze.
    """

    def __init__(
        self,
        neck: NeckSpec,
        horizon_s: float = 0.8,
        smoothing_time_s: float = 0.12,
        acquisition_time_s: float = 0.09,
        head_smoothing_time_s: float | None = None,
    ) -> None:
        if neck.eyes is not None:
            smoothing_time_s = head_time_s(neck, head_smoothing_time_s, _HEAD_TIME_S)
        if horizon_s < 2.0 * smoothing_time_s:
            needed = (
                f"for mpc.smoothing_time_s: {smoothing_time_s:g} s; accepted: at least {2.0 * smoothing_time_s:g} s"
            )
            raise SettingsError(f"mpc.horizon_s: {horizon_s:g} s is too short {needed}")
        self.neck = neck
        period_s = neck.control_period_s
        lengths = growing_steps(horizon_s, period_s)
        self._steps, self._knots = len(lengths), max(1, min(round(_PLAN_S / period_s), sum(lengths)))
        models = [axis_model(neck, i, lengths, self._knots) for i in range(2)]
        quick_s = min(acquisition_time_s, smoothing_time_s)
        most = iterations_within(0.5 * _SOLVERS_SHARE * period_s, self._steps)
        self.ocps = [AxisOcp(model, smoothing_time_s, iterations=most) for model in models]
        self.acquisition_ocps = [AxisOcp(model, quick_s, ACQUISITION_DAMPING, True, most) for model in models]
        # The first knot is the command before the plan starts.
        self._knots_s: FloatArray = period_s * np.arange(1.0, self._knots + 1) - neck.servo_period_s
        self._chain = Chain(neck, self._knots_s)
        self._acquisitions = [Acquisition(neck, i, smoothing_time_s) for i in range(2)]
        self._rolls = [DeadTimeRoll(axis, neck.servo_period_s) for axis in neck.axes[:2]]
        # The first jerk acts from the last command before the plan on, so that the first command sent is
        # already a new one; the joint answers one dead time later.
        times_s = models[0].times_s
        self._times_s = times_s
        self._between_s = float(times_s[1] - times_s[0])
        one_dead_time = bool(neck.dead_time_s[0] == neck.dead_time_s[1])
        dead_times_s = neck.dead_time_s[: 1 if one_dead_time else 2]
        self._ahead_s = np.concatenate([dead_s + times_s for dead_s in dead_times_s])

    def reset(self) -> None:
        """Forget where the solvers stand and who was off the gaze; all else is in the situation."""
        for acquisition in self._acquisitions:
            acquisition.reset()
        for ocp in self.ocps + self.acquisition_ocps:
            ocp.reset()

    def forecast_times_s(self, start_s: float, newest_capture_s: float) -> FloatArray:
        """End of each step of the horizon, one dead time late, shape (n,).

        With dead times of their own for pan and tilt first those of pan, then those of tilt, shape (2 n,). The
        times of the eyes follow, see `Chain.eye_times_s`.
        """
        return np.concatenate([start_s + self._ahead_s, self._chain.eye_times_s(start_s)])

    def plan(self, situation: Situation) -> Plan:
        """See `gazempc.controllers.controller.Controller.plan`."""
        n, command, count = self._steps, situation.command, self._ahead_s.size
        means_base_m = situation.forecast.means_base_m
        angles = self._chain.head_rad(situation, means_base_m[:count])
        body = None
        if self._chain.body is not None:
            body = self._chain.body.commands_rad(situation, np.interp(self._knots_s, self._times_s, angles[:n, 0]))
            angles[:n, 0] -= self._chain.body.angles_rad(situation, body, self._ahead_s[:n])
        knots = np.zeros((3, self._knots + 1, self.neck.joints))
        knots[:, 0] = command.position_rad, command.velocity_rad_s, command.acceleration_rad_s2
        # Plain numbers: arithmetic with numpy's takes several times as long.
        joints = zip(
            situation.joint_position_rad[:2].tolist(),
            situation.joint_velocity_rad_s[:2].tolist(),
            situation.joint_offset_rad[:2].tolist(),
            (angles[:n, 0], angles[-n:, 1]),
            strict=True,
        )
        quick = self._chain.eyes_held(situation).tolist() if situation.held else [False, False]
        state = np.empty(5)
        events: tuple[str, ...] = ()
        for i, (position_rad, velocity_rad_s, offset_rad, reference) in enumerate(joints):
            # Counted without its offset, the joint follows the command as the model says.
            state[:2] = self._rolls[i](
                position_rad - offset_rad, velocity_rad_s, situation.sent_rad[:, i], situation.committed_rad[:, i]
            )
            state[2:] = knots[:, 0, i]
            solution = self._solve(i, state, reference - offset_rad, quick[i])
            if solution.solver == "none":
                events += ("solver_gave_up",)
            elif solution.softened:
                events += ("limits_softened",)
            knots[:, 1:, i] = solution.command
        if self.neck.joints > len(self.ocps):
            joints_rad = self._chain.with_eyes(situation, means_base_m[count:], knots[0, 1:, :2], body)
            knots[0, 1:, 2:] = joints_rad[:, 2:]
            # They begin on the way that they follow. From where the command stands, slow eyes would chase themselves.
            knots[0, 0, 2:] = 2.0 * knots[0, 1, 2:] - knots[0, 2, 2:]
            knots[1, :, 2:] = slopes(knots[0, :, 2:], self.neck.control_period_s)
            knots[2, :, 2:] = 0.0
            events += self._chain.events(knots[0, 1])
        start_s = situation.start_s - self.neck.servo_period_s
        return Plan(start_s, self.neck.control_period_s, knots[0], knots[1], knots[2], events)

    def _solve(self, axis: int, state: FloatArray, reference_rad: FloatArray, quick: bool) -> Solution:
        turning_rad_s = float(reference_rad[1] - reference_rad[0]) / self._between_s
        bounds_rad = self._acquisitions[axis].bounds_rad(float(state[0]), float(state[1]), reference_rad, turning_rad_s)
        # Without the eye nobody makes up for the smoothing.
        if bounds_rad is None and not quick:
            return self.ocps[axis].solve(state, reference_rad)
        return self.acquisition_ocps[axis].solve(state, reference_rad, bounds_rad)
