"""Model-predictive control of the gaze, with dead-time compensation and within the limits of the neck."""

from __future__ import annotations

import math

import numpy as np

from gazempc.controllers.chain import Chain, head_time_s, slopes
from gazempc.controllers.controller import ControllerError, JointPlan, Plan, Situation
from gazempc.controllers.mpc.acquisition import ACQUISITION_DAMPING, Acquisition
from gazempc.controllers.mpc.condense import axis_model, growing_steps
from gazempc.controllers.mpc.ocp import AxisOcp, Solution
from gazempc.controllers.mpc.own import OwnChoice, own_parts
from gazempc.controllers.mpc.problem import Tuning
from gazempc.controllers.mpc.qp import iterations_within
from gazempc.errors import SettingsError
from gazempc.neck.kinematics import angle_deviations_rad
from gazempc.neck.picture import FramedPicture, Framing
from gazempc.neck.spec import AXES, NeckSpec
from gazempc.settings import MpcSettings
from gazempc.types import FloatArray

# Length of a plan, seconds: more than a control period, to bridge a late successor.
_PLAN_S = 0.4
# Default of T. Unforeseen motion is followed with a delay of dead time, lag and about 1.4 T, so T is limited to a share
# of dead time and lag: for the neck `reachy_mini` (0.12 s) T = 0.12 s has a fifth more error than 0.074 s before people
# who sit and stand (nine bags of a face tracker). Below 0.07 s the overshoot of a step at the acceleration limit
# exceeds 5 %.
LONGEST_TIME_S, SHORTEST_TIME_S = 0.12, 0.07
_SHARE_OF_DELAY = 0.62
# T of the head of a neck with eyes, which compensate its lag.
_HEAD_TIME_S = 0.35
# Share of a control period that the solvers of both joints together may take.
_SOLVERS_SHARE = 0.5
# Below this speed a joint of a camera counts as at rest.
_MOVES_RAD_S = 0.01
_DEFAULTS, _NO_FRAMING = MpcSettings(), Framing(subject="no")


