"""The optimal control problem of one joint, condensed once to a quadratic program whose matrices never change.

After the dead time the joint is a linear system. With z = [q, q', u, u', u''] (joint angle and velocity, command,
its velocity and acceleration) and the command's jerk j as the input, one servo period is ``z+ = M z + m j``: the
command is integrated three times, then held while the servo follows. The jerk is constant over steps h_1 .. h_n, each
a control period h long; the first of them, which is all that is sent before the next plan, may be cut into parts.
Rolled over the horizon of N control periods, everything of interest is linear in the initial state z0 and the jerks
J = (j_1 .. j_n):

    joint angle    Q = Qz z0 + Qj J        joint velocity  V = Vz z0 + Vj J
    joint acceleration  A = Az z0 + Aj J   command and its derivatives  C = Cz z0 + Cj J

and the problem is

    minimise    sum_k ((Q_k - r_k)^2 + d T^2 (V_k - r'_k)^2 + T^4 A_k^2) + T_j^6 sum_k j_k^2 h_k/h + rho sum(s)
    subject to  |J| <= j_max,   low - s <= L C <= high + s,   s >= 0

where r are the reference angles from the look-at kinematics and r' their central differences, and L C are the
command's positions, its velocities half a step on (which bounds the velocity between the steps, too) and its
accelerations. Without limits the joint comes to a reference that has jumped like a second-order system of natural
frequency 1 / T and damping ratio zeta, where d = 4 zeta^2 - 2. Gaze error and gaze motion are the joint's times what
a radian of the joint is worth in gaze (cos(tilt) for pan): all terms scale alike, so the factor cancels, and the
Hessian is one constant matrix for each smoothing time T. While no limit binds, the solution is therefore a constant
matrix times [z0; 1; r], which also says whether a limit binds; only where one does, a QP solver is asked.

A joint that is catching up with its reference has rows for Q, too, in a unit so large that all limits come first.

The slacks s are zero whenever the limits can be kept; they let a start outside the limits be solved instead of
refused. Limits on the command alone also keep the joint inside the neck's limits, see
`gazempc.neck.spec.Axis.servo_gain`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gazempc.controllers.mpc.axis_model import AxisModel
from gazempc.controllers.mpc.prediction import STATE
from gazempc.controllers.mpc.program import DAMPING, PASSING_UNIT_RAD, condense
from gazempc.controllers.mpc.qp import Daqp, Piqp, QpData, QpSolver
from gazempc.types import FloatArray

# A limit that is left by less than this share of it is rounding.
_ROUNDING = 1e-9
# Solvers keep limits to their own tolerance; only more than this is called a limit left.
_SOFTENED = 1e-5


@dataclass(frozen=True)
class Solution:
    """The best motion of one joint's command.

    Attributes:
        scaled_jerk: Jerk in each step, as a share of `AxisModel.jerk_scale`, shape (n,).
        command: Position, velocity and acceleration at the end of each step, shape (3, n), rad, rad/s, rad/s^2.
        softened: By how much a limit of position, velocity or acceleration is left at most, as a share of that limit; 0
            if all are kept.
        solver: What found it: ``gain`` where no limit binds, else the QP solver's name.
    """

    scaled_jerk: FloatArray
    command: FloatArray
    softened: float
    solver: str


class SolverFailedError(RuntimeError):
    """No solver returned a trustworthy solution.

    Attributes:
        timed_out: True if the last one was stopped at its limit of iterations.
    """

    def __init__(self, message: str, timed_out: bool = False) -> None:
        super().__init__(message)
        self.timed_out = timed_out


class AxisOcp:
    """The optimal control problem of one joint; condensed once, solved with new data every control tick.

    Args:
        model: The joint over the horizon.
        smoothing_time_s: T: gaze motion faster than 1 / T (rad/s) is smoothed away rather than followed.
        damping: zeta of the way to a reference that has jumped: at 0.8 it is passed by 1.5 % of the jump.
        catching_up: True for a joint on its way to a reference far off: it is given bounds that it is not to pass, see
            `solve`.
        solvers: Makers of the QP solvers, in the order in which they are tried. Each is made when it is first needed.
            DAQP is the faster by far; should it give up, PIQP hardly ever does.

    Attributes:
        model: The joint over the horizon.
        data: The part of the quadratic program that stays; x is the scaled jerks, the soft rows are the model's. When
            catching up late jerks share a variable, and rows for the joint's N angles follow.
        variable_of_step: Which variable of the program is the jerk of each step, shape (n,).
    """

    def __init__(
        self,
        model: AxisModel,
        smoothing_time_s: float,
        damping: float = DAMPING,
        catching_up: bool = False,
        solvers: Sequence[Callable[[QpData], QpSolver]] = (Daqp, Piqp),
    ) -> None:
        self.model = model
        program = condense(model, smoothing_time_s, damping, catching_up)
        self.data, self.variable_of_step = program.data, program.variable_of_step
        self._cost_map, self._gain, self._rows_from_state = program.cost_map, program.gain, program.rows_from_state
        self._makers = solvers
        self._solvers: list[QpSolver] = []

    def reset(self) -> None:
        """Forget earlier programs, see `QpSolver.reset`."""
        for solver in self._solvers:
            solver.reset()

    def parameters(self, state: FloatArray, reference_rad: FloatArray) -> FloatArray:
        """What the program depends on: [z0; 1; r].

        Args:
            state: [q, q', u, u', u'']: joint one dead time from now, command now; shape (5,), SI units.
            reference_rad: Angles that look at the forecast head, shape (N,), radians.

        Returns:
            Shape (N + 6,).
        """
        parameters = np.ones(self.model.steps + len(STATE) + 1)
        parameters[: len(STATE)] = state
        parameters[len(STATE) + 1 :] = reference_rad
        return parameters

    def program(
        self, parameters: FloatArray, not_past_rad: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The part of the quadratic program that changes.

        Args:
            parameters: From `parameters`.
            not_past_rad: As in `solve`.

        Returns:
            Linear cost g, one for each variable; lower and upper bounds of the soft rows, shape (3 n,), or (3 n + N,)
            when catching up.
        """
        most = np.ones((2, len(self._rows_from_state)))
        if not_past_rad is not None:
            most[:, 3 * self.model.shares.size :] = [[-1.0], [1.0]] * (not_past_rad / PASSING_UNIT_RAD)
        rows = self._rows_from_state @ parameters[: len(STATE) + 1]
        return self._cost_map @ parameters, -most[0] - rows, most[1] - rows

    def solve(self, state: FloatArray, reference_rad: FloatArray, not_past_rad: FloatArray | None = None) -> Solution:
        """Solve for one control tick; arguments as in `parameters`.

        Args:
            state: See `parameters`.
            reference_rad: See `parameters`.
            not_past_rad: When catching up, the joint's least and greatest angles at the end of each step, shape (2, N),
                radians; passing them is dear, yet cheaper than leaving a limit.

        Returns:
            The best motion.

        Raises:
            SolverFailedError: If an argument is not finite, or all solvers fail or return nonsense.
        """
        n = self.model.shares.size
        parameters = self.parameters(state, reference_rad)
        free = self._gain @ parameters
        most = np.maximum.reduce(np.abs(free[: 4 * n]))
        passing = not_past_rad is not None and _outside(free[4 * n :] * PASSING_UNIT_RAD, not_past_rad)
        if most <= 1.0 + _ROUNDING and not passing:
            return Solution(free[:n], self.model.command(free[n : 4 * n]), 0.0, "gain")
        if not np.isfinite(most):
            raise SolverFailedError("state or reference is not finite")
        g, lower, upper = self.program(parameters, not_past_rad)
        for k, maker in enumerate(self._makers):
            if k == len(self._solvers):
                self._solvers.append(maker(self.data))
            solver = self._solvers[k]
            result = solver.solve(g, lower, upper)
            if result.status == "solved":
                jerk = np.minimum(np.maximum(result.x, -1.0), 1.0)[self.variable_of_step]
                rows = self.model.rows_from_jerk @ jerk
                rows += 1.0 - upper[: 3 * n]
                left = np.abs(rows).max() - 1.0
                return Solution(jerk, self.model.command(rows), left if left > _SOFTENED else 0.0, solver.name)
        raise SolverFailedError(f"{solver.name} {result.status.replace('_', ' ')}", result.status == "timed_out")


def _outside(angles_rad: FloatArray, bounds_rad: FloatArray) -> bool:
    return bool(np.any((angles_rad < bounds_rad[0]) | (angles_rad > bounds_rad[1])))
