"""The gaze MPC's problem for other solvers: the matrices of `gazempc.controllers.mpc.problem`, over equal steps.

For pan and for tilt, with z = [q, v, u, du, ddu] at the end of each step, and ``z+ = M z + m s`` over one control
period, s being the jerk as a share of its limit:

    minimise    sum_k |C z_k - aims_k|^2 + jerk_weight s_k^2
    subject to  |s_k| <= 1,   lower <= z_k <= upper,   |velocity_row z_k| <= velocity_max
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from scipy import sparse

from gazempc.controllers.mpc.condense import COST_SCALE
from gazempc.controllers.mpc.own import array_of
from gazempc.controllers.mpc.problem import (
    STATE,
    Trajectory,
    Tuning,
    acceleration,
    cost,
    jerk_max_rad_s3,
    limits,
    servo,
)
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray


def tick_matrices(neck: NeckSpec, index: int) -> tuple[FloatArray, FloatArray]:
    """M, shape (5, 5), and m, shape (5,), of one servo period: ``z+ = M z + m j``."""
    z, j = ca.SX.sym("z", len(STATE)), ca.SX.sym("j")
    after, _ = servo(neck, index, z, j)
    return array_of(ca.jacobian(after, z)), array_of(ca.jacobian(after, j))[:, 0]


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
        M, m = tick_matrices(self.neck, self.index)
        A, b = np.eye(5), np.zeros(5)
        for _ in range(self.neck.servo_ticks_per_plan):
            A, b = M @ A, M @ b + m
        return A, b * jerk_max_rad_s3(self.neck, self.index)

    @cached_property
    def _weights(self) -> FloatArray:
        # Weights of q, v, a and j in one step.
        o = Trajectory(self.neck, self.index, (1,) * self.steps)
        first = ca.vertcat(o.q[0], o.v[0], o.a[0], o.j[0])
        hessian, _, _ = ca.quadratic_coeff(cost(o, Tuning(self.smoothing_time_s)), first)
        weights: FloatArray = 0.5 * np.diag(array_of(hessian))
        return weights

    @cached_property
    def _rows(self) -> tuple[FloatArray, FloatArray]:
        # The limits of the first step from [u, du, ddu]: slopes, shape (3, 3), and constants.
        o = Trajectory(self.neck, self.index, (1,) * self.steps)
        rows = limits(o, self.neck, self.index)[:: self.steps]
        slopes, constants = ca.linear_coeff(rows, ca.vertcat(o.u[0], o.du[0], o.ddu[0]))
        return array_of(slopes), array_of(constants)[:, 0]

    @property
    def outputs(self) -> FloatArray:
        """Output matrix C, from z to joint angle, weighted velocity and weighted acceleration; shape (3, 5)."""
        q, v, u = (ca.SX.sym(name) for name in "qvu")
        slopes = ca.jacobian(acceleration(self.neck, self.index, q, v, u), ca.vertcat(q, v, u))
        C = np.zeros((3, 5))
        C[0, 0], C[1, 1], C[2, :3] = 1.0, 1.0, array_of(slopes)[0]
        return np.sqrt(self._weights[:3, None]) * C

    @property
    def velocity_weight(self) -> float:
        """Square root of d T^2."""
        return float(np.sqrt(self._weights[1]))

    @property
    def jerk_weight(self) -> float:
        """Weight of the squared jerk, normalised by its limit: T_j^6 j_max^2."""
        return float(self._weights[3]) * jerk_max_rad_s3(self.neck, self.index) ** 2

    def aims(self, reference: FloatArray) -> FloatArray:
        """Set-points of the outputs: reference, its weighted central differences, and zero; shape (3, N)."""
        rates = np.gradient(reference, self.neck.control_period_s)
        return np.stack([reference, self.velocity_weight * rates, np.zeros_like(reference)])

    @property
    def velocity_row(self) -> FloatArray:
        """Row of the velocity limit, from z, shape (5,): the command's velocity half a step later."""
        slopes, _ = self._rows
        return np.concatenate([np.zeros(2), slopes[1] / slopes[1, 1]])

    @property
    def velocity_max_rad_s(self) -> float:
        """Velocity limit."""
        return 1.0 / float(self._rows[0][1, 1])

    def bounds(self, side: float) -> FloatArray:
        """Bounds of z, upper (1) or lower (-1), from the limits of position and acceleration, shape (5,)."""
        slopes, constants = self._rows
        position, acceleration = ((side - constants[i]) / slopes[i, i] for i in (0, 2))
        return np.array([side * np.inf, side * np.inf, position, side * np.inf, acceleration])


def sparse_program(problem: AxisProblem) -> tuple[sparse.csc_matrix, sparse.csc_matrix, FloatArray]:
    """Sparse (uncondensed) program, in w = [z_1 .. z_N, s_1 .. s_N]: 1/2 w'Hw + g'w with bounds on w and rows.

    Args:
        problem: The problem of one joint.

    Returns:
        H, shape (6 N, 6 N); the rows, shape (6 N, 6 N): the model's 5 N equations, ``= [M z0; 0]``, then the N
        velocities; the upper bounds of the rows, with zeros for M z0, shape (6 N,), whose negatives are the lower ones.
    """
    n, (M, m), C = problem.steps, problem.model, problem.outputs
    stages = sparse.kron(sparse.eye(n), 2.0 * COST_SCALE * C.T @ C)
    following = sparse.eye(5 * n) - sparse.kron(sparse.eye(n, k=-1), M)
    model = sparse.hstack([following, -sparse.kron(sparse.eye(n), m[:, None])])
    velocity = sparse.hstack([sparse.kron(sparse.eye(n), problem.velocity_row), sparse.csc_matrix((n, n))])
    fastest = np.concatenate([np.zeros(5 * n), np.full(n, problem.velocity_max_rad_s)])
    hessian = sparse.block_diag([stages, 2.0 * COST_SCALE * problem.jerk_weight * sparse.eye(n)])
    return sparse.csc_matrix(hessian), sparse.csc_matrix(sparse.vstack([model, velocity])), fastest


def linear_cost(cost: FloatArray, problem: AxisProblem, reference: FloatArray) -> FloatArray:
    """Set the reference in the linear cost of a sparse program."""
    aims = problem.aims(reference)
    n = 5 * len(reference)
    cost[:n:5] = -2.0 * COST_SCALE * aims[0]
    cost[1:n:5] = -2.0 * COST_SCALE * problem.velocity_weight * aims[1]
    return cost