class Mpc:
    """Optimises the command's jerk over a receding horizon that starts at the end of the dead time.

    The commands already sent determine the joint's state at the end of the dead time. From there on the forecast head
    positions give reference angles. One quadratic program a joint (`gazempc.controllers.mpc.problem`) computes a smooth
    motion that tracks them within the limits. For a large tracking error a second program, faster and better damped,
    takes over (`gazempc.controllers.mpc.acquisition`).

    Args:
        neck: The neck.
        horizon_s: Length of the optimised motion after the dead time, seconds.
        smoothing_time_s: T: gaze motion faster than the inverse of this time (in rad/s) is smoothed rather than
            followed; larger is smoother and less exact. None: 0.12, for a neck with less than 0.2 s of dead time and
            lag 0.62 of these, at least 0.07.
        acquisition_time_s: T during acquisition of a person far off the gaze; at most `smoothing_time_s` is used.
        head_smoothing_time_s: T of the head of a neck with eyes. None: 0.35, or 0.1 if the eyes have a share of the
            angle, as people turn such a head at top speed.
        terms: Own costs: functions of `gazempc.controllers.mpc.problem.Trajectory` whose value, a convex quadratic
            scalar in rad^2 times control periods, is added to the cost of pan and of tilt; or such lists by the
            joint's name.
        rows: Own limits: functions whose values, linear and a column of any length, are kept within +-1 as soft rows;
            given as the terms.
        framing: Keeps the head within a zone of the picture of a camera on the neck, with a separate horizon and T.

    Raises:
        SettingsError: If the horizon is shorter than two smoothing times: its end would affect the gaze. If an own
            part is not convex quadratic, not linear, infeasible, not finite, of the wrong shape or of other symbols.

    Attributes:
        neck: The neck.
        ocps: The programs of pan and of tilt.
        acquisition_ocps: The same during acquisition.
        picture: The picture of the framing; None without one.
    """

    def __init__(
        self,
        neck: NeckSpec,
        horizon_s: float = _DEFAULTS.horizon_s,
        smoothing_time_s: float | None = _DEFAULTS.smoothing_time_s,
        acquisition_time_s: float = _DEFAULTS.acquisition_time_s,
        head_smoothing_time_s: float | None = _DEFAULTS.head_smoothing_time_s,
        terms: OwnChoice = (),
        rows: OwnChoice = (),
        framing: Framing = _NO_FRAMING,
    ) -> None:
        self.picture = FramedPicture.of(framing, neck)
        if self.picture is not None:
            horizon_s, smoothing_time_s = framing.horizon_s, framing.smoothing_time_s
        elif neck.eyes is not None:
            smoothing_time_s = head_time_s(neck, head_smoothing_time_s, _HEAD_TIME_S)
        elif smoothing_time_s is None:
            delay_s = float(np.max((neck.dead_time_s + neck.servo_lag_s)[: len(AXES)]))
            smoothing_time_s = min(max(_SHARE_OF_DELAY * delay_s, SHORTEST_TIME_S), LONGEST_TIME_S)
        if horizon_s < 2.0 * smoothing_time_s:
            group = "mpc" if self.picture is None else "framing"
            needed = (
                f"for {group}.smoothing_time_s: {smoothing_time_s:g} s; accepted: at least {2.0 * smoothing_time_s:g} s"
            )
            raise SettingsError(f"{group}.horizon_s: {horizon_s:g} s is too short {needed}")
        self.neck = neck
        period_s = neck.control_period_s
        lengths = growing_steps(horizon_s, period_s)
        n, knots = len(lengths), max(1, min(round(_PLAN_S / period_s), sum(lengths)))
        models = [axis_model(neck, i, lengths, knots) for i in range(len(AXES))]
        own = [own_parts(terms, rows, name) for name in AXES]
        most = iterations_within(0.5 * _SOLVERS_SHARE * period_s, n)

        def programs(tuning: Tuning, bounded: bool) -> list[AxisOcp]:
            return [AxisOcp(model, tuning, bounded, most, parts) for model, parts in zip(models, own, strict=True)]

        if self.picture is not None:
            self.ocps = self.acquisition_ocps = programs(Tuning(smoothing_time_s, ACQUISITION_DAMPING, zone=True), True)
        else:
            self.ocps = programs(Tuning(smoothing_time_s), False)
            quick = Tuning(min(acquisition_time_s, smoothing_time_s), ACQUISITION_DAMPING)
            self.acquisition_ocps = programs(quick, True)
        # The first knot is the command before the plan starts.
        self._knots_s: FloatArray = period_s * np.arange(1.0, knots + 1) - neck.servo_period_s
        self._chain = Chain(neck, self._knots_s)
        self._acquisitions = [Acquisition(neck, i, smoothing_time_s) for i in range(len(AXES))]
        # The first jerk acts from the last command before the plan: it already changes the first command sent.
        self._times_s = models[0].times_s
        self._between_s = float(self._times_s[1] - self._times_s[0])
        self._length_s = float(self._times_s[-1] - self._times_s[0])
        # Both joints share the forecast if their dead times are equal.
        dead_times_s = neck.dead_time_s[:1] if neck.dead_time_s[0] == neck.dead_time_s[1] else neck.dead_time_s[:2]
        self._pan_ahead_s: FloatArray = neck.dead_time_s[0] + self._times_s
        self._head_ahead_s: FloatArray = np.concatenate([dead_s + self._times_s for dead_s in dead_times_s])
        self._forecasts_of = {"pan": slice(0, n), "tilt": slice(self._head_ahead_s.size - n, self._head_ahead_s.size)}
        self.reset()

    def reset(self) -> None:
        """Discard warm starts and the states of acquisition and zone."""
        # Sign of the last velocity of pan and tilt.
        self._ways = [0.0] * len(AXES)
        # Time for which the forecast has been outside of the zone; it decreases inside.
        self._outside_s = [0.0] * len(AXES)
        for acquisition in self._acquisitions:
            acquisition.reset()
        for ocp in self.ocps + self.acquisition_ocps:
            ocp.reset()

    def forecast_times_s(self, start_s: float, newest_capture_s: float) -> FloatArray:
        """End of each step of the horizon plus the dead time, shape (n,).

        With different dead times: first pan, then tilt, shape (2 n,). The times of the eyes follow, see
        `Chain.eye_times_s`.
        """
        return np.concatenate([start_s + self._head_ahead_s, self._chain.eye_times_s(start_s)])

    def plan(self, situation: Situation) -> Plan:
        """See `gazempc.controllers.controller.Controller.plan`."""
        means_base_m, head_times = situation.forecast.means_base_m, self._head_ahead_s.size
        angles = self._chain.head_rad(situation, means_base_m[:head_times])
        if self.picture is not None:
            # Mean rate over the plan: the rate of a single step is dominated by forecast noise.
            angles = self.picture.aim_rad(angles, self._mean_rate(angles[: self._times_s.size, 0]))
        references = {name: angles[self._forecasts_of[name], i] for i, name in enumerate(AXES)}
        head, body_rad = list[JointPlan](), None
        command = situation.command
        now = np.array((command.position_rad, command.velocity_rad_s, command.acceleration_rad_s2))
        if self._chain.body is not None:
            toward_rad = np.interp(self._knots_s, self._times_s, references["pan"])
            body_rad = self._chain.body.commands_rad(situation, toward_rad)
            references["pan"] -= self._chain.body.angles_rad(situation, body_rad, self._pan_ahead_s)
        quick = self._chain.eyes_held(situation).tolist() if situation.held else [False] * len(AXES)
        events, faults = list[str](), list[ControllerError]()
        for i, name in enumerate(AXES):
            solution = self._solve(i, situation, now[:, i], references[name], quick[i])
            # First knot: the last command before the plan.
            head.append(JointPlan(*np.column_stack((now[:, i], solution.command))))
            self._note(i, solution, events, faults)
        head_rad = np.stack([joint.position_rad[1:] for joint in head], axis=-1)
        commands_rad = self._chain.with_eyes(situation, means_base_m[head_times:], head_rad, body_rad)
        events += self._chain.events(commands_rad[0])
        joints = np.array([*head, *map(self._sampled, commands_rad.T[len(AXES) :])])
        position, velocity, acceleration = joints.transpose(1, 2, 0)
        start_s = situation.start_s - self.neck.servo_period_s
        period_s = self.neck.control_period_s
        return Plan(start_s, period_s, position, velocity, acceleration, tuple(events), tuple(faults))

    def _solve(
        self, axis: int, situation: Situation, command: FloatArray, reference_rad: FloatArray, quick: bool
    ) -> Solution:
        # Python floats: NumPy scalars take several times as long.
        offset_rad = float(situation.joint_offset_rad[axis])
        joint_rad = float(situation.position_after_dead_time_rad[axis]) - offset_rad
        joint_rad_s = float(situation.velocity_after_dead_time_rad_s[axis])
        state = np.concatenate(((joint_rad, joint_rad_s), command))
        # The model has no offset.
        reference_rad = reference_rad - offset_rad
        if self.picture is not None:
            zone_rad = self._zone_rad(self.picture, axis, situation, reference_rad, state)
            return self.ocps[axis].solve(state, reference_rad, zone_rad)
        turning_rad_s = float(reference_rad[1] - reference_rad[0]) / self._between_s
        bounds_rad = self._acquisitions[axis].bounds_rad(joint_rad, joint_rad_s, reference_rad, turning_rad_s)
        # A held eye does not compensate the smoothing of the head.
        if bounds_rad is None and not quick:
            return self.ocps[axis].solve(state, reference_rad)
        return self.acquisition_ocps[axis].solve(state, reference_rad, bounds_rad)

    def _zone_rad(
        self, picture: FramedPicture, axis: int, situation: Situation, reference_rad: FloatArray, state: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        joint_rad, joint_rad_s = float(state[0]), float(state[1])
        # Hysteresis: the zone is wider on the side that a reversal would leave.
        if abs(joint_rad_s) > _MOVES_RAD_S:
            self._ways[axis] = math.copysign(1.0, joint_rad_s)
        forecast, of_axis = situation.forecast, self._forecasts_of[AXES[axis]]
        pairs = zip(forecast.means_base_m[of_axis], forecast.covariances_m2[of_axis], strict=True)
        deviation_rad = np.array([angle_deviations_rad(mean, covariance)[axis] for mean, covariance in pairs])
        delay_s = situation.start_s + float(self.neck.dead_time_s[axis]) - forecast.issued_at_s
        turning_rad_s = self._mean_rate(reference_rad)
        half_rad = picture.planned_zone_rad(axis, turning_rad_s)
        outside = abs(float(np.mean(reference_rad)) - joint_rad) > half_rad
        seconds = self._outside_s[axis] + math.copysign(self.neck.control_period_s, outside - 0.5)
        longest_s = picture.excursion_s(delay_s)
        self._outside_s[axis] = min(max(seconds, 0.0), longest_s)
        # A rate within one standard deviation of the forecast counts as zero.
        certain_rad_s = abs(turning_rad_s) - float(np.mean(deviation_rad)) / self._length_s
        widening_rad = picture.widening_rad(axis, max(certain_rad_s, 0.0), self._outside_s[axis] / longest_s)
        wider_rad = self._ways[axis] * picture.turns_back_rad(axis, delay_s, deviation_rad)
        low_rad = np.minimum(wider_rad, -widening_rad) - half_rad
        high_rad = np.maximum(wider_rad, widening_rad) + half_rad
        return reference_rad + low_rad, reference_rad + high_rad

    def _mean_rate(self, angles_rad: FloatArray) -> float:
        return float(angles_rad[-1] - angles_rad[0]) / self._length_s

    def _sampled(self, position_rad: FloatArray) -> JointPlan:
        # Eyes and body start by linear extrapolation. A start at the present command would add a
        # transient to slow eyes.
        position_rad = np.concatenate(([2.0 * position_rad[0] - position_rad[1]], position_rad))
        velocity_rad_s = slopes(position_rad[:, None], self.neck.control_period_s)[:, 0]
        return JointPlan(position_rad, velocity_rad_s, np.zeros_like(position_rad))

    def _note(self, axis: int, solution: Solution, events: list[str], faults: list[ControllerError]) -> None:
        gave_up, own = solution.solver == "none", self.ocps[axis].own
        event = "solver_gave_up" if gave_up else "limits_softened" if solution.softened else ""
        if event and own:
            faults.append(ControllerError(f"{AXES[axis]}, with own parts: {own.labels}", event))
        elif event:
            events.append(event)
        if solution.own_softened:
            labels = ", ".join(solution.own_softened)
            text = f"{AXES[axis]}: {labels}: no motion keeps it within +-1"
            faults.append(ControllerError(text, "own_row_softened"))
