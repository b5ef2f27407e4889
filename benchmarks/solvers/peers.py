"""Solvers of the MPC's problem: this project's, QP solvers, and an NLP tool."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

import casadi as ca
import numpy as np
from scipy import sparse

from benchmarks.solvers.problem import AxisProblem, linear_cost, sparse_program
from gazempc.controllers.controller import ControllerError
from gazempc.controllers.mpc.condense import COST_SCALE, AxisModel
from gazempc.controllers.mpc.ocp import AxisOcp
from gazempc.controllers.mpc.problem import Tuning
from gazempc.controllers.mpc.qp import Daqp, QpData
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

AxisSolver = Callable[[FloatArray, FloatArray], FloatArray]
# Function from linear cost and lower and upper bounds of the rows to the scaled jerks.
CondensedSolver = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
# Relative violation of a limit beyond solver tolerances.
_SOFTENED = 1e-5


class PeerFailedError(RuntimeError):
    """A solver returned no solution."""


class Peer(ABC):
    """Solver of both joints' problems.

    Args:
        neck: The neck.
        steps: Length of the horizon, control periods.
        smoothing_time_s: T.
    """

    name: ClassVar[str]

    def __init__(self, neck: NeckSpec, steps: int, smoothing_time_s: float) -> None:
        self._problems = [AxisProblem(neck, i, steps, smoothing_time_s) for i in range(2)]

    @abstractmethod
    def solve(self, states: FloatArray, references: FloatArray) -> FloatArray:
        """Solve one control tick.

        Args:
            states: z of pan and tilt, shape (2, 5).
            references: Reference angles, shape (2, N).

        Returns:
            Command positions at the end of each step, shape (2, N), radians.

        Raises:
            PeerFailedError: If there is no solution.
        """


def condensed(problem: AxisProblem) -> AxisOcp:
    """Condensed program over equal steps, common to all peers; the controller uses move blocking."""
    model = AxisModel(problem.neck, problem.index, (1,) * problem.steps, problem.steps)
    return AxisOcp(model, Tuning(problem.smoothing_time_s))


class Gazempc(Peer):
    """This project's solver: a constant feedback matrix without active limits, DAQP otherwise; arguments as of `Peer`.

    Attributes:
        ocps: The problems of pan and tilt.
    """

    name = "gazempc"

    def __init__(self, neck: NeckSpec, steps: int, smoothing_time_s: float) -> None:
        super().__init__(neck, steps, smoothing_time_s)
        self.ocps = [condensed(problem) for problem in self._problems]

    def solve(self, states: FloatArray, references: FloatArray) -> FloatArray:
        """See `Peer.solve`."""
        try:
            solutions = [ocp.solve(*given) for ocp, *given in zip(self.ocps, states, references, strict=True)]
        except ControllerError as error:
            raise PeerFailedError(str(error)) from None
        if any(solution.solver == "none" for solution in solutions):
            raise PeerFailedError("stopped")
        return np.stack([solution.command[0] for solution in solutions])

    def used(self, states: FloatArray, references: FloatArray) -> list[str]:
        """Solver used for pan and for tilt; arguments of `Peer.solve`."""
        return [ocp.solve(states[i], references[i]).solver for i, ocp in enumerate(self.ocps)]


class AxisPeer(Peer):
    """Solver of each joint's problem separately; arguments as of `Peer`."""

    def __init__(self, neck: NeckSpec, steps: int, smoothing_time_s: float) -> None:
        super().__init__(neck, steps, smoothing_time_s)
        self._solvers = [self._axis(problem) for problem in self._problems]

    @abstractmethod
    def _axis(self, problem: AxisProblem) -> AxisSolver:
        """Construct the solver of one joint: function from z0 and reference to command positions."""

    def solve(self, states: FloatArray, references: FloatArray) -> FloatArray:
        """See `Peer.solve`."""
        return np.stack([solver(states[i], references[i]) for i, solver in enumerate(self._solvers)])


class CondensedPeer(AxisPeer):
    """Solver of each joint's condensed program; arguments as of `Peer`."""

    def _axis(self, problem: AxisProblem) -> AxisSolver:
        ocp = condensed(problem)
        solver = self._solver(ocp.program.data, problem.steps)

        def solve(state: FloatArray, reference: FloatArray) -> FloatArray:
            jerks = solver(*ocp.changing(np.concatenate([state, [1.0], reference])))
            command: FloatArray = ocp.command(state, jerks)[0]
            return command

        return solve

    @abstractmethod
    def _solver(self, data: QpData, n: int) -> CondensedSolver:
        """Construct the solver of a program with n scaled jerks."""


