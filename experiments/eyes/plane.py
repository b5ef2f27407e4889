"""The quadratic program of one plane: the head's joint and the eyes' joint share one gaze.

With head angle H, eye angle E (in the head), accelerations A and jerks J, all linear in the states at the start and in
the jerks of both commands, the problem is

    minimise    sum_k w_k ((H_k + E_k - r_k)^2 + c^2 E_k^2 + T_e^4 AE_k^2) + sum_i w_i T_h^4 AH_i^2 + jerks + rho sum(s)
    subject to  |J| <= j_max,   low - s <= L C <= high + s,   s >= 0

at the ends of the eyes' steps k and of the head's steps i. The head acts after its own, longer dead time: before that
its angles are known. The rows of the limits are those of `gazempc.controllers.mpc.problem`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gazempc.controllers.mpc.condense import COST_SCALE, AxisModel, condense
from gazempc.controllers.mpc.problem import JERK_TIME_S, SLACK_PRICE_RAD2, Tuning
from gazempc.controllers.mpc.qp import Daqp, QpData
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
