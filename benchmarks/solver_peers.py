"""The gaze MPC's problem given to several solvers, each as one would reasonably write it in Python.

For pan and for tilt, with z = [q, q', u, u', u''] and ``z+ = M z + m s`` over one control period, s being the jerk as
a share of its limit:

    minimise    sum_k (Q_k - r_k)^2 + d T^2 (V_k - r'_k)^2 + T^4 A_k^2 + T_j^6 j_k^2,   k = 1 .. N
    subject to  |s_k| <= 1 and, at the end of each step, the limits of u, of u' half a step on, and of u''

All count the cost in squared hundredths of a radian, which suits absolute tolerances. Each starts from its last
solution where it can; solvers for quadratic programs get one program for each joint, which is faster for them, IPOPT
one for both, which is faster for it.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, ClassVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from gazempc.controllers.ocp import AxisModel, AxisOcp, SolverFailedError, servo_step
from gazempc.controllers.qp import Daqp, QpResult
from gazempc.neck import NeckSpec
from gazempc.servo import servo_model

FloatArray = NDArray[np.float64]
AxisSolver = Callable[[FloatArray, FloatArray], FloatArray]

_COST_SCALE = 1e4
_JERK_TIME_S = 0.025
# d of the problem is 4 zeta^2 - 2 with this zeta; with sqrt(1/2) there is no such term.
_DAMPING_RATIO = 0.8
# A limit left by more than this share of it is more than a solver's tolerance.
_SOFTENED = 1e-5
_QUIET_IPOPT: dict[str, Any] = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
_QUIET_QRQP: dict[str, Any] = {"print_iter": False, "print_header": False, "print_info": False, "error_on_fail": False}


class PeerFailedError(RuntimeError):
    """A solver says that it has no solution."""


@dataclass(frozen=True)
class AxisProblem:
    """The problem of one joint.

    Attributes:
        neck: The neck.
        index: 0 for pan, 1 for tilt.
        steps: Length of the horizon N, control periods.
        smoothing_time_s: T.
    """

    neck: NeckSpec
    index: int
    steps: int
    smoothing_time_s: float

    @property
    def model(self) -> tuple[FloatArray, FloatArray]:
        """M, shape (5, 5), and m, shape (5,), over one control period."""
        M, m = servo_step(self.neck.axes[self.index], self.neck.servo_period_s)
        A, b = np.eye(5), np.zeros(5)
        for _ in range(self.neck.servo_ticks_per_plan):
            A, b = M @ A, M @ b + m
        return A, b * float(self.neck.command_limits.jerk_max_rad_s3[self.index])

    @property
    def outputs(self) -> FloatArray:
        """What is made small, from z: joint angle, weighted velocity and acceleration; shape (3, 5)."""
        C = np.zeros((3, 5))
        C[0, 0] = 1.0
        C[1, 1] = self.velocity_weight
        C[2, :3] = self.smoothing_time_s**2 * servo_model(self.neck.axes[self.index])[1]
        return C

    @property
    def velocity_weight(self) -> float:
        """Square root of d T^2."""
        return float(np.sqrt(4.0 * _DAMPING_RATIO**2 - 2.0)) * self.smoothing_time_s

    @property
    def jerk_weight(self) -> float:
        """Weight of a squared jerk, counted as a share of the largest: T_j^6 j_max^2."""
        return float(_JERK_TIME_S**3 * self.neck.command_limits.jerk_max_rad_s3[self.index]) ** 2

    def aims(self, reference: FloatArray) -> FloatArray:
        """What the outputs shall be: the reference, its weighted central differences and zero; shape (3, N)."""
        rates = np.gradient(reference, self.neck.control_period_s)
        return np.stack([reference, self.velocity_weight * rates, np.zeros_like(reference)])

    @property
    def velocity_row(self) -> FloatArray:
        """What the velocity limit is for, from z, shape (5,): the command's velocity half a step on."""
        return np.array([0.0, 0.0, 0.0, 1.0, 0.5 * self.neck.control_period_s])

    @property
    def velocity_max_rad_s(self) -> float:
        """The velocity limit."""
        return float(self.neck.command_limits.velocity_max_rad_s[self.index])

    @property
    def upper(self) -> FloatArray:
        """Upper bounds of z: those of position and acceleration, shape (5,)."""
        limits, i = self.neck.command_limits, self.index
        top = (np.inf, np.inf, limits.position_max_rad[i], np.inf, limits.acceleration_max_rad_s2[i])
        return np.array(top, dtype=np.float64)

    @property
    def lower(self) -> FloatArray:
        """Lower bounds of z, shape (5,)."""
        lower = -self.upper
        lower[2] = self.neck.command_limits.position_min_rad[self.index]
        return lower


