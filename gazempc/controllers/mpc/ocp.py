"""The program of one joint at run time: state feedback with preview while no limit binds, else DAQP.

`gazempc.controllers.mpc.problem` states the problem, `gazempc.controllers.mpc.condense` makes its constant matrices.
If the solver fails, the unconstrained optimum is returned: the smoother enforces the limits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gazempc.controllers.controller import ControllerError
from gazempc.controllers.mpc.condense import AxisModel, condense, condensed
from gazempc.controllers.mpc.own import NO_PARTS, OwnParts
from gazempc.controllers.mpc.problem import Tuning
from gazempc.controllers.mpc.qp import ITERATIONS, Daqp
from gazempc.types import FloatArray

# Relative feasibility tolerance of the unconstrained optimum and of a solver's answer.
_ROUNDING = 1e-9
_SOFTENED = 1e-5


@dataclass(frozen=True)
class Solution:
    """The optimal motion of one joint's command.

    Attributes:
        scaled_jerk: Jerk in each step, as a share of `AxisModel.jerk_scale`, shape (n,).
        command: Position, velocity and acceleration at the end of each of the first K control periods, shape (3, K),
            rad, rad/s, rad/s^2.
        softened: Largest violation of a limit of position, velocity or acceleration, as a share of that limit; 0 if
            feasible.
        own_softened: Names of the own parts with a row outside +-1.
        solver: ``gain`` if no limit is active, else ``daqp``; ``none`` if the solver failed, and the motion is the
            unconstrained optimum.
    """

    scaled_jerk: FloatArray
    command: FloatArray
    softened: float
    solver: Literal["gain", "daqp", "none"]
    own_softened: tuple[str, ...] = ()


class AxisOcp:
    """The optimal control problem of one joint; condensed once, solved with new data every control tick.

    Args:
        model: The joint over the horizon.
        tuning: Smoothing time and damping; with a zone, the bounds are one in which the joint comes to rest, in
            place of the reference.
        bounded: Whether `solve` takes bounds of the joint angle.
        iterations: Iteration limit of the solver, which bounds its time.
        own: Own costs and rows.

    Attributes:
        model: The joint over the horizon.
        program: The constant part of the quadratic program.
        own: Own costs and rows.

    Raises:
        SettingsError: If an own part is not convex quadratic, or not linear.
    """

    def __init__(
        self,
        model: AxisModel,
        tuning: Tuning,
        bounded: bool = False,
        iterations: int = ITERATIONS,
        own: OwnParts = NO_PARTS,
    ) -> None:
        self.model, self.own = model, own
        self._unit_rad = tuning.passing_unit_rad
        # Own functions may be closures over mutable values: their programs are not cached.
        self.program = (condensed if own else condense)(model, tuning, bounded, own)
        self._n, self._rows = model.lengths.size, len(self.program.rows_map)
        # Jerks, limits and own rows lie within +-1; the rows after them have bounds of their own.
        self._within = 3 * self._n + sum(count for _, count in self.program.own_rows)
        self._iterations = iterations
        self._solver: Daqp | None = None

    def reset(self) -> None:
        """Discard the warm start."""
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
        rows = self.program.rows_map @ parameters
        lower, upper = -1.0 - rows, 1.0 - rows
        if not_past_rad is not None:
            passing, end = rows[self._within :], self._within
            lower[end:] = not_past_rad[0] / self._unit_rad - passing
            upper[end:] = not_past_rad[1] / self._unit_rad - passing
        return self.program.cost_map @ parameters, lower, upper

    def command(self, state: FloatArray, scaled_jerk: FloatArray) -> FloatArray:
        """Position, velocity and acceleration of the command, shape (3, K), from a state and jerks."""
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
                radians: soft constraints with a lower penalty than the limits.

        Returns:
            The optimal motion.

        Raises:
            ControllerError: If an argument is not finite.
        """
        n, end = self._n, self._n + self._within
        parameters = np.concatenate((state, (1.0,), reference_rad))
        free = self.program.gain @ parameters
        most = float(np.maximum.reduce(np.abs(free[:end])))
        if not most < math.inf:
            raise ControllerError("state or reference is not finite", "solver_failed")
        angles_rad = free[end : end + n] * self._unit_rad  # if bounded
        passes = not_past_rad is not None and ((angles_rad < not_past_rad[0]) | (angles_rad > not_past_rad[1])).any()
        if most <= 1.0 + _ROUNDING and not passes:
            return Solution(free[:n], free[n + self._rows :].reshape(3, -1), 0.0, "gain")
        if self._solver is None:
            self._solver = Daqp(self.program.data, self._iterations)
        g, lower, upper = self.changing(parameters, not_past_rad)
        found = self._solver.solve(g, lower, upper)
        if found is None:
            softened = float(np.maximum.reduce(np.abs(free[: 4 * n]))) - 1.0
            return Solution(free[:n], free[n + self._rows :].reshape(3, -1), max(softened, 0.0), "none")
        jerk = np.minimum(np.maximum(found, -1.0), 1.0)
        within = self._within
        rows = np.abs((self.program.data.a @ jerk)[:within] + 1.0 - upper[:within])
        left = float(np.maximum.reduce(rows[: 3 * n])) - 1.0
        own = self._violated(rows[3 * n :]) if self.program.own_rows else ()
        return Solution(jerk, self.command(state, jerk), left if left > _SOFTENED else 0.0, "daqp", own)

    def _violated(self, rows: FloatArray) -> tuple[str, ...]:
        ends = np.cumsum([count for _, count in self.program.own_rows])
        outside = [part.max() > 1.0 + _SOFTENED for part in np.split(rows, ends[:-1])]
        return tuple(label for (label, _), left in zip(self.program.own_rows, outside, strict=True) if left)