class DaqpAlways(CondensedPeer):
    """This project's solver without the constant matrix, DAQP in every tick: measures the benefit of the matrix."""

    name = "daqp_always"

    def _solver(self, data: QpData, n: int) -> CondensedSolver:
        solver = Daqp(data)

        def solve(g: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
            x = solver.solve(g, lower, upper)
            if x is None:
                raise PeerFailedError("stopped")
            rows = data.a @ np.clip(x, -1.0, 1.0) + 1.0 - upper
            if max(rows.max(), -rows.min()) > 1.0 + _SOFTENED:
                raise PeerFailedError("limit left")
            return x

        return solve


class PiqpPackage(CondensedPeer):
    """The piqp package, dense, with hard limits, without warm start."""

    name = "piqp"

    def _solver(self, data: QpData, n: int) -> CondensedSolver:
        import piqp  # noqa: PLC0415

        solver, ones, rows = piqp.DenseSolver(), np.ones(n), np.ones(3 * n)
        # The default tolerances are not attained in some ticks.
        solver.settings.eps_abs = solver.settings.eps_duality_gap_abs = 1e-6
        solver.settings.eps_rel = solver.settings.eps_duality_gap_rel = 1e-7
        h, a = np.asfortranarray(data.h), np.asfortranarray(data.a)
        solver.setup(h, np.zeros(n), None, None, a, -rows, rows, -ones, ones)

        def solve(g: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
            solver.update(c=g, h_l=lower, h_u=upper)
            if solver.solve() != piqp.PIQP_SOLVED:
                raise PeerFailedError("not solved")
            return np.asarray(solver.result.x)

        return solve


class Osqp(CondensedPeer):
    """The osqp package with hard limits, updated vectors and warm start.

    On the sparse program it reaches the iteration limit in many more of the ticks with active limits.
    """

    name = "osqp"

    def _solver(self, data: QpData, n: int) -> CondensedSolver:
        import osqp  # noqa: PLC0415

        below, above = -np.ones(4 * n), np.ones(4 * n)
        rows = sparse.csc_matrix(np.vstack([np.eye(n), data.a]))
        solver, solved = osqp.OSQP(), osqp.SolverStatus.OSQP_SOLVED
        tolerances = {"eps_abs": 1e-6, "eps_rel": 1e-6, "max_iter": 20_000, "adaptive_rho_interval": 10}
        hessian = sparse.csc_matrix(np.triu(data.h))
        solver.setup(hessian, np.zeros(n), rows, below, above, verbose=False, **tolerances)

        def solve(g: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
            below[n:], above[n:] = lower, upper
            solver.update(q=g, l=below, u=above)
            result = solver.solve(raise_error=False)
            if result.info.status_val != solved:
                raise PeerFailedError(result.info.status)
            return np.asarray(result.x)

        return solve


class CasadiQrqp(AxisPeer):
    """CasADi's active-set solver on the sparse program, with primal and dual warm start."""

    name = "casadi_qrqp"
    plugin: ClassVar[str] = "qrqp"
    options: ClassVar[dict[str, Any]] = dict.fromkeys(
        ("print_iter", "print_header", "print_info", "error_on_fail"), False
    )

    def _axis(self, problem: AxisProblem) -> AxisSolver:
        (hessian, rows, fastest), n, (M, _) = sparse_program(problem), problem.steps, problem.model
        h, a = ca.DM(hessian), ca.DM(rows)
        solver = ca.conic(self.name, self.plugin, {"h": h.sparsity(), "a": a.sparsity()}, self.options)
        cost, below, above = np.zeros(6 * n), -fastest, fastest.copy()
        lower, upper = (
            ca.DM(np.concatenate([np.tile(problem.bounds(side), n), side * np.ones(n)])) for side in (-1.0, 1.0)
        )
        start: dict[str, Any] = {}

        def solve(state: FloatArray, reference: FloatArray) -> FloatArray:
            below[:5] = above[:5] = M @ state
            answer = solver(
                h=h, g=linear_cost(cost, problem, reference), a=a, lba=below, uba=above, lbx=lower, ubx=upper, **start
            )
            if not solver.stats()["success"]:
                start.clear()  # no warm start after a failure
                raise PeerFailedError("not solved")
            start.update(x0=answer["x"], lam_x0=answer["lam_x"], lam_a0=answer["lam_a"])
            return np.asarray(answer["x"]).ravel()[2 : 5 * n : 5]

        return solve


class Accurate(CasadiQrqp):
    """Reference: an interior-point method with tight tolerances on the sparse program."""

    name = "accurate"
    plugin = "piqp"
    options: ClassVar[dict[str, Any]] = {
        "error_on_fail": False,
        "piqp": {"eps_abs": 1e-9, "eps_rel": 1e-10, "eps_duality_gap_abs": 1e-9, "eps_duality_gap_rel": 1e-10},
    }


class DoMpc(Peer):
    """do-mpc on the discrete linear model of both joints; IPOPT, warm started from the last solution.

    One program for both joints, which is faster with IPOPT.
    """

    name = "do_mpc"

    def __init__(self, neck: NeckSpec, steps: int, smoothing_time_s: float) -> None:
        super().__init__(neck, steps, smoothing_time_s)
        # Warnings about missing optional features, and of CasADi about the use of NumPy by do-mpc.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self._set_up(neck, steps)

    def _set_up(self, neck: NeckSpec, steps: int) -> None:
        import do_mpc  # noqa: PLC0415

        model = do_mpc.model.Model("discrete")
        for i, problem in enumerate(self._problems):
            M, m = map(ca.DM, problem.model)
            z, s = model.set_variable("_x", f"z{i}", (5, 1)), model.set_variable("_u", f"s{i}")
            model.set_variable("_tvp", f"aims{i}", (3, 1))
            model.set_rhs(f"z{i}", ca.mtimes(M, z) + m * s)
        model.setup()
        cost, jerk_cost = ca.SX(0), ca.SX(0)
        for i, problem in enumerate(self._problems):
            z = model.x[f"z{i}"]
            cost += ca.sumsqr(ca.mtimes(ca.DM(problem.outputs), z) - model.tvp[f"aims{i}"])
            jerk_cost += problem.jerk_weight * model.u[f"s{i}"] ** 2
        mpc = do_mpc.controller.MPC(model)
        mpc.settings.n_horizon, mpc.settings.t_step = steps, neck.control_period_s
        mpc.settings.use_terminal_bounds = True
        mpc.settings.store_lagr_multiplier = False  # grows without bound
        mpc.settings.supress_ipopt_output()
        mpc.set_objective(lterm=COST_SCALE * (cost + jerk_cost), mterm=COST_SCALE * cost)
        mpc.set_rterm(s0=0.0, s1=0.0)
        for i, problem in enumerate(self._problems):
            for side, sign in (("lower", -1.0), ("upper", 1.0)):
                mpc.bounds[side, "_x", f"z{i}"] = mpc.terminal_bounds[side, f"z{i}"] = problem.bounds(sign)
                mpc.bounds[side, "_u", f"s{i}"] = sign
                # At the end of the step: do-mpc constrains the initial state and not the terminal one.
                (A, b), row = problem.model, sign * problem.velocity_row
                velocity = ca.mtimes(ca.DM(row @ A).T, model.x[f"z{i}"]) + float(row @ b) * model.u[f"s{i}"]
                mpc.set_nl_cons(f"{side}_v{i}", velocity, ub=problem.velocity_max_rad_s)
        self._references = mpc.get_tvp_template()
        mpc.set_tvp_fun(lambda _: self._references)
        mpc.setup()
        mpc.x0 = np.zeros(10)
        mpc.set_initial_guess()
        self._mpc = mpc
        where = mpc.opt_x(range(mpc.opt_x.size))
        self._command = np.array(
            [[int(where["_x", k, 0, -1, f"z{i}"][2]) for k in range(1, steps + 1)] for i in range(2)]
        )

    def solve(self, states: FloatArray, references: FloatArray) -> FloatArray:
        """See `Peer.solve`."""
        for i, problem in enumerate(self._problems):
            aims = problem.aims(references[i]).T
            self._references["_tvp", :, f"aims{i}"] = [aims[0], *aims]  # the initial state's reference has no effect
        self._mpc.make_step(states.reshape(10, 1))
        if not self._mpc.solver_stats["success"]:
            raise PeerFailedError(self._mpc.solver_stats["return_status"])
        command: FloatArray = np.asarray(self._mpc.opt_x_num.cat).ravel()[self._command]
        return command