@dataclass(frozen=True)
class SparseQp:
    """The problem without condensing, in w = [z_1 .. z_N, s_1 .. s_N]: 1/2 w'Hw + g'w with bounds on w and rows.

    Attributes:
        hessian: H, shape (6 N, 6 N).
        rows: The model's 5 N equations, ``= [M z0; 0]``, then the N velocities; shape (6 N, 6 N).
        rows_lower: Lower bounds of the rows, with zeros for M z0, shape (6 N,).
        rows_upper: Upper bounds.
        lower: Lower bounds of w, shape (6 N,).
        upper: Upper bounds.
    """

    hessian: sparse.csc_matrix
    rows: sparse.csc_matrix
    rows_lower: FloatArray
    rows_upper: FloatArray
    lower: FloatArray
    upper: FloatArray

    @staticmethod
    def of(problem: AxisProblem) -> SparseQp:
        """Build it for one joint."""
        n, (M, m), C = problem.steps, problem.model, problem.outputs
        stages = sparse.kron(sparse.eye(n), 2.0 * _COST_SCALE * C.T @ C)
        following = sparse.eye(5 * n) - sparse.kron(sparse.eye(n, k=-1), M)
        model = sparse.hstack([following, -sparse.kron(sparse.eye(n), m[:, None])])
        velocity = sparse.hstack([sparse.kron(sparse.eye(n), problem.velocity_row), sparse.csc_matrix((n, n))])
        fastest = np.concatenate([np.zeros(5 * n), np.full(n, problem.velocity_max_rad_s)])
        return SparseQp(
            hessian=sparse.csc_matrix(
                sparse.block_diag([stages, 2.0 * _COST_SCALE * problem.jerk_weight * sparse.eye(n)])
            ),
            rows=sparse.csc_matrix(sparse.vstack([model, velocity])),
            rows_lower=-fastest,
            rows_upper=fastest,
            lower=np.concatenate([np.tile(problem.lower, n), -np.ones(n)]),
            upper=np.concatenate([np.tile(problem.upper, n), np.ones(n)]),
        )


def _linear_cost(cost: FloatArray, problem: AxisProblem, reference: FloatArray) -> FloatArray:
    """Write a reference into the cost of a sparse program."""
    aims = problem.aims(reference)
    n = 5 * len(reference)
    cost[:n:5] = -2.0 * _COST_SCALE * aims[0]
    cost[1:n:5] = -2.0 * _COST_SCALE * problem.velocity_weight * aims[1]
    return cost


class Peer(ABC):
    """One way to solve both joints' problems.

    Args:
        neck: The neck.
        steps: Length of the horizon, control periods.
        smoothing_time_s: T.
    """

    name: ClassVar[str]
    # What must be installed beside gazempc: name to import and name to install.
    module: ClassVar[str] = "casadi"
    package: ClassVar[str] = "casadi"

    def __init__(self, neck: NeckSpec, steps: int, smoothing_time_s: float) -> None:
        self._problems = [AxisProblem(neck, i, steps, smoothing_time_s) for i in range(2)]
        self._shape = (2, steps)

    @classmethod
    def is_installed(cls) -> bool:
        """Whether its package is there."""
        return find_spec(cls.module) is not None

    @abstractmethod
    def solve(self, states: FloatArray, references: FloatArray) -> FloatArray:
        """Solve one control tick.

        Args:
            states: z of pan and tilt, shape (2, 5).
            references: Reference angles, shape (2, N).

        Returns:
            Command positions at the end of each step, shape (2, N), radians.

        Raises:
            PeerFailedError: If it has none.
        """


class AxisPeer(Peer):
    """One that solves each joint's problem on its own; arguments as of `Peer`."""

    def __init__(self, neck: NeckSpec, steps: int, smoothing_time_s: float) -> None:
        super().__init__(neck, steps, smoothing_time_s)
        self._solvers = [self._axis(problem) for problem in self._problems]

    @abstractmethod
    def _axis(self, problem: AxisProblem) -> AxisSolver:
        """Make the solver of one joint: command positions from z0 and the reference."""

    def solve(self, states: FloatArray, references: FloatArray) -> FloatArray:
        """See `Peer.solve`."""
        command = np.empty(self._shape)
        for i, solver in enumerate(self._solvers):
            command[i] = solver(states[i], references[i])
        return command


