"""The optimal control problem of one joint, condensed to a convex quadratic program with CasADi.

After the dead time the joint is a linear system. With z = [q, q', u, u', u''] (joint angle and velocity, command,
its velocity and acceleration) and the command's jerk j as the input, constant over a control period, one servo
period is ``z+ = M z + m j``: the command is integrated three times, then held while the servo follows. Rolled over
the horizon, everything of interest is linear in the initial state z0 and the jerks J = (j_1 .. j_N):

    joint angle        Q = Qz z0 + Qj J        joint acceleration  A = Az z0 + Aj J
    command and its derivatives  C = Cz z0 + Cj J

and the problem is

    minimise    sum_k w_k (Q_k - r_k)^2 + T^4 sum_k A_k^2 + rho sum(s) + small |J|^2
    subject to  |J| <= j_max,   low - s <= C <= high + s,   s >= 0

with reference angles r from the look-at kinematics. The slacks s (one for position, velocity and acceleration each)
are zero whenever the limits can be kept; they let a start outside the limits be solved instead of refused. Limits
on the command alone also keep the joint inside the neck's limits, see `gazempc.neck.Axis.servo_gain`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from gazempc.neck import Axis, NeckSpec
from gazempc.servo import servo_model, zero_order_hold

FloatArray = NDArray[np.float64]

STATE = ("q", "v", "u", "du", "ddu")
_SLACKS = 3
# The cost is counted in squared hundredths of a radian, so that solvers' absolute tolerances suit it.
_COST_SCALE = 1e4
# Exact penalty: dearer than the gaze error that leaving a limit could save; slacks are shares of the limits.
_SLACK_PENALTY = 300.0 * _COST_SCALE
_SLACK_CURVATURE = _COST_SCALE
# Keeps the Hessian positive definite; jerks are scaled to [-1, 1], so this is 1e-8 rad^2 a step at full jerk.
_JERK_REGULARISATION = 1e-8
# The plan leaves the smoother this headroom: Ruckig follows a plan that uses its limits to the last digit only
# after a detour.
_SHARE_OF_LIMITS = 0.99


@dataclass(frozen=True)
class Prediction:
    """Linear maps from [initial state; scaled jerks] to what the horizon contains, N steps each.

    Attributes:
        joint_from_state: Joint angles, shape (N, 5).
        joint_from_jerk: Shape (N, N).
        acceleration_from_state: Joint accelerations, shape (N, 5).
        acceleration_from_jerk: Shape (N, N).
        command_from_state: Command position, velocity, acceleration, stacked, shape (3 N, 5).
        command_from_jerk: Shape (3 N, N).
    """

    joint_from_state: FloatArray
    joint_from_jerk: FloatArray
    acceleration_from_state: FloatArray
    acceleration_from_jerk: FloatArray
    command_from_state: FloatArray
    command_from_jerk: FloatArray


@dataclass(frozen=True)
class Solution:
    """What the solver found for one joint.

    Attributes:
        jerk_rad_s3: Jerk of the command in each step, shape (N,), rad/s^3.
        slack: How far the limits of position, velocity and acceleration are left, as shares of them, shape (3,).
    """

    jerk_rad_s3: FloatArray
    slack: FloatArray


class SolverFailedError(RuntimeError):
    """The solver returned no trustworthy solution."""


def servo_step(axis: Axis, period_s: float) -> tuple[FloatArray, FloatArray]:
    """One servo period of command and joint: ``z+ = M z + m j``.

    Args:
        axis: The joint.
        period_s: Servo period, seconds.

    Returns:
        M, shape (5, 5), and m, shape (5,).
    """
    h = period_s
    chain = np.array([[1.0, h, h**2 / 2.0], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
    jerk_in = np.array([h**3 / 6.0, h**2 / 2.0, h])
    servo = zero_order_hold(axis, h)
    M = np.zeros((5, 5))
    M[2:, 2:] = chain
    M[:2, :2] = servo[:, :2]
    M[:2, 2:] = np.outer(servo[:, 2], chain[0])
    m = np.concatenate([servo[:, 2] * jerk_in[0], jerk_in])
    return M, m


def predict(axis: Axis, neck: NeckSpec, steps: int, jerk_scale: float) -> Prediction:
    """Build the condensed prediction by rolling the model symbolically and differentiating.

    Args:
        axis: The joint.
        neck: The neck, for its rates.
        steps: Length of the horizon, control periods.
        jerk_scale: Jerk that a scaled jerk of 1 stands for, rad/s^3.

    Returns:
        The maps.
    """
    M, m = servo_step(axis, neck.servo_period_s)
    rates = servo_model(axis)[1]
    z0 = ca.SX.sym("z0", len(STATE))
    jerk = ca.SX.sym("jerk", steps)
    z = z0
    joint, acceleration, commands = [], [], []
    for k in range(steps):
        for _ in range(neck.servo_ticks_per_plan):
            z = ca.mtimes(ca.DM(M), z) + ca.DM(m) * (jerk_scale * jerk[k])
        joint.append(z[0])
        acceleration.append(rates[0] * z[0] + rates[1] * z[1] + rates[2] * z[2])
        commands.append(z[2:])
    stacked = ca.vertcat(*[c[i] for i in range(3) for c in commands])

    def maps(expression: ca.SX) -> tuple[FloatArray, FloatArray]:
        jacobian = ca.Function("maps", [], [ca.jacobian(expression, z0), ca.jacobian(expression, jerk)])
        by_state, by_jerk = jacobian.call([])
        return np.array(ca.DM(by_state)), np.array(ca.DM(by_jerk))

    return Prediction(*maps(ca.vertcat(*joint)), *maps(ca.vertcat(*acceleration)), *maps(stacked))


class AxisOcp:
    """The quadratic program of one joint; built once, solved with new data every control tick.

    Args:
        neck: The neck, for limits and rates.
        index: 0 for pan, 1 for tilt.
        steps: Length of the horizon N, control periods.
        smoothing_time_s: T: gaze motion faster than 1 / T (rad/s) is smoothed away rather than followed.
        solvers: CasADi's names of the QP solvers, in the order in which they are tried. DAQP is the faster by far; from
            a few starts far outside the limits it gives up, and PIQP does not.
        solver_options: Options of the solvers.

    Attributes:
        prediction: The maps of the condensed problem.
        jerk_scale: Jerk that a scaled jerk of 1 stands for, rad/s^3.
    """

    def __init__(
        self,
        neck: NeckSpec,
        index: int,
        steps: int,
        smoothing_time_s: float,
        solvers: tuple[str, ...] = ("daqp", "piqp"),
        solver_options: dict[str, Any] | None = None,
    ) -> None:
        limits = neck.command_limits
        self._steps = steps
        self.jerk_scale = _SHARE_OF_LIMITS * float(limits.jerk_max_rad_s3[index])
        self.prediction = predict(neck.axes[index], neck, steps, self.jerk_scale)
        p = self.prediction
        smoothing = _COST_SCALE * smoothing_time_s**4 * p.acceleration_from_jerk.T
        self._smoothness = smoothing @ p.acceleration_from_jerk + _COST_SCALE * _JERK_REGULARISATION * np.eye(steps)
        self._smoothness_linear = smoothing @ p.acceleration_from_state
        # Each limit's rows are counted in units of that limit, which makes their slacks comparable.
        low, high = limits.position_min_rad[index], limits.position_max_rad[index]
        centre = 0.5 * (high + low)
        unit = [
            0.5 * (high - low),
            _SHARE_OF_LIMITS * limits.velocity_max_rad_s[index],
            _SHARE_OF_LIMITS * limits.acceleration_max_rad_s2[index],
        ]
        unit_of_row = np.repeat(unit, steps)
        self._centre = np.repeat([centre / unit[0], 0.0, 0.0], steps)
        self._command_from_state = p.command_from_state / unit_of_row[:, None]
        command_from_jerk = p.command_from_jerk / unit_of_row[:, None]
        # Rows of the constraints: C - s <= 1, then C + s >= -1.
        slack_of_row = np.repeat(np.eye(_SLACKS), steps, axis=0)
        self._rows = np.block([[command_from_jerk, -slack_of_row], [command_from_jerk, slack_of_row]])
        self._lower = np.concatenate([-np.ones(steps), np.zeros(_SLACKS)])
        self._upper = np.concatenate([np.ones(steps), np.full(_SLACKS, np.inf)])
        variables = steps + _SLACKS
        self._no_bound = np.full(3 * steps, np.inf)
        shape = {
            "h": ca.Sparsity.dense(variables, variables),
            "a": ca.Sparsity.dense(6 * steps, variables),
        }
        options: dict[str, Any] = {"error_on_fail": False, **(solver_options or {})}
        self._solvers = [ca.conic("axis_ocp", name, shape, options) for name in solvers]

    def quadratic_program(
        self, state: FloatArray, reference_rad: FloatArray, weight: FloatArray
    ) -> dict[str, FloatArray]:
        """The numbers of the program: minimise 1/2 x' h x + g' x, lba <= a x <= uba, lbx <= x <= ubx.

        Args:
            state: [q, q', u, u', u'']: joint one dead time from now, command now; shape (5,), SI units.
            reference_rad: Angles that look at the forecast head, shape (N,), radians.
            weight: Weight of each step's squared error, shape (N,).

        Returns:
            Arrays named as above; x is the scaled jerks, then the three slacks.
        """
        p, n = self.prediction, self._steps
        weighted = _COST_SCALE * weight[:, None] * p.joint_from_jerk
        h = np.zeros((n + _SLACKS, n + _SLACKS))
        h[:n, :n] = 2.0 * (p.joint_from_jerk.T @ weighted + self._smoothness)
        h[n:, n:] = _SLACK_CURVATURE * np.eye(_SLACKS)
        free_error_rad = p.joint_from_state @ state - reference_rad
        g = np.full(n + _SLACKS, _SLACK_PENALTY)
        g[:n] = 2.0 * (weighted.T @ free_error_rad + self._smoothness_linear @ state)
        free_command = self._command_from_state @ state - self._centre
        return {
            "h": h,
            "g": g,
            "a": self._rows,
            "lba": np.concatenate([-self._no_bound, -1.0 - free_command]),
            "uba": np.concatenate([1.0 - free_command, self._no_bound]),
            "lbx": self._lower,
            "ubx": self._upper,
        }

    def solve(self, state: FloatArray, reference_rad: FloatArray, weight: FloatArray) -> Solution:
        """Solve for one control tick; arguments as in `quadratic_program`.

        Returns:
            Jerks and slacks.

        Raises:
            SolverFailedError: If an argument is not finite, or all solvers fail or return nonsense.
        """
        if not all(np.all(np.isfinite(value)) for value in (state, reference_rad, weight)):
            raise SolverFailedError("state, reference or weight is not finite")
        program = self.quadratic_program(state, reference_rad, weight)
        for solver in self._solvers:
            x = np.array(solver(**program)["x"]).ravel()
            stats = solver.stats()
            if stats["success"] and np.all(np.isfinite(x)):
                return Solution(self.jerk_scale * np.clip(x[: self._steps], -1.0, 1.0), x[self._steps :])
        raise SolverFailedError(f"QP solver: {stats.get('return_status', 'no status')}")
