"""A controller that plans head and eyes together, one program a plane: ``experiments.eyes.one_program:OneProgram``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gazempc.controllers.controller import Plan, Situation
from gazempc.controllers.mpc.condense import COST_SCALE, AxisModel, condense
from gazempc.controllers.mpc.problem import JERK_TIME_S, SLACK_PRICE_RAD2, Tuning
from gazempc.controllers.mpc.qp import Daqp, QpData
from gazempc.errors import SettingsError
from gazempc.neck.ahead import JointAhead
from gazempc.neck.kinematics import eye_angles_rad
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# The eyes are five times as fast as the head.
_EYE_JERK_TIME_S = 0.005
# A step lasts for this share of the time that has passed when it begins.
_SHARE_OF_TIME = 0.3
_ROUNDING = 1e-9
_STATE = 5


@dataclass(frozen=True)
class Weights:
    """What the program weighs.

    Attributes:
        head_time_s: T_h of the cost.
        eye_time_s: T_e of the cost.
        comfort: c, cost of a degree of the eyes off their middle, as a share of that of a degree of gaze error.
        horizon_s: Length of the head's optimised motion, seconds.
    """

    head_time_s: float
    eye_time_s: float
    comfort: float
    horizon_s: float


class PlanePlan:
    """The program of one plane, condensed once.

    Args:
        neck: A neck with eyes.
        plane: 0 for pan, 1 for tilt.
        weights: What the program weighs.
        plan_s: Length of the plan's commands, seconds.

    Attributes:
        times_s: Ends of the eyes' steps after the eyes' dead time, shape (n,), seconds.
        known: Number of these at which the head's angle is known, as its dead time is longer.
        knots: Number of control periods of commands, K.
    """

    def __init__(self, neck: NeckSpec, plane: int, weights: Weights, plan_s: float) -> None:
        period_s = neck.control_period_s
        gap = max(0, round((neck.dead_time_s[plane] - neck.dead_time_s[2 + plane]) / period_s))
        late = _growing(round(weights.horizon_s / period_s))
        lengths = _growing(gap) + late
        self.knots = min(round(plan_s / period_s), sum(late))
        self._head, self._eye = (
            AxisModel(neck, plane, late, self.knots),
            AxisModel(neck, 2 + plane, lengths, self.knots),
        )
        self.times_s = self._eye.times_s
        n, m = len(lengths), len(late)
        self.known = n - m
        # Columns: states of head and eye, 1, known angles of the head, references; then jerks of head and of eye.
        self._parameters = 2 * _STATE + 1 + self.known + n
        self._split = m
        at = {"head": (0, self._parameters), "eye": (_STATE, self._parameters + m)}

        def lifted(rows: FloatArray, joint: str) -> FloatArray:
            wide = np.zeros((len(rows), self._parameters + m + n))
            state, jerk = at[joint]
            wide[:, state : state + _STATE] = rows[:, :_STATE]
            wide[:, 2 * _STATE] = rows[:, _STATE]
            wide[:, jerk : jerk + rows.shape[1] - _STATE - 1] = rows[:, _STATE + 1 :]
            return wide

        eye, head = self._eye, self._head
        angle = lifted(eye.joint, "eye")
        gaze = angle.copy()
        gaze[self.known :] += lifted(head.joint, "head")
        first = 2 * _STATE + 1
        gaze[np.arange(self.known), first + np.arange(self.known)] = 1.0
        gaze[np.arange(n), first + self.known + np.arange(n)] -= 1.0
        jerks = np.zeros((m + n, self._parameters + m + n))
        jerks[:, self._parameters :] = np.diag(
            np.repeat([JERK_TIME_S**3 * head.jerk_scale, _EYE_JERK_TIME_S**3 * eye.jerk_scale], [m, n])
        )
        squared = [
            (gaze, _weights(lengths)),
            (weights.comfort * angle, _weights(lengths)),
            (weights.eye_time_s**2 * lifted(eye.acceleration, "eye"), _weights(lengths)),
            (weights.head_time_s**2 * lifted(head.acceleration, "head"), _weights(late)),
            (jerks, np.array(late + lengths, dtype=np.float64)),
        ]
        rows = np.vstack([each for each, _ in squared])
        by_jerk, by_parameter = rows[:, self._parameters :], rows[:, : self._parameters]
        weighed = by_jerk.T * (2.0 * COST_SCALE * np.concatenate([weight for _, weight in squared]))
        hessian = weighed @ by_jerk
        self._cost_map = weighed @ by_parameter
        self._gain = -np.linalg.solve(hessian, self._cost_map)
        limits = np.vstack([lifted(_limits(head), "head"), lifted(_limits(eye), "eye")])
        self._limits = limits
        soft = np.ascontiguousarray(limits[:, self._parameters :])
        self._solver = Daqp(QpData(h=np.ascontiguousarray(hessian), a=soft, penalty=COST_SCALE * SLACK_PRICE_RAD2))

    def solve(
        self, head: FloatArray, eye: FloatArray, known_rad: FloatArray, gaze_rad: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Best commands of head and eye.

        Args:
            head: Joint and command of the head after its dead time, shape (5,), see `AxisOcp.solve`.
            eye: The same of the eye.
            known_rad: Angles of the head at the first `known` times, radians.
            gaze_rad: Sums of head and eye that look at the person, shape (n,), radians.

        Returns:
            Position, velocity and acceleration of the command of the head, then of the eye, shape (3, K) each.
        """
        parameters = np.concatenate((head, eye, (1.0,), known_rad, gaze_rad))
        jerk = self._gain @ parameters
        rows = self._limits @ np.concatenate((parameters, jerk))
        if max(np.abs(jerk).max(), np.abs(rows).max()) > 1.0 + _ROUNDING:
            offset = rows - self._limits[:, self._parameters :] @ jerk
            found = self._solver.solve(self._cost_map @ parameters, -1.0 - offset, 1.0 - offset)
            # Where the solver gives up, the smoother keeps the limits.
            jerk = jerk if found is None else np.clip(found, -1.0, 1.0)
        parts = (self._head, head, jerk[: self._split]), (self._eye, eye, jerk[self._split :])
        of_head, of_eye = (
            (model.knots @ np.concatenate((state, (1.0,), part))).reshape(3, -1) for model, state, part in parts
        )
        return of_head, of_eye