class Gazempc(Peer):
    """This project: one constant matrix while no limit binds, DAQP where one does.

    Args:
        neck: The neck.
        steps: Length of the horizon, control periods.
        smoothing_time_s: T.

    Attributes:
        ocps: The problems of pan and tilt.
    """

    name = "gazempc"

    def __init__(self, neck: NeckSpec, steps: int, smoothing_time_s: float) -> None:
        super().__init__(neck, steps, smoothing_time_s)
        self.ocps = [AxisOcp(AxisModel(neck, i, steps), smoothing_time_s) for i in range(2)]

    def solve(self, states: FloatArray, references: FloatArray) -> FloatArray:
        """See `Peer.solve`."""
        command = np.empty(self._shape)
        try:
            for i, ocp in enumerate(self.ocps):
                command[i] = ocp.solve(states[i], references[i]).command[0]
        except SolverFailedError as error:
            raise PeerFailedError(str(error)) from None
        return command


class DaqpAlways(AxisPeer):
    """The same without the constant matrix: DAQP in every tick; shows what the matrix is worth."""

    name = "daqp_always"

    def _axis(self, problem: AxisProblem) -> AxisSolver:
        model = AxisModel(problem.neck, problem.index, problem.steps)
        ocp = AxisOcp(model, problem.smoothing_time_s)
        solver = Daqp(ocp.data)

        def solve(state: FloatArray, reference: FloatArray) -> FloatArray:
            g, lower, upper = ocp.program(ocp.parameters(state, reference))
            result: QpResult = solver.solve(g, lower, upper)
            if result.status != "solved":
                raise PeerFailedError(result.status)
            rows = ocp.data.a @ np.clip(result.x, -1.0, 1.0) + 1.0 - upper
            if max(rows.max(), -rows.min()) > 1.0 + _SOFTENED:
                raise PeerFailedError("limit left")
            command: FloatArray = model.command(rows)[0]
            return command

        return solve


class PiqpPackage(AxisPeer):
    """The piqp package on the condensed program, dense and with hard limits; it has no warm start."""

    name = module = package = "piqp"

    def _axis(self, problem: AxisProblem) -> AxisSolver:
        import piqp  # noqa: PLC0415

        model = AxisModel(problem.neck, problem.index, problem.steps)
        ocp, n = AxisOcp(model, problem.smoothing_time_s), problem.steps
        solver, ones = piqp.DenseSolver(), np.ones(n)
        rows = np.ones(3 * n)
        # Its own tolerances are out of reach in some ticks.
        solver.settings.eps_abs = solver.settings.eps_duality_gap_abs = 1e-6
        solver.settings.eps_rel = solver.settings.eps_duality_gap_rel = 1e-7
        solver.setup(
            np.asfortranarray(ocp.data.h),
            np.zeros(n),
            None,
            None,
            np.asfortranarray(ocp.data.a),
            -rows,
            rows,
            -ones,
            ones,
        )

        def solve(state: FloatArray, reference: FloatArray) -> FloatArray:
            g, lower, upper = ocp.program(ocp.parameters(state, reference))
            solver.update(c=g, h_l=lower, h_u=upper)
            if solver.solve() != piqp.PIQP_SOLVED:
                raise PeerFailedError("not solved")
            command: FloatArray = model.command(ocp.data.a @ solver.result.x + 1.0 - upper)[0]
            return command

        return solve


class Osqp(AxisPeer):
    """The osqp package on the condensed program with hard limits, vectors updated, warm started.

    On the sparse program it stops at its limit of iterations in far more of the ticks in which limits bind.
    """

    name = module = package = "osqp"

    def _axis(self, problem: AxisProblem) -> AxisSolver:
        import osqp  # noqa: PLC0415

        model = AxisModel(problem.neck, problem.index, problem.steps)
        ocp, n = AxisOcp(model, problem.smoothing_time_s), problem.steps
        below, above = -np.ones(4 * n), np.ones(4 * n)
        rows = sparse.csc_matrix(np.vstack([np.eye(n), ocp.data.a]))
        hessian = sparse.csc_matrix(np.triu(ocp.data.h))
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
            g, below[n:], above[n:] = ocp.program(ocp.parameters(state, reference))
            solver.update(q=g, l=below, u=above)
            result = solver.solve(raise_error=False)
            if result.info.status_val != solved:
                raise PeerFailedError(result.info.status)
            command: FloatArray = model.command(ocp.data.a @ result.x + 1.0 - above[n:])[0]
            return command

        return solve


class CasadiQrqp(AxisPeer):
    """CasADi's own active-set solver on the sparse program, started from its last solution and multipliers."""

    name = "casadi_qrqp"
    plugin: ClassVar[str] = "qrqp"
    options: ClassVar[dict[str, Any]] = _QUIET_QRQP

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
                h=h, g=_linear_cost(cost, problem, reference), a=a, lba=below, uba=above, lbx=lower, ubx=upper, **start
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


