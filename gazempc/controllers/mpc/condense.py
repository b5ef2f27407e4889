"""Condenses the statement of `gazempc.controllers.mpc.problem` to a quadratic program whose matrices are constant.

CasADi differentiates: the Jacobian of one servo tick, the coefficients of cost and rows. Numpy rolls the tick out over
the horizon, so all quantities are linear in z0 and the jerks x, counted as shares of their limit. With the parameters
p = [z0; 1; r] it has the form of `gazempc.controllers.mpc.qp`, with g = cost_map p and the bounds minus rows_map p.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from gazempc.controllers.mpc.own import NO_PARTS, OwnParts, array_of
from gazempc.controllers.mpc.problem import (
    SLACK_PRICE_RAD2,
    STATE,
    Trajectory,
    Tuning,
    cost,
    jerk_max_rad_s3,
    limits,
    passing,
    servo,
)
from gazempc.controllers.mpc.qp import QpData
from gazempc.errors import SettingsError
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# Cost in squared hundredths of a radian, to suit the absolute tolerances of solvers.
COST_SCALE = 1e4
# Minimum step; later steps grow with this share of their start time (move blocking): the receding horizon replans
# later motion, and the solver's time grows with the number of steps.
_STEP_S = 0.02
_SHARE_OF_TIME = 0.25
_INFEASIBLE = 2  # status of scipy.optimize.linprog
# Columns of the maps for z0 and the constant 1.
FIXED = len(STATE) + 1


def growing_steps(horizon_s: float, period_s: float) -> tuple[int, ...]:
    """Lengths of the steps over a horizon, control periods; the first one is 1.

    Args:
        horizon_s: Length of the horizon, seconds; rounded to control periods, at least two.
        period_s: Control period, seconds.
    """
    left = max(2, round(horizon_s / period_s))
    least = max(1, round(_STEP_S / period_s))
    lengths = [1]
    while (done := sum(lengths)) < left:
        lengths.append(min(max(least, int(_SHARE_OF_TIME * done)), left - done))
    return tuple(lengths)


class AxisModel:
    """Prediction model of one joint: linear maps from [z0; 1; x], 6 + n columns; independent of the weights.

    Args:
        neck: The neck.
        index: Index of the joint in `NeckSpec.joint_names`.
        lengths: Length of each of the n steps, in which the jerk is constant, control periods.
        knots: Number K of control periods with a knot at the end; at most the sum of the lengths.

    Attributes:
        lengths: Length of each step, control periods, shape (n,).
        times_s: End of each step, seconds, shape (n,).
        jerk_scale: Jerk for x = 1, rad/s^3.
        motion: q, v, a, u, du, ddu and j of `Trajectory`, one after the other, 7 n rows.
        joint, velocity, acceleration: Its first three parts, n rows each.
        knots: Position, velocity and acceleration of the command at the ends of K control periods, 3 K rows.
    """

    def __init__(self, neck: NeckSpec, index: int, lengths: tuple[int, ...], knots: int) -> None:
        self.neck, self.index, n = neck, index, len(lengths)
        self.lengths: FloatArray = np.array(lengths, dtype=np.float64)
        self.times_s: FloatArray = np.cumsum(neck.control_period_s * self.lengths)
        self.jerk_scale = jerk_max_rad_s3(neck, index)
        states, accelerations = self._rolled_out(lengths)
        ends, jerks = np.cumsum(lengths) - 1, self.jerk_scale * np.eye(n, 5 + n, 5)
        parts = [states[ends, 0], states[ends, 1], accelerations[ends], *(states[ends, i] for i in (2, 3, 4)), jerks]
        # A column of zeros for the constant 1: the dynamics are linear, not affine.
        self.motion: FloatArray = np.insert(np.concatenate(parts), len(STATE), 0.0, axis=1)
        self.joint, self.velocity, self.acceleration = self.motion[: 3 * n].reshape(3, n, -1)
        commands = np.concatenate(states[:knots, 2:].transpose(1, 0, 2))
        self.knots: FloatArray = np.insert(commands, len(STATE), 0.0, axis=1)

    def _rolled_out(self, lengths: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
        # z at the end of each of the P control periods, shape (P, 5, 5 + n), and the joint's acceleration, (P, 5 + n).
        z, j = ca.SX.sym("z", len(STATE)), ca.SX.sym("j")
        tick = ca.vertcat(*servo(self.neck, self.index, z, j))
        M, m = (array_of(ca.jacobian(tick, by)) for by in (z, j))
        over_period, by_jerk, n = np.eye(6, 5), np.zeros(6), len(lengths)
        for _ in range(self.neck.servo_ticks_per_plan):
            over_period, by_jerk = M @ over_period[:5], M @ by_jerk[:5] + m[:, 0] * self.jerk_scale
        now, rolled = np.eye(5, 5 + n), []
        for k in np.repeat(np.arange(5, 5 + n), lengths):
            after = over_period @ now
            after[:, k] += by_jerk
            now = after[:5]
            rolled.append(after)
        both = np.array(rolled)
        return both[:, :5], both[:, 5]


# Shared by all controllers of the same neck and horizon: two models for each of the last four controllers. Safe: the
# key is frozen, and a model is immutable.
axis_model = lru_cache(maxsize=8)(AxisModel)


class Program(NamedTuple):
    """The constant part of the quadratic program of one joint; read-only arrays.

    Attributes:
        data: Matrices of the solver. Soft rows: 3 n limits, own rows, n angles if bounded.
        cost_map: Linear cost from the parameters p = [z0; 1; r].
        rows_map: The soft rows at zero jerk, from p.
        gain: The state feedback with preview while no limit is active: optimal x, then its rows and knots, from p.
        own_rows: Name and number of rows of each own part.
    """

    data: QpData
    cost_map: FloatArray
    rows_map: FloatArray
    gain: FloatArray
    own_rows: tuple[tuple[str, int], ...]


def condensed(model: AxisModel, tuning: Tuning, bounded: bool, own: OwnParts = NO_PARTS) -> Program:
    """Condense one program.

    Args:
        model: The joint over the horizon.
        tuning: T, zeta and whether there is a zone.
        bounded: Whether the joint's angles have bounds (acquisition, zone).
        own: Own costs and rows.

    Returns:
        The program.

    Raises:
        SettingsError: If an own part is not convex quadratic, or not linear.
    """
    n, neck, index = model.lengths.size, model.neck, model.index
    o = Trajectory(neck, index, tuple(model.lengths.astype(int).tolist()))
    own_rows = own.row_values(o)
    rows = [limits(o, neck, index), *own_rows.values(), *([passing(o, tuning)] if bounded else [])]
    curvatures = 2.0 * COST_SCALE * array_of(o.w)[:, 0] if tuning.zone else np.empty(0)
    y = ca.vertcat(o.q, o.v, o.a, o.u, o.du, o.ddu, o.j, o.r)
    hessian, slope, _ = ca.quadratic_coeff(cost(o, tuning) + own.cost(o), y)
    slopes, constants = ca.linear_coeff(ca.vertcat(*rows), y)
    # y from p, which is [z0; 1; r], and from x.
    of_parameters = np.zeros((8 * n, FIXED + n))
    of_parameters[: 7 * n, :FIXED], of_parameters[7 * n :, FIXED:] = model.motion[:, :FIXED], np.eye(n)
    of_jerk = np.vstack([model.motion[:, FIXED:], np.zeros((n, n))])
    weighed = COST_SCALE * of_jerk.T @ array_of(hessian)
    h, cost_map = weighed @ of_jerk, weighed @ of_parameters
    cost_map[:, FIXED - 1] += COST_SCALE * of_jerk.T @ array_of(slope)[:, 0]
    by_y = array_of(slopes)
    a, rows_map = by_y @ of_jerk, by_y @ of_parameters
    rows_map[:, FIXED - 1] += array_of(constants)[:, 0]
    if own_rows:
        _check_feasible(a, rows_map, own)
    best = -np.linalg.solve(h, cost_map)
    at_best = np.vstack([a, model.knots[:, FIXED:]]) @ best
    at_best[: len(a)] += rows_map
    at_best[len(a) :, :FIXED] += model.knots[:, :FIXED]
    parts = [np.ascontiguousarray(part) for part in (h, a, cost_map, rows_map, np.vstack([best, at_best]))]
    for shared in parts:
        shared.setflags(write=False)
    h, a, cost_map, rows_map, gain = parts
    data = QpData(h=h, a=a, penalty=COST_SCALE * SLACK_PRICE_RAD2, curvatures=curvatures)
    counts = tuple((label, values.shape[0]) for label, values in own_rows.items())
    return Program(data, cost_map, rows_map, gain, counts)


def _check_feasible(a: FloatArray, rows_map: FloatArray, own: OwnParts) -> None:
    # Own rows that conflict with the limits for every state and reference are an error of the user.
    from scipy.optimize import linprog  # noqa: PLC0415  (0.1 s, and only own rows need it)

    free = np.delete(rows_map, FIXED - 1, axis=1)
    both, constant = np.hstack([free, a]), rows_map[:, FIXED - 1]
    bounds = [(None, None)] * free.shape[1] + [(-1.0, 1.0)] * a.shape[1]
    found = linprog(
        np.zeros(both.shape[1]),
        A_ub=np.vstack([both, -both]),
        b_ub=np.concatenate([1.0 - constant, 1.0 + constant]),
        bounds=bounds,
    )
    if found.status == _INFEASIBLE:
        labels = ", ".join(row.label for row in own.rows)
        raise SettingsError(f"{labels}: infeasible: no motion within the limits keeps these rows within +-1")


# Two programs a joint for four controllers. Safe: a model is hashed by identity and immutable; a program is read-only.
condense = lru_cache(maxsize=16)(condensed)
