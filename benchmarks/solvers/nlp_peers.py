"""Tools for nonlinear programs, as one would reasonably use them in Python.

Each starts from its last solution. IPOPT gets one program for both joints, which is faster for it.
"""

from __future__ import annotations

import warnings
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.solvers.peer import AxisPeer, AxisSolver, Peer, PeerFailedError
from benchmarks.solvers.problem import AxisProblem, SparseQp
from benchmarks.solvers.qp_peers import TIGHT_PIQP
from gazempc.controllers.mpc.condense import COST_SCALE
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

_QUIET_IPOPT: dict[str, Any] = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}


def _model(problem: AxisProblem) -> tuple[ca.DM, ca.DM]:
    M, m = problem.model
    return ca.DM(M), ca.DM(m)


class CasadiSqpmethod(AxisPeer):
    """CasADi's sequential quadratic programming on multiple shooting, its quadratic programs solved by PIQP.

    With qrqp, CasADi's own active-set solver, it fails in a tenth of the ticks.
    """

    name = "casadi_sqpmethod"

    def _axis(self, problem: AxisProblem) -> AxisSolver:
        n, (M, m), C = problem.steps, _model(problem), ca.DM(problem.outputs)
        z, s = ca.SX.sym("z", 5, n), ca.SX.sym("s", n)
        z0, aims = ca.SX.sym("z0", 5), ca.SX.sym("aims", 3, n)
        cost, rows = problem.jerk_weight * ca.sumsqr(s), []
        for k in range(n):
            before = z[:, k - 1] if k else z0
            rows.append(z[:, k] - ca.mtimes(M, before) - m * s[k])
            cost += ca.sumsqr(ca.mtimes(C, z[:, k]) - aims[:, k])
        velocities = ca.mtimes(ca.DM(problem.velocity_row).T, z).T
        w = ca.veccat(z, s)
        program = {"x": w, "p": ca.veccat(z0, aims), "f": COST_SCALE * cost, "g": ca.vertcat(*rows, velocities)}
        quiet = {"print_header": False, "print_iteration": False, "print_status": False, "print_time": False}
        options: dict[str, Any] = {
            **quiet,
            "error_on_fail": False,
            "qpsol": "piqp",
            "qpsol_options": TIGHT_PIQP,
        }
        solver = ca.nlpsol(self.name, "sqpmethod", program, options)
        qp = SparseQp.of(problem)
        lower, upper = ca.DM(qp.lower), ca.DM(qp.upper)
        below, above = ca.DM(qp.rows_lower), ca.DM(qp.rows_upper)
        start: dict[str, Any] = {}

        def solve(state: FloatArray, reference: FloatArray) -> FloatArray:
            answer = solver(
                p=np.concatenate([state, problem.aims(reference).ravel(order="F")]),
                lbx=lower,
                ubx=upper,
                lbg=below,
                ubg=above,
                **start,
            )
            if not solver.stats()["success"]:
                start.clear()
                raise PeerFailedError("not solved")
            start.update(x0=answer["x"], lam_x0=answer["lam_x"], lam_g0=answer["lam_g"])
            return np.asarray(answer["x"]).ravel()[2 : 5 * n : 5]

        return solve


class OptiIpopt(Peer):
    """CasADi's Opti and IPOPT, multiple shooting of both joints, warm started.

    Made a function once: `Opti.solve` grows by some kilobytes a call.
    """

    name = "opti_ipopt"

    def __init__(self, neck: NeckSpec, steps: int, smoothing_time_s: float) -> None:
        super().__init__(neck, steps, smoothing_time_s)
        opti, n = ca.Opti(), steps
        state, aims = opti.parameter(5, 2), opti.parameter(6, n)
        cost, commands = ca.MX(0), []
        for i, problem in enumerate(self._problems):
            (M, m), C = _model(problem), ca.DM(problem.outputs)
            z, s = opti.variable(5, n + 1), opti.variable(n)
            opti.subject_to(z[:, 0] == state[:, i])
            for k in range(n):
                opti.subject_to(z[:, k + 1] == ca.mtimes(M, z[:, k]) + m * s[k])
            opti.subject_to(opti.bounded(-1, s, 1))
            velocities = ca.mtimes(ca.DM(problem.velocity_row).T, z[:, 1:])
            fastest = problem.velocity_max_rad_s
            opti.subject_to(opti.bounded(-fastest, velocities, fastest))
            for row in (2, 4):
                opti.subject_to(opti.bounded(problem.lower[row], z[row, 1:], problem.upper[row]))
            cost += ca.sumsqr(ca.mtimes(C, z[:, 1:]) - aims[3 * i : 3 * i + 3, :]) + problem.jerk_weight * ca.sumsqr(s)
            commands.append(z[2, 1:])
        opti.minimize(COST_SCALE * cost)
        opti.solver("ipopt", _QUIET_IPOPT)
        self._function = opti.to_function(
            "opti_ipopt",
            [state, aims, opti.x, opti.lam_g],
            [ca.vertcat(*commands), opti.x, opti.lam_g],
        )
        self._start = (ca.DM.zeros(opti.x.shape), ca.DM.zeros(opti.lam_g.shape))

    def solve(self, states: FloatArray, references: FloatArray) -> FloatArray:
        """See `Peer.solve`."""
        aims = [problem.aims(reference) for problem, reference in zip(self._problems, references, strict=True)]
        try:
            command, *start = self._function(states.T, np.vstack(aims), *self._start)
        except RuntimeError as error:
            raise PeerFailedError(str(error)) from None
        self._start = (start[0], start[1])
        return np.asarray(command)


class DoMpc(Peer):
    """do-mpc on the discrete linear model of both joints; IPOPT, which it starts from its last solution."""

    name = "do_mpc"
    module = "do_mpc"
    package = "do-mpc"

    def __init__(self, neck: NeckSpec, steps: int, smoothing_time_s: float) -> None:
        super().__init__(neck, steps, smoothing_time_s)
        # It warns of each optional feature that is not installed, and CasADi of how do-mpc uses numpy.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self._set_up(neck, steps)

    def _set_up(self, neck: NeckSpec, steps: int) -> None:
        import do_mpc  # noqa: PLC0415

        model = do_mpc.model.Model("discrete")
        for i, problem in enumerate(self._problems):
            M, m = _model(problem)
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
        mpc.settings.store_lagr_multiplier = False  # would only grow
        mpc.settings.supress_ipopt_output()
        mpc.set_objective(lterm=COST_SCALE * (cost + jerk_cost), mterm=COST_SCALE * cost)
        mpc.set_rterm(s0=0.0, s1=0.0)
        for i, problem in enumerate(self._problems):
            for side, bounds, sign in (("lower", problem.lower, -1.0), ("upper", problem.upper, 1.0)):
                mpc.bounds[side, "_x", f"z{i}"] = mpc.terminal_bounds[side, f"z{i}"] = bounds
                mpc.bounds[side, "_u", f"s{i}"] = sign
                # Of the state at the step's end: do-mpc would put it to the state now, and not to the last one.
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
            self._references["_tvp", :, f"aims{i}"] = [aims[0], *aims]  # that of the state now does not matter
        self._mpc.make_step(states.reshape(10, 1))
        if not self._mpc.solver_stats["success"]:
            raise PeerFailedError(self._mpc.solver_stats["return_status"])
        command: FloatArray = np.asarray(self._mpc.opt_x_num.cat).ravel()[self._command]
        return command
