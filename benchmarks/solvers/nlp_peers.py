"""A tool for nonlinear programs. IPOPT gets one program for both joints, which is faster for it."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np

from benchmarks.solvers.peer import Peer, PeerFailedError
from benchmarks.solvers.problem import AxisProblem
from gazempc.controllers.mpc.condense import COST_SCALE
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray


def _model(problem: AxisProblem) -> tuple[ca.DM, ca.DM]:
    M, m = problem.model
    return ca.DM(M), ca.DM(m)


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
