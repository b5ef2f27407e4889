"""Solvers of one small quadratic program whose matrices never change: a fast one, and one that hardly ever gives up.

    minimise    1/2 x' H x + g' x + rho sum(s)
    subject to  -1 <= x <= 1,   lower - s <= A x <= upper + s,   s >= 0

H and A are given once, g and the bounds with every call. The soft rows have an exact penalty: each violation s costs
rho per unit, which is dearer than anything it could save, so s is zero wherever that is possible.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import casadi as ca
import daqp
import numpy as np

from gazempc.types import FloatArray

Status = Literal["solved", "timed_out", "failed"]

# What DAQP calls them: codes of its `exitflag` and of the constraints' `sense`.
_DAQP_SOLVED = (1, 2)
_DAQP_TIMED_OUT = (-4, -7)
_DAQP_SOFT = 8
# DAQP's penalty has a slope, which makes it exact, and a curvature whose reciprocal this is: large for hardly any.
_DAQP_RHO = 100.0
# PIQP's own default is 1e-8, of a cost counted in squared hundredths of a radian.
_PIQP_TOLERANCE = 1e-11
# A solver that says "solved" with a bound left by more than this is not believed.
_BOUND_TOLERANCE = 1e-5


@dataclass(frozen=True)
class QpData:
    """The part of the program that stays; see the module for the notation.

    Attributes:
        h: Hessian, positive definite, shape (n, n).
        a: Soft rows, shape (m, n).
        penalty: rho, cost of one unit of violation of one row.
    """

    h: FloatArray
    a: FloatArray
    penalty: float


@dataclass(frozen=True)
class QpResult:
    """What a solver returns.

    Attributes:
        x: Its answer, shape (n,); only to be used if `status` is ``solved``.
        status: Whether it is one. ``timed_out`` if it was stopped at its limit of iterations, which keeps the same
            data from giving another answer on a slower computer.
    """

    x: FloatArray
    status: Status


class QpSolver(Protocol):
    """One solver for one `QpData`."""

    @property
    def name(self) -> str:
        """Name of the solver."""
        ...

    def reset(self) -> None:
        """Forget earlier programs: the next answer does not depend on them, not even in the last bit."""
        ...

    def solve(self, g: FloatArray, lower: FloatArray, upper: FloatArray) -> QpResult:
        """Solve for new data.

        Args:
            g: Linear cost, shape (n,).
            lower: Lower bounds of the soft rows, shape (m,).
            upper: Upper bounds, shape (m,).

        Returns:
            The answer; failures are said in its status, never raised.
        """
        ...


class Daqp:
    """DAQP, a dual active-set solver (Arnstrom, Bemporad & Axehill 2022); starts from its last active set.

    Args:
        data: The program.
        iteration_limit: Active-set changes after which it is stopped; one takes about 4 microseconds at n = 40.
    """

    name = "daqp"

    def __init__(self, data: QpData, iteration_limit: int = 1000) -> None:
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
        self._model.settings = {"iter_limit": iteration_limit}
        slope, curvature = np.full(n + rows, data.penalty), np.full(n + rows, _DAQP_RHO)
        self._model.soft_weights(w_l=slope, w_u=slope, rho_l=curvature, rho_u=curvature)

    def reset(self) -> None:
        """See `QpSolver.reset`."""
        self._model.update(sense=self._sense)

    def solve(self, g: FloatArray, lower: FloatArray, upper: FloatArray) -> QpResult:
        """See `QpSolver.solve`."""
        self._upper[self._variables :] = upper
        self._lower[self._variables :] = lower
        self._model.update(f=g * self._scale, bupper=self._upper, blower=self._lower)
        x, _, flag, _ = self._model.solve()
        x = x * self._scale
        if flag in _DAQP_SOLVED and np.abs(x).max() <= 1.0 + _BOUND_TOLERANCE:  # False for NaN
            return QpResult(x, "solved")
        # What led there is no start for the next call.
        self.reset()
        return QpResult(x, "timed_out" if flag in _DAQP_TIMED_OUT else "failed")


class Piqp:
    """PIQP, an interior-point solver (Schwan, Jiang, Kuhn & Jones 2023), through CasADi; a slack for each row.

    Args:
        data: The program.
        iteration_limit: Newton steps after which it is stopped.
    """

    name = "piqp"

    def __init__(self, data: QpData, iteration_limit: int = 250) -> None:
        self._n, self._rows = data.h.shape[0], data.a.shape[0]
        self._h = ca.diagcat(ca.DM(data.h), ca.DM(self._rows, self._rows))
        eye = ca.DM.eye(self._rows)
        self._a = ca.vertcat(ca.horzcat(ca.DM(data.a), -eye), ca.horzcat(ca.DM(data.a), eye))
        self._penalty = np.full(self._rows, data.penalty)
        self._lower_x = np.concatenate([-np.ones(self._n), np.zeros(self._rows)])
        self._upper_x = np.concatenate([np.ones(self._n), np.full(self._rows, np.inf)])
        self._no_bound = np.full(self._rows, np.inf)
        self._solver = ca.conic(
            "piqp",
            "piqp",
            {"h": self._h.sparsity(), "a": self._a.sparsity()},
            {
                "error_on_fail": False,
                "piqp": {
                    "max_iter": iteration_limit,
                    "eps_abs": _PIQP_TOLERANCE,
                    "eps_rel": 0.1 * _PIQP_TOLERANCE,
                    "eps_duality_gap_abs": _PIQP_TOLERANCE,
                    "eps_duality_gap_rel": 0.1 * _PIQP_TOLERANCE,
                },
            },
        )

    def reset(self) -> None:
        """See `QpSolver.reset`: every answer starts afresh."""

    def solve(self, g: FloatArray, lower: FloatArray, upper: FloatArray) -> QpResult:
        """See `QpSolver.solve`."""
        answer = self._solver(
            h=self._h,
            g=np.concatenate([g, self._penalty]),
            a=self._a,
            lba=np.concatenate([-self._no_bound, lower]),
            uba=np.concatenate([upper, self._no_bound]),
            lbx=self._lower_x,
            ubx=self._upper_x,
        )
        x = np.asarray(answer["x"]).ravel()[: self._n]
        stats = self._solver.stats()
        if stats["success"] and np.abs(x).max() <= 1.0 + _BOUND_TOLERANCE:
            return QpResult(x, "solved")
        return QpResult(x, "timed_out" if stats["unified_return_status"] == "SOLVER_RET_LIMITED" else "failed")
