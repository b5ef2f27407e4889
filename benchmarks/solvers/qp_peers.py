"""Solvers for quadratic programs. They get one program for each joint, which is faster for them."""

from __future__ import annotations

from typing import Any, ClassVar

import casadi as ca
import numpy as np
from scipy import sparse

from benchmarks.solvers.ours import even_model
from benchmarks.solvers.peer import AxisPeer, AxisSolver, PeerFailedError
from benchmarks.solvers.problem import AxisProblem, SparseQp, linear_cost
from gazempc.controllers.mpc.ocp import AxisOcp
from gazempc.types import FloatArray


class PiqpPackage(AxisPeer):
    """The piqp package on the condensed program, dense and with hard limits; it has no warm start."""

    name = module = package = "piqp"

    def _axis(self, problem: AxisProblem) -> AxisSolver:
        import piqp  # noqa: PLC0415

        n = problem.steps
        ocp = AxisOcp(even_model(problem.neck, problem.index, n), problem.smoothing_time_s)
        data = ocp.program.data
        solver, ones = piqp.DenseSolver(), np.ones(n)
        rows = np.ones(3 * n)
        # Its own tolerances are out of reach in some ticks.
        solver.settings.eps_abs = solver.settings.eps_duality_gap_abs = 1e-6
        solver.settings.eps_rel = solver.settings.eps_duality_gap_rel = 1e-7
        solver.setup(
            np.asfortranarray(data.h),
            np.zeros(n),
            None,
            None,
            np.asfortranarray(data.a),
            -rows,
            rows,
            -ones,
            ones,
        )

        def solve(state: FloatArray, reference: FloatArray) -> FloatArray:
            g, lower, upper = ocp.changing(np.concatenate([state, [1.0], reference]))
            solver.update(c=g, h_l=lower, h_u=upper)
            if solver.solve() != piqp.PIQP_SOLVED:
                raise PeerFailedError("not solved")
            command: FloatArray = ocp.command(state, solver.result.x)[0]
            return command

        return solve


class Osqp(AxisPeer):
    """The osqp package on the condensed program with hard limits, vectors updated, warm started.

    On the sparse program it stops at its limit of iterations in far more of the ticks in which limits bind.
    """

    name = module = package = "osqp"

    def _axis(self, problem: AxisProblem) -> AxisSolver:
        import osqp  # noqa: PLC0415

        n = problem.steps
        ocp = AxisOcp(even_model(problem.neck, problem.index, n), problem.smoothing_time_s)
        data = ocp.program.data
        below, above = -np.ones(4 * n), np.ones(4 * n)
        rows = sparse.csc_matrix(np.vstack([np.eye(n), data.a]))
        hessian = sparse.csc_matrix(np.triu(data.h))
        solver, solved = osqp.OSQP(), osqp.SolverStatus.OSQP_SOLVED
        solver.setup(
            hessian,
            np.zeros(n),
            rows,
            below,
            above,
            verbose=False,
            eps_abs=1e-6,
            eps_rel=1e-6,
            max_iter=20_000,
            adaptive_rho_interval=10,
        )

        def solve(state: FloatArray, reference: FloatArray) -> FloatArray:
            g, below[n:], above[n:] = ocp.changing(np.concatenate([state, [1.0], reference]))
            solver.update(q=g, l=below, u=above)
            result = solver.solve(raise_error=False)
            if result.info.status_val != solved:
                raise PeerFailedError(result.info.status)
            command: FloatArray = ocp.command(state, result.x)[0]
            return command

        return solve


class CasadiQrqp(AxisPeer):
    """CasADi's own active-set solver on the sparse program, started from its last solution and multipliers."""

    name = "casadi_qrqp"
    plugin: ClassVar[str] = "qrqp"
    options: ClassVar[dict[str, Any]] = {
        "print_iter": False,
        "print_header": False,
        "print_info": False,
        "error_on_fail": False,
    }

    def _axis(self, problem: AxisProblem) -> AxisSolver:
        qp, n, (M, _) = SparseQp.of(problem), problem.steps, problem.model
        h, a = ca.DM(qp.hessian), ca.DM(qp.rows)
        solver = ca.conic(self.name, self.plugin, {"h": h.sparsity(), "a": a.sparsity()}, self.options)
        cost, below, above = np.zeros(6 * n), qp.rows_lower.copy(), qp.rows_upper.copy()
        lower, upper = ca.DM(qp.lower), ca.DM(qp.upper)
        start: dict[str, Any] = {}

        def solve(state: FloatArray, reference: FloatArray) -> FloatArray:
            below[:5] = above[:5] = M @ state
            answer = solver(
                h=h, g=linear_cost(cost, problem, reference), a=a, lba=below, uba=above, lbx=lower, ubx=upper, **start
            )
            if not solver.stats()["success"]:
                start.clear()  # what led there is no start for the next call
                raise PeerFailedError("not solved")
            start.update(x0=answer["x"], lam_x0=answer["lam_x"], lam_a0=answer["lam_a"])
            return np.asarray(answer["x"]).ravel()[2 : 5 * n : 5]

        return solve


class Accurate(CasadiQrqp):
    """What the others are compared with: an interior-point method at tight tolerances on the sparse program."""

    name = "accurate"
    plugin = "piqp"
    options: ClassVar[dict[str, Any]] = {
        "error_on_fail": False,
        "piqp": {"eps_abs": 1e-9, "eps_rel": 1e-10, "eps_duality_gap_abs": 1e-9, "eps_duality_gap_rel": 1e-10},
    }
