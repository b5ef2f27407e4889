"""Model-predictive gaze: plan the neck's motion over the forecast, behind its dead time and within its limits."""

from __future__ import annotations

import math

import numpy as np

from gazempc.controllers.controller import Plan, Situation, SolverFailed, SolverTimedOut
from gazempc.controllers.mpc.axis_model import axis_model
from gazempc.controllers.mpc.meeting import Meeting
from gazempc.controllers.mpc.ocp import AxisOcp, Solution, SolverFailedError
from gazempc.controllers.mpc.qp import Daqp
from gazempc.controllers.mpc.revisions import Revisions
from gazempc.errors import SettingsError
from gazempc.neck.kinematics import angle_deviations_rad, look_at_rad, unwrap_pan
from gazempc.neck.servo import DeadTimeRoll
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray
from predictors import Forecast

_FIRST_SOLVERS = ("gain", Daqp.name)
# Doubt makes the smoothing time up to 2^(8/4) = 4 times as long, in steps of a quarter of an octave.
_LEVELS_PER_OCTAVE = 4
_LEVELS = 9
# With more steps a solve can take longer than a control period.
_STEPS_MAX = 200
# The doubt that counts is that of the forecast for this long after the dead time: what is planned now shows there.
_DOUBT_AT_S = 0.2
# A joint on its way to the person stops short of them by what it goes in this time, so that a forecast that comes
# nearer meanwhile does not carry it past them.
_SHORT_S = 0.01
# Meeting somebody, the joint follows more quickly than T, yet so much damped that it creeps up to them.
_MEETING_TIME = 0.8
_MEETING_DAMPING = 1.35
# Steps of the command in the first control period, at most.
_FIRST_PARTS_MAX = 5
# As good as no bound on a joint's angle.
_FAR_RAD = 100.0