class CasadiSqpmethod(AxisPeer):
    """CasADi's sequential quadratic programming on multiple shooting, its quadratic programs solved by qrqp."""

    name = "casadi_sqpmethod"

    def _axis(self, problem: AxisProblem) -> AxisSolver:
        n, (M, m), C = problem.steps, problem.model, problem.outputs
        z, s = ca.SX.sym("z", 5, n), ca.SX.sym("s", n)
        z0, aims = ca.SX.sym("z0", 5), ca.SX.sym("aims", 3, n)
        cost, rows = problem.jerk_weight * ca.sumsqr(s), []
        for k in range(n):
            before = z[:, k - 1] if k else z0
            rows.append(z[:, k] - M @ before - m * s[k])
            cost += ca.sumsqr(C @ z[:, k] - aims[:, k])
        velocities = ca.mtimes(problem.velocity_row[None], z).T
        w = ca.veccat(z, s)
        program = {"x": w, "p": ca.veccat(z0, aims), "f": _COST_SCALE * cost, "g": ca.vertcat(*rows, velocities)}
        quiet = {"print_header": False, "print_iteration": False, "print_status": False, "print_time": False}
        options: dict[str, Any] = {**quiet, "error_on_fail": False, "qpsol": "qrqp", "qpsol_options": _QUIET_QRQP}
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
            (M, m), C = problem.model, problem.outputs
            z, s = opti.variable(5, n + 1), opti.variable(n)
            opti.subject_to(z[:, 0] == state[:, i])
            for k in range(n):
                opti.subject_to(z[:, k + 1] == M @ z[:, k] + m * s[k])
            opti.subject_to(opti.bounded(-1, s, 1))
            velocities, fastest = ca.mtimes(problem.velocity_row[None], z[:, 1:]), problem.velocity_max_rad_s
            opti.subject_to(opti.bounded(-fastest, velocities, fastest))
            for row in (2, 4):
                opti.subject_to(opti.bounded(problem.lower[row], z[row, 1:], problem.upper[row]))
            cost += ca.sumsqr(C @ z[:, 1:] - aims[3 * i : 3 * i + 3, :]) + problem.jerk_weight * ca.sumsqr(s)
            commands.append(z[2, 1:])
        opti.minimize(_COST_SCALE * cost)
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
        with warnings.catch_warnings():  # it warns of each optional feature that is not installed
            warnings.simplefilter("ignore")
            import do_mpc  # noqa: PLC0415
        model = do_mpc.model.Model("discrete")
        for i, problem in enumerate(self._problems):
            M, m = problem.model
            z, s = model.set_variable("_x", f"z{i}", (5, 1)), model.set_variable("_u", f"s{i}")
            model.set_variable("_tvp", f"aims{i}", (3, 1))
            model.set_rhs(f"z{i}", M @ z + m * s)
        model.setup()
        cost, jerk_cost = ca.SX(0), ca.SX(0)
        for i, problem in enumerate(self._problems):
            z = model.x[f"z{i}"]
            cost += ca.sumsqr(problem.outputs @ z - model.tvp[f"aims{i}"])
            jerk_cost += problem.jerk_weight * model.u[f"s{i}"] ** 2
        mpc = do_mpc.controller.MPC(model)
        mpc.settings.n_horizon, mpc.settings.t_step = steps, neck.control_period_s
        mpc.settings.use_terminal_bounds = True
        mpc.settings.store_lagr_multiplier = False  # would only grow
        mpc.settings.supress_ipopt_output()
        mpc.set_objective(lterm=_COST_SCALE * (cost + jerk_cost), mterm=_COST_SCALE * cost)
        mpc.set_rterm(s0=0.0, s1=0.0)
        for i, problem in enumerate(self._problems):
            for side, bounds, sign in (("lower", problem.lower, -1.0), ("upper", problem.upper, 1.0)):
                mpc.bounds[side, "_x", f"z{i}"] = mpc.terminal_bounds[side, f"z{i}"] = bounds
                mpc.bounds[side, "_u", f"s{i}"] = sign
                # Of the state at the step's end: do-mpc would put it to the state now, and not to the last one.
                (M, m), row = problem.model, sign * problem.velocity_row
                velocity = ca.mtimes((row @ M)[None], model.x[f"z{i}"]) + row @ m * model.u[f"s{i}"]
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


PEERS: Sequence[type[Peer]] = (
    Gazempc,
    DaqpAlways,
    CasadiQrqp,
    CasadiSqpmethod,
    PiqpPackage,
    Osqp,
    OptiIpopt,
    DoMpc,
)
