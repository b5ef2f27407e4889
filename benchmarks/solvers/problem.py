"""The gaze MPC's problem, written down anew: nothing is taken from the controller but the servo's model.

For pan and for tilt, with z = [q, q', u, u', u''] and ``z+ = M z + m s`` over one control period, s being the jerk as
a share of its limit:

    minimise    sum_k (Q_k - r_k)^2 + d T^2 (V_k - r'_k)^2 + T^4 A_k^2 + T_j^6 j_k^2,   k = 1 .. N
    subject to  |s_k| <= 1 and, at the end of each step, the limits of u, of u' half a step on, and of u''
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from gazempc.controllers.mpc.axis_model import servo_step
from gazempc.neck.servo import servo_model
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# All count the cost in squared hundredths of a radian, which suits absolute tolerances.
COST_SCALE = 1e4
_JERK_TIME_S = 0.025
# d of the problem is 4 zeta^2 - 2 with this zeta; with sqrt(1/2) there is no such term.
_DAMPING_RATIO = np.sqrt(0.5)


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
        return float(np.sqrt(max(4.0 * _DAMPING_RATIO**2 - 2.0, 0.0))) * self.smoothing_time_s

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
        stages = sparse.kron(sparse.eye(n), 2.0 * COST_SCALE * C.T @ C)
        following = sparse.eye(5 * n) - sparse.kron(sparse.eye(n, k=-1), M)
        model = sparse.hstack([following, -sparse.kron(sparse.eye(n), m[:, None])])
        velocity = sparse.hstack([sparse.kron(sparse.eye(n), problem.velocity_row), sparse.csc_matrix((n, n))])
        fastest = np.concatenate([np.zeros(5 * n), np.full(n, problem.velocity_max_rad_s)])
        return SparseQp(
            hessian=sparse.csc_matrix(
                sparse.block_diag([stages, 2.0 * COST_SCALE * problem.jerk_weight * sparse.eye(n)])
            ),
            rows=sparse.csc_matrix(sparse.vstack([model, velocity])),
            rows_lower=-fastest,
            rows_upper=fastest,
            lower=np.concatenate([np.tile(problem.lower, n), -np.ones(n)]),
            upper=np.concatenate([np.tile(problem.upper, n), np.ones(n)]),
        )


def linear_cost(cost: FloatArray, problem: AxisProblem, reference: FloatArray) -> FloatArray:
    """Write a reference into the cost of a sparse program."""
    aims = problem.aims(reference)
    n = 5 * len(reference)
    cost[:n:5] = -2.0 * COST_SCALE * aims[0]
    cost[1:n:5] = -2.0 * COST_SCALE * problem.velocity_weight * aims[1]
    return cost
