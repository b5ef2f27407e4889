"""The solver of one small quadratic program whose matrices never change.

    minimise    1/2 x' H x + g' x + rho sum(s)
    subject to  -1 <= x <= 1,   lower - s <= A x <= upper + s,   s >= 0

H and A are given once, g and the bounds with every call. The soft rows have an exact penalty: each violation s costs
rho per unit, which is dearer than anything it could save, so s is zero wherever that is possible. The last rows may
have a quadratic price instead.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import daqp
import numpy as np

from gazempc.types import FloatArray

# DAQP's codes: `exitflag` and the constraints' `sense`.
_DAQP_SOLVED = (1, 2)
_DAQP_SOFT = 8
# DAQP's penalty has a slope, which makes it exact, and a curvature whose reciprocal this is: large for hardly any.
_DAQP_RHO = 100.0
# Feasibility tolerance of the hard bounds: a larger violation is a failure, a smaller one is clipped.
_BOUND_TOLERANCE = 1e-2
# Bound of the active-set changes, far above those of a program of 16 steps.
ITERATIONS = 1000
# Iterations bound the time, equally on any processor. The clock ends a hanging one only.
_MOST_S = 0.5
# Time of one iteration, with n variables: (this + n^2 times the other), see docs/benchmarks.md.
_ITERATION_S, _ITERATION_S_PER_SQUARE = 1e-6, 6e-9


def iterations_within(time_s: float, variables: int) -> int:
    """How many iterations take a time, seconds, on an ordinary processor; the same on any, so that answers are, too."""
    return max(1, min(ITERATIONS, int(time_s / (_ITERATION_S + _ITERATION_S_PER_SQUARE * variables**2))))


@dataclass(frozen=True)
class QpData:
    """The part of the program that stays; see the module for the notation.

    Attributes:
        h: Hessian, positive definite, shape (n, n).
        a: Soft rows, shape (m, n).
        penalty: rho, cost of one unit of violation of one row.
        curvatures: Of the last rows, whose price is half of it times s^2, shape (k,).
    """

    h: FloatArray
    a: FloatArray
    penalty: float
    curvatures: FloatArray = field(default_factory=lambda: np.empty(0))


class Daqp:
    """DAQP, a dual active-set solver (Arnstrom, Bemporad & Axehill 2022); starts from its last active set.

    Args:
        data: The program.
        iteration_limit: Active-set changes after which it is stopped, see `iterations_within`.
    """

    def __init__(self, data: QpData, iteration_limit: int = ITERATIONS) -> None:
        n, rows = data.h.shape[0], data.a.shape[0]
        self._variables = n
        # With a diagonal of ones the Hessian of a long horizon is still well-conditioned enough for DAQP.
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
        """Drop the warm start: the next answer does not depend on earlier programs, to the last bit."""
        self._model.update(sense=self._sense)

    def solve(self, g: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray | None:
        """Solve for new data.

        Args:
            g: Linear cost, shape (n,).
            lower: Lower bounds of the soft rows, shape (m,).
            upper: Upper bounds, shape (m,).

        Returns:
            The answer, shape (n,); None if it was stopped or failed.
        """
        self._upper[self._variables :] = upper
        self._lower[self._variables :] = lower
        self._model.update(f=g * self._scale, bupper=self._upper, blower=self._lower)
        scaled, _, flag, _ = self._model.solve()
        x: FloatArray = scaled * self._scale
        if flag in _DAQP_SOLVED and np.abs(x).max() <= 1.0 + _BOUND_TOLERANCE:  # False for NaN
            return x
        # What led there is no start for the next call.
        self.reset()
        return None