class Mpc:
    """Optimises the command's jerk over a horizon that starts where the dead time ends.

    Dead time: the joint's motion is fixed by commands already sent. It is rolled forward exactly. After the dead time
    the forecast head positions give reference angles. A quadratic program a joint (`gazempc.controllers.mpc.ocp`)
    finds the smoothest motion that follows them within the limits. An uncertain forecast is followed more smoothly:
    with sigma the standard deviation of the reference angle, the smoothing time is ``T sqrt(1 + (sigma / doubt)^2)``.

    Catching up: the person is farther off than the joint gets from rest to rest in 0.2 s, or the joint is too fast to
    brake in time. Then the limits smooth the motion, uncertainty counts less, and the plan must not pass the person.
    Meeting: the person was more than 15 deg off (`gazempc.controllers.mpc.meeting`). For two seconds the joint aims a
    little short of them and arrives damped. Else: a forecast that was revised beyond its covariance is corrected by the
    revision to expect (`gazempc.controllers.mpc.revisions`).

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
        neck: The neck.
        ocps: The programs of pan and of tilt, each for longer and longer smoothing times.
        catch_up_ocps: The same for a joint that is catching up.
        meeting_ocps: The same for a joint that comes up to somebody who was far off.
    """

    def __init__(
        self, neck: NeckSpec, horizon_s: float = 0.8, smoothing_time_s: float = 0.08, doubt_deg: float = 2.0
    ) -> None:
        self.neck = neck
        self._steps = max(2, round(horizon_s / neck.control_period_s))
        if self._steps > _STEPS_MAX:
            raise SettingsError(
                f"mpc.horizon_s: {horizon_s} s is {self._steps} steps at {neck.control_rate_hz:g} plans a second; "
                f"accepted: at most {_STEPS_MAX} steps, {_STEPS_MAX * neck.control_period_s:g} s"
            )
        self._doubt_rad = math.radians(doubt_deg)
        ticks = neck.servo_ticks_per_plan
        # The next plan replaces all but the first control period: there the command is as fine as the joint can use.
        self._first_parts = max(parts for parts in range(1, _FIRST_PARTS_MAX + 1) if ticks % parts == 0)
        times_s = [smoothing_time_s * 2.0 ** (level / _LEVELS_PER_OCTAVE) for level in range(_LEVELS)]
        models = [axis_model(neck, i, self._steps, self._first_parts) for i in range(2)]
        self.ocps = [[AxisOcp(model, time_s) for time_s in times_s] for model in models]
        self.catch_up_ocps = [[AxisOcp(model, time_s, catching_up=True) for time_s in times_s] for model in models]
        self.meeting_ocps = [
            [AxisOcp(model, _MEETING_TIME * time_s, _MEETING_DAMPING) for time_s in times_s] for model in models
        ]
        self._period_s = neck.control_period_s
        # How far each joint gets from rest to rest while doubt counts, and its greatest acceleration.
        self._reaches = [(0.25 * _DOUBT_AT_S**2 * most, most) for most in neck.acceleration_max_rad_s2.tolist()]
        limits = neck.command_limits
        reaches_rad = list(zip(limits.position_min_rad.tolist(), limits.position_max_rad.tolist(), strict=True))
        self._pan_reach_rad = reaches_rad[0]
        answers_s = (neck.dead_time_s + neck.servo_lag_s).tolist()
        self._meetings = [Meeting(answer_s, *reach) for answer_s, reach in zip(answers_s, reaches_rad, strict=True)]
        self._rolls = [DeadTimeRoll(axis, neck.servo_period_s) for axis in neck.axes]
        # The first jerk acts from the last command before the plan on, so that the first command sent is
        # already a new one; the joint answers one dead time later.
        steps_s = neck.control_period_s * np.arange(1, self._steps + 1)
        self._two_dead_times = bool(neck.dead_time_s[0] != neck.dead_time_s[1])
        dead_times_s = neck.dead_time_s if self._two_dead_times else neck.dead_time_s[:1]
        self._ahead_s = np.concatenate([dead_s + steps_s for dead_s in dead_times_s])
        doubted = min(round(_DOUBT_AT_S / neck.control_period_s), self._steps) - 1
        self._revisions = Revisions(neck.control_period_s)
        # What is doubted, and what will be a window later, if the horizon reaches so far: pan's, tilt's.
        later = min(doubted + self._revisions.plans, self._steps - 1)
        self._doubted = ((doubted, doubted - self._steps), (later, later - self._steps))
        self._revised = later == doubted + self._revisions.plans

    def reset(self) -> None:
        """Forget where the solvers stand, what was forecast and who is met; all else is in the situation."""
        self._revisions.reset()
        for meeting in self._meetings:
            meeting.reset()
        for ocps in self.ocps + self.catch_up_ocps + self.meeting_ocps:
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
        angles = unwrap_pan(
            look_at_rad(self.neck.geometry, forecast.means_base_m),
            float(command.position_rad[0]),
            *self._pan_reach_rad,
        )
        knots = np.empty((3, n + self._first_parts, 2))
        knots[:, 0] = command.position_rad, command.velocity_rad_s, command.acceleration_rad_s2
        deviations_rad = self._deviations_rad(forecast)
        further_rad = [0.0, 0.0]
        if self._revised:
            coming_rad = np.array([[angles.item(k, i) for i, k in enumerate(instant)] for instant in self._doubted])
            further_rad = self._revisions.expected_rad(situation.start_s, coming_rad, deviations_rad).tolist()
        # Plain numbers: arithmetic with numpy's takes several times as long.
        sigmas_rad: list[float] = deviations_rad[0].tolist()
        joints = zip(
            situation.joint_position_rad.tolist(),
            situation.joint_velocity_rad_s.tolist(),
            situation.joint_offset_rad.tolist(),
            (angles[:n, 0], angles[-n:, 1]),
            strict=True,
        )
        state = np.empty(5)
        events: tuple[str, ...] = ()
        for i, (position_rad, velocity_rad_s, offset_rad, reference) in enumerate(joints):
            # Counted without its offset, the joint follows the command as the model says.
            state[:2] = self._rolls[i](
                position_rad - offset_rad, velocity_rad_s, situation.sent_rad[:, i], situation.committed_rad[:, i]
            )
            state[2:] = knots[:, 0, i]
            try:
                solution = self._solve(
                    i, situation.start_s, state, reference - offset_rad, sigmas_rad[i], further_rad[i]
                )
            except SolverFailedError as error:
                raise (SolverTimedOut if error.timed_out else SolverFailed)(str(error)) from None
            if solution.softened:
                events += ("limits_softened",)
            if solution.solver not in _FIRST_SOLVERS:
                events += ("second_solver",)
            knots[:, 1:, i] = solution.command
        start_s = situation.start_s - self.neck.servo_period_s
        return Plan(
            start_s, self.neck.control_period_s, knots[0], knots[1], knots[2], events, first_parts=self._first_parts
        )

    def _deviations_rad(self, forecast: Forecast) -> FloatArray:
        # Of pan and tilt, for the doubted instant and the one a window later, shape (2, 2).
        found = []
        for pan, tilt in self._doubted:
            deviations = angle_deviations_rad(forecast.means_base_m[pan], forecast.covariances_m2[pan])
            if self._two_dead_times:
                of_tilt = angle_deviations_rad(forecast.means_base_m[tilt], forecast.covariances_m2[tilt])
                deviations = deviations[0], of_tilt[1]
            found.append(deviations)
        return np.array(found)

    def _solve(
        self,
        axis: int,
        start_s: float,
        state: FloatArray,
        reference_rad: FloatArray,
        sigma_rad: float,
        further_rad: float,
    ) -> Solution:
        joint_rad, joint_rad_s = state[:2].tolist()
        aim_rad, next_rad = reference_rad[:2].tolist()
        gap_rad = aim_rad - joint_rad
        turning_rad_s = (next_rad - aim_rad) / self._period_s
        # The speed at which the gap grows.
        speed_rad_s = turning_rad_s - joint_rad_s
        reach_rad, acceleration_max_rad_s2 = self._reaches[axis]
        braking_rad = speed_rad_s**2 / (2.0 * acceleration_max_rad_s2)
        reaches = max(abs(gap_rad), braking_rad) / reach_rad
        short_rad = self._meetings[axis].short_rad(start_s, joint_rad, aim_rad, turning_rad_s, sigma_rad)
        if short_rad is not None:
            reference_rad = reference_rad - short_rad
            if not reaches > 1.0:
                return self.meeting_ocps[axis][self._level(sigma_rad)].solve(state, reference_rad)
        elif not reaches > 1.0:
            return self.ocps[axis][self._level(sigma_rad)].solve(state, reference_rad + further_rad)
        # Too fast to stop before the person, it comes from where it is going away.
        from_below = gap_rad > 0.0 if abs(gap_rad) > braking_rad else speed_rad_s < 0.0
        before_rad = _SHORT_S * abs(speed_rad_s)
        not_past_rad = np.full((2, self._steps), [[-_FAR_RAD], [_FAR_RAD]])
        not_past_rad[int(from_below)] = reference_rad - before_rad if from_below else reference_rad + before_rad
        return self.catch_up_ocps[axis][self._level(sigma_rad / reaches)].solve(state, reference_rad, not_past_rad)

    def _level(self, sigma_rad: float) -> int:
        if not sigma_rad < math.inf:
            return _LEVELS - 1
        octaves = 0.5 * math.log2(1.0 + (sigma_rad / self._doubt_rad) ** 2)
        return min(round(_LEVELS_PER_OCTAVE * octaves), _LEVELS - 1)
