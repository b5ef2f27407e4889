"""The solver of a small quadratic program with constant matrices.

    minimise    1/2 x' H x + g' x + rho sum(s)
    subject to  -1 <= x <= 1,   lower - s <= A x <= upper + s,   s >= 0

H and A are constant, g and the bounds vary. The soft rows have an exact penalty rho per unit of violation, so s is zero
whenever the program is feasible. The last rows may have a quadratic penalty instead.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import daqp
import numpy as np

from gazempc.types import FloatArray

# DAQP's codes: `exitflag` and the constraints' `sense`.
_DAQP_SOLVED = (1, 2)
_DAQP_SOFT = 8
# Reciprocal of the curvature of DAQP's penalty, whose linear part makes it exact: large for a negligible curvature.
_DAQP_RHO = 100.0
# Feasibility tolerance of the hard bounds: a larger violation is a failure, a smaller one is clipped.
_BOUND_TOLERANCE = 1e-2
# Iteration limit, far above the iterations of a program of 16 steps.
ITERATIONS = 1000
# Time limit, only for a solver that hangs: the iteration limit is independent of the processor.
_MOST_S = 0.5
# Time of one iteration with n variables: the first plus n^2 times the second, see docs/benchmarks.md.
_ITERATION_S, _ITERATION_S_PER_SQUARE = 1e-6, 6e-9


def iterations_within(time_s: float, variables: int) -> int:
    """Iterations within a time, seconds, on a reference processor: solutions do not depend on the processor in use."""
    return max(1, min(ITERATIONS, int(time_s / (_ITERATION_S + _ITERATION_S_PER_SQUARE * variables**2))))


@dataclass(frozen=True)
class QpData:
    """The constant part of the program; see the module for the notation.

    Attributes:
        h: Hessian, positive definite, shape (n, n).
        a: Soft rows, shape (m, n).
        penalty: rho, cost of one unit of violation of one row.
        curvatures: Quadratic penalty of the last rows: curvature s^2 / 2, shape (k,).
    """

    h: FloatArray
    a: FloatArray
    penalty: float
    curvatures: FloatArray = field(default_factory=lambda: np.empty(0))


class Daqp:
    """DAQP, a dual active-set solver (Arnstrom, Bemporad & Axehill 2022); starts from its last active set.

    Args:
        data: The program.
        iteration_limit: Iteration limit, see `iterations_within`.
    """

    def __init__(self, data: QpData, iteration_limit: int = ITERATIONS) -> None:
        n, rows = data.h.shape[0], data.a.shape[0]
        self._variables = n
        # Diagonal scaling: a Hessian with unit diagonal is well-conditioned enough for DAQP, also for a long horizon.
        self._scale: FloatArray = 1.0 / np.sqrt(np.diag(data.h))
        bound = np.concatenate([1.0 / self._scale, np.ones(rows)])
        self._upper, self._lower = bound.copy(), -bound
        self._sense = np.concatenate([np.zeros(n), np.full(rows, _DAQP_SOFT)]).astype(np.intc)
        self._model = daqp.Model()
        h, a = data.h * np.outer(self._scale, self._scale), np.ascontiguousarray(data.a * self._scale)
        self._model.setup(h, np.zeros(n), a, self._upper, self._lower, self._sense.copy())
        self._model.settings = {"iter_limit": iteration_limit, "time_limit": _MOST_S}
        slope, curvature = np.full(n + rows, data.penalty), np.full(n + rows, _DAQP_RHO)
        linear = n + rows - data.curvatures.size
        slope[linear:], curvature[linear:] = 0.0, 1.0 / data.curvatures
        self._model.soft_weights(w_l=slope, w_u=slope, rho_l=curvature, rho_u=curvature)

    def reset(self) -> None:
        """Discard the warm start: the next solution does not depend on earlier programs, to the last bit."""
        self._model.update(sense=self._sense)

    def solve(self, g: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray | None:
        """Solve for new data.

        Args:
            g: Linear cost, shape (n,).
            lower: Lower bounds of the soft rows, shape (m,).
            upper: Upper bounds, shape (m,).

        Returns:
            The solution, shape (n,); None after the iteration limit or a failure.
        """
        self._upper[self._variables :] = upper
        self._lower[self._variables :] = lower
        self._model.update(f=g * self._scale, bupper=self._upper, blower=self._lower)
        scaled, _, flag, _ = self._model.solve()
        x: FloatArray = scaled * self._scale
        if flag in _DAQP_SOLVED and np.abs(x).max() <= 1.0 + _BOUND_TOLERANCE:  # False for NaN
            return x
        # The active set of a failure is no warm start.
        self.reset()
        return None