def _limits(model: AxisModel) -> FloatArray:
    # The rows of the limits from [z0; 1; x], which do not depend on the tuning nor on the reference.
    program = condense(model, Tuning(1.0), False)
    return np.hstack([program.rows_map[:, : _STATE + 1], program.data.a])


def _growing(periods: int) -> tuple[int, ...]:
    lengths: list[int] = []
    while (done := sum(lengths)) < periods:
        lengths.append(min(max(1, int(_SHARE_OF_TIME * done)), periods - done))
    return tuple(lengths)


def _weights(lengths: tuple[int, ...]) -> FloatArray:
    each = np.array(lengths, dtype=np.float64)
    weights: FloatArray = 0.5 * (each + np.append(each[1:], each[-1]))
    return weights


_PLAN_S = 0.4
_PLANES = (0, 1)


class OneProgram:
    """Plans head and eyes together over the forecast; see `experiments.eyes.one_program`.

    Args:
        neck: A neck with eyes and without a body; both eyes' joints and both of the head have one dead time each.
        head_time_s: Weight of the head's smoothness, as a time.
        eye_time_s: The same of the eyes.
        comfort: Cost of a degree of the eyes off their middle, as a share of that of a degree of gaze error.
        horizon_s: Optimised motion of the head after its dead time, seconds.

    Raises:
        SettingsError: If the neck has no eyes, a body, or other dead times.
    """

    def __init__(
        self,
        neck: NeckSpec,
        head_time_s: float = 0.15,
        eye_time_s: float = 0.02,
        comfort: float = 0.12,
        horizon_s: float = 0.8,
    ) -> None:
        dead_s = neck.dead_time_s
        if neck.eyes is None or neck.body is not None or dead_s[0] != dead_s[1] or dead_s[2] != dead_s[3]:
            raise SettingsError(
                f"neck {neck.name!r}: one program needs eyes and no body; pan and tilt of the head must have one dead "
                "time, and those of the eyes"
            )
        self.neck = neck
        weights = Weights(head_time_s, eye_time_s, comfort, horizon_s)
        self._planes = [PlanePlan(neck, plane, weights, _PLAN_S) for plane in _PLANES]
        self._ahead_s: FloatArray = float(dead_s[2]) + self._planes[0].times_s
        self._motions: list[JointAhead] | None = None

    def reset(self) -> None:
        """Nothing to forget."""

    def forecast_times_s(self, start_s: float, newest_capture_s: float) -> FloatArray:
        """Ends of the eyes' steps, after the eyes' dead time, shape (n,), seconds."""
        return start_s + self._ahead_s

    def plan(self, situation: Situation) -> Plan:
        """See `gazempc.controllers.controller.Controller.plan`."""
        neck, offset_rad, command = self.neck, situation.joint_offset_rad, situation.command
        heads_rad = self._heads_rad(situation)
        # The sum of head and eye that looks at the person is exact where the head's angle is.
        gaze_rad = heads_rad + eye_angles_rad(neck.geometry, heads_rad, situation.forecast.means_base_m)
        knots = np.empty((3, self._planes[0].knots + 1, neck.joints))
        knots[:, 0] = command.position_rad, command.velocity_rad_s, command.acceleration_rad_s2
        for i, plane in enumerate(self._planes):
            head, eye = (self._state(situation, joint, knots[:, 0, joint]) for joint in (i, 2 + i))
            known_rad = heads_rad[: plane.known, i] - offset_rad[i]
            wanted_rad = gaze_rad[:, i] - offset_rad[i] - offset_rad[2 + i]
            knots[:, 1:, i], knots[:, 1:, 2 + i] = plane.solve(head, eye, known_rad, wanted_rad)
        start_s = situation.start_s - neck.servo_period_s
        return Plan(start_s, neck.control_period_s, knots[0], knots[1], knots[2])

    def _state(self, situation: Situation, joint: int, command: FloatArray) -> FloatArray:
        offset_rad = situation.joint_offset_rad[joint]
        joint_now = situation.settled_position_rad[joint] - offset_rad, situation.settled_velocity_rad_s[joint]
        return np.concatenate((joint_now, command))

    def _heads_rad(self, situation: Situation) -> FloatArray:
        """Where the head will be at the forecast's times, the last command held after those that are known."""
        if self._motions is None:
            delay_s = len(situation.committed_rad) * self.neck.servo_period_s
            ahead_s = delay_s + self._ahead_s - self.neck.servo_period_s
            self._motions = [JointAhead(self.neck.axes[i], self.neck.servo_period_s, ahead_s) for i in _PLANES]
        heads = []
        for i, motion in zip(_PLANES, self._motions, strict=True):
            held = np.full(motion.future_needed, situation.command.position_rad[i])
            offset_rad = float(situation.joint_offset_rad[i])
            angles = motion(
                float(situation.joint_position_rad[i]) - offset_rad,
                float(situation.joint_velocity_rad_s[i]),
                situation.sent_rad[:, i],
                np.concatenate((situation.committed_rad[:, i], held)),
            )
            heads.append(offset_rad + angles)
        return np.stack(heads, axis=-1)
