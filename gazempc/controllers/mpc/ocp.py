"""The optimal control problem of one joint, condensed once to a quadratic program whose matrices never change.

With z0 the joint and its command at the start, J the command's jerks over n steps of h_k control periods, and joint
angle Q, velocity V and acceleration A at the ends of these steps (all linear in z0 and J), the problem is

    minimise    sum_k w_k ((Q_k - r_k)^2 + d T^2 (V_k - r'_k)^2 + T^4 A_k^2) + T_j^6 sum_k h_k j_k^2 + rho sum(s)
    subject to  |J| <= j_max,   low - s <= L C <= high + s,   s >= 0

where r are the reference angles, r' their central differences, w_k is half of the steps before and after the end of
step k, d = 4 zeta^2 - 2, and L C are the command's positions, velocities half a step on and accelerations. While no
limit binds, the solution is a constant matrix times [z0; 1; r]; only where one does, a QP solver is asked. Should that
give up, the motion without limits is the answer: the smoother keeps them. See docs/controllers.md for the reasons.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np

from gazempc.controllers.controller import SolverFailed
from gazempc.controllers.mpc.axis_model import STATE, AxisModel
from gazempc.controllers.mpc.qp import ITERATIONS, Daqp, QpData
from gazempc.types import FloatArray

# The damping ratio at which d is zero: what a quadratic cost of error and acceleration alone gives.
PLAIN_DAMPING = math.sqrt(0.5)
# Angles not to be passed are rows in so large a unit that all limits are kept before them.
PASSING_UNIT_RAD = 150.0
# The cost is counted in squared hundredths of a radian, so that solvers' absolute tolerances suit it.
_COST_SCALE = 1e4
# Exact penalty: dearer than the gaze error that leaving a limit could save; slacks are shares of the limits.
_SLACK_PENALTY = 300.0 * _COST_SCALE
# Weight of the command's jerk, as a time to the sixth power: what the joint would hardly show is not done.
_JERK_TIME_S = 0.025
# A limit that is left by less than this share of it is rounding.
_ROUNDING = 1e-9
# Solvers keep limits to their own tolerance; only more than this is called a limit left.
_SOFTENED = 1e-5
_PARAMETERS = len(STATE) + 1


class Program(NamedTuple):
    """What stays of the quadratic program of one joint: its arrays cannot be written to.

    Attributes:
        data: The matrices that a solver needs.
        cost_map: Linear cost from the parameters [z0; 1; r].
        rows_from_state: The soft rows without jerk, from [z0; 1].
        gain: Best jerks without limits, then rows and knots at these, from the parameters.
    """

    data: QpData
    cost_map: FloatArray
    rows_from_state: FloatArray
    gain: FloatArray


# Two programs a joint for four controllers. Safe: a model never changes and is its own key; a program is read-only.
@lru_cache(maxsize=16)
def condense(model: AxisModel, smoothing_time_s: float, damping: float, bounded: bool) -> Program:
    """Build the matrices of one program, the same one for the same arguments, which are those of `AxisOcp`."""
    n = model.lengths.size
    turning = math.sqrt(max(4.0 * damping**2 - 2.0, 0.0)) * smoothing_time_s
    # What the cost squares, from [z0; 1; jerks], and what it is to be, from the reference.
    squared = np.vstack([model.joint, turning * model.velocity, smoothing_time_s**2 * model.acceleration])
    slopes: FloatArray = np.asarray(np.gradient(np.eye(n), model.times_s, axis=0))
    aims = np.vstack([np.eye(n), turning * slopes, np.zeros((n, n))])
    by_state, by_jerk = squared[:, :_PARAMETERS], squared[:, _PARAMETERS:]
    weights = 0.5 * (model.lengths + np.append(model.lengths[1:], model.lengths[-1]))
    weighed = by_jerk.T * (2.0 * _COST_SCALE * np.tile(weights, 3))
    jerk_weight = 2.0 * _COST_SCALE * (_JERK_TIME_S**3 * model.jerk_scale) ** 2
    hessian = weighed @ by_jerk + jerk_weight * np.diag(model.lengths)
    cost_map = weighed @ np.hstack([by_state, -aims])
    rows = model.rows
    if bounded:
        rows = np.vstack([rows, model.joint / PASSING_UNIT_RAD])
    best = -np.linalg.solve(hessian, cost_map)
    shown = np.vstack([rows, model.knots])
    at_best = shown[:, _PARAMETERS:] @ best
    at_best[:, :_PARAMETERS] += shown[:, :_PARAMETERS]
    parts = hessian, rows[:, _PARAMETERS:], cost_map, rows[:, :_PARAMETERS], np.vstack([best, at_best])
    hessian, a, cost_map, rows_from_state, gain = (np.ascontiguousarray(part) for part in parts)
    for shared in (hessian, a, cost_map, rows_from_state, gain):
        shared.setflags(write=False)
    return Program(QpData(h=hessian, a=a, penalty=_SLACK_PENALTY), cost_map, rows_from_state, gain)


@dataclass(frozen=True)
class Solution:
    """The best motion of one joint's command.

    Attributes:
        scaled_jerk: Jerk in each step, as a share of `AxisModel.jerk_scale`, shape (n,).
        command: Position, velocity and acceleration at the end of each of the first K control periods, shape (3, K),
            rad, rad/s, rad/s^2.
        softened: By how much a limit of position, velocity or acceleration is left at most, as a share of that limit; 0
            if all are kept.
        solver: ``gain`` where no limit binds, ``daqp`` where one does; ``none`` if the solver gave up, and the motion
            is the best one without limits.
    """

    scaled_jerk: FloatArray
    command: FloatArray
    softened: float
    solver: Literal["gain", "daqp", "none"]


class AxisOcp:
    """The optimal control problem of one joint; condensed once, solved with new data every control tick.

    Args:
        model: The joint over the horizon.
        smoothing_time_s: T: gaze motion faster than 1 / T (rad/s) is smoothed away rather than followed.
        damping: zeta of the way to a reference that has jumped, not below `PLAIN_DAMPING`.
        bounded: True for a joint that is given angles that it is not to pass, see `solve`.
        iterations: Most iterations of the solver, which bound its time.

    Attributes:
        model: The joint over the horizon.
        program: What stays of the quadratic program; its soft rows are those of the model, and then, if bounded, the
            joint's n angles.
    """

    def __init__(
        self,
        model: AxisModel,
        smoothing_time_s: float,
        damping: float = PLAIN_DAMPING,
        bounded: bool = False,
        iterations: int = ITERATIONS,
    ) -> None:
        self.model = model
        self.program = condense(model, smoothing_time_s, damping, bounded)
        self._n, self._limits_end = model.lengths.size, 4 * model.lengths.size
        self._rows = len(self.program.rows_from_state)
        self._iterations = iterations
        self._solver: Daqp | None = None

    def reset(self) -> None:
        """Forget earlier programs."""
        if self._solver is not None:
            self._solver.reset()

    def changing(
        self, parameters: FloatArray, not_past_rad: tuple[FloatArray, FloatArray] | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The part of the quadratic program that changes.

        Args:
            parameters: [z0; 1; r], shape (6 + n,).
            not_past_rad: As in `solve`.

        Returns:
            Linear cost g, shape (n,); lower and upper bounds of the soft rows.
        """
        rows = self.program.rows_from_state @ parameters[:_PARAMETERS]
        lower, upper = -1.0 - rows, 1.0 - rows
        if not_past_rad is not None:
            passing, end = rows[3 * self._n :], 3 * self._n
            lower[end:] = not_past_rad[0] / PASSING_UNIT_RAD - passing
            upper[end:] = not_past_rad[1] / PASSING_UNIT_RAD - passing
        return self.program.cost_map @ parameters, lower, upper

    def command(self, state: FloatArray, scaled_jerk: FloatArray) -> FloatArray:
        """Position, velocity and acceleration of the command, shape (3, K), that jerks make of a state."""
        knots: FloatArray = self.model.knots @ np.concatenate([state, (1.0,), scaled_jerk])
        return knots.reshape(3, -1)

    def solve(
        self, state: FloatArray, reference_rad: FloatArray, not_past_rad: tuple[FloatArray, FloatArray] | None = None
    ) -> Solution:
        """Solve for one control tick.

        Args:
            state: [q, q', u, u', u'']: joint one dead time from now, command now; shape (5,), SI units.
            reference_rad: Angles that look at the forecast head at the ends of the steps, shape (n,), radians.
            not_past_rad: If bounded, the joint's least and greatest angles at the ends of the steps, shape (n,) each,
                radians; passing them is dear, yet cheaper than leaving a limit.

        Returns:
            The best motion.

        Raises:
            SolverFailed: If an argument is not finite.
        """
        n, end = self._n, self._limits_end
        parameters = np.concatenate((state, (1.0,), reference_rad))
        free = self.program.gain @ parameters
        most = float(np.maximum.reduce(np.abs(free[:end])))
        if not most < math.inf:
            raise SolverFailed("state or reference is not finite")
        angles_rad = free[end : end + n] * PASSING_UNIT_RAD  # if bounded
        passes = not_past_rad is not None and ((angles_rad < not_past_rad[0]) | (angles_rad > not_past_rad[1])).any()
        if most <= 1.0 + _ROUNDING and not passes:
            return Solution(free[:n], free[n + self._rows :].reshape(3, -1), 0.0, "gain")
        if self._solver is None:
            self._solver = Daqp(self.program.data, self._iterations)
        g, lower, upper = self.changing(parameters, not_past_rad)
        found = self._solver.solve(g, lower, upper)
        if found is None:
            return Solution(free[:n], free[n + self._rows :].reshape(3, -1), max(most - 1.0, 0.0), "none")
        jerk = np.minimum(np.maximum(found, -1.0), 1.0)
        rows = (self.program.data.a @ jerk)[: 3 * n] + 1.0 - upper[: 3 * n]
        left = float(np.maximum.reduce(np.abs(rows))) - 1.0
        return Solution(jerk, self.command(state, jerk), left if left > _SOFTENED else 0.0, "daqp")
