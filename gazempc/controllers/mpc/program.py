"""The matrices of one joint's optimal control problem: made once, shared by all controllers that need them.

See `gazempc.controllers.mpc.ocp` for the problem and its notation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gazempc.controllers.mpc.axis_model import AxisModel
from gazempc.controllers.mpc.prediction import STATE
from gazempc.controllers.mpc.qp import QpData
from gazempc.types import FloatArray, IntArray

# Damping ratio zeta of the way to a reference that has jumped; at 0.71 (no term) it is passed by 4 % of the jump.
DAMPING = 0.8
# Angles not to be passed are rows in so large a unit that all limits are kept before them.
PASSING_UNIT_RAD = 150.0
# The cost is counted in squared hundredths of a radian, so that solvers' absolute tolerances suit it.
_COST_SCALE = 1e4
# While catching up the jerk is the same in so many steps on end, once this many are over: the limits decide early on,
# and the solver's time grows with every jerk at its limit.
_HELD_STEPS, _HELD_FROM = 3, 12
# Exact penalty: dearer than the gaze error that leaving a limit could save; slacks are shares of the limits.
_SLACK_PENALTY = 300.0 * _COST_SCALE
# Weight of the command's jerk, as a time to the sixth power: what the joint would hardly show is not done.
_JERK_TIME_S = 0.025


@dataclass(frozen=True, eq=False)
class Program:
    """What stays of the quadratic program of one joint; its arrays cannot be written to.

    Attributes:
        data: The matrices that a solver needs.
        variable_of_step: Which variable of the program is the jerk of each step, shape (n,).
        cost_map: Linear cost from the parameters [z0; 1; r], one row for each variable.
        gain: The best jerks without limits, then all rows at these, from the parameters.
        rows_from_state: The soft rows without jerk, from [z0; 1].
    """

    data: QpData
    variable_of_step: IntArray
    cost_map: FloatArray
    gain: FloatArray
    rows_from_state: FloatArray


# The 54 programs of each of the last four controllers, about 10 MB each. Safe: a model never changes and is its own
# key; nobody can write to a program.
@lru_cache(maxsize=4 * 54)
def condense(model: AxisModel, smoothing_time_s: float, damping: float, catching_up: bool) -> Program:
    """Build the matrices of one program.

    Args:
        model: See `gazempc.controllers.mpc.ocp.AxisOcp`.
        smoothing_time_s: See there.
        damping: See there.
        catching_up: See there.

    Returns:
        The program; the same one for the same arguments.
    """
    p, steps = model.prediction, model.steps
    exact = p.joint_from_jerk.T
    turning = (4.0 * damping**2 - 2.0) * smoothing_time_s**2 * p.velocity_from_jerk.T
    smoothing = smoothing_time_s**4 * p.acceleration_from_jerk.T
    hessian = exact @ p.joint_from_jerk + turning @ p.velocity_from_jerk + smoothing @ p.acceleration_from_jerk
    jerk_weight = (_JERK_TIME_S**3 * model.jerk_scale) ** 2 * np.diag(model.shares)
    rows_from_jerk, rows_from_state = model.rows_from_jerk, model.rows_from_state
    n = model.shares.size
    variable_of_step = np.arange(n)
    if catching_up:
        rows_from_jerk = np.vstack([rows_from_jerk, p.joint_from_jerk / PASSING_UNIT_RAD])
        joint_from_state = np.pad(p.joint_from_state, ((0, 0), (0, 1)))
        rows_from_state = np.vstack([rows_from_state, joint_from_state / PASSING_UNIT_RAD])
        variable_of_step = np.minimum(variable_of_step, _HELD_FROM + (variable_of_step - _HELD_FROM) // _HELD_STEPS)
    hold = np.eye(variable_of_step[-1] + 1)[variable_of_step]
    hessian = 2.0 * _COST_SCALE * hold.T @ (hessian + jerk_weight) @ hold
    a = rows_from_jerk @ hold
    # From the parameters [z0; 1; r]: the linear cost, and the best jerks without limits with all rows at these.
    by_state = exact @ p.joint_from_state + turning @ p.velocity_from_state + smoothing @ p.acceleration_from_state
    by_reference = exact + turning @ np.gradient(np.eye(steps), model.step_s, axis=0)
    cost_map = 2.0 * _COST_SCALE * hold.T @ np.hstack([by_state, np.zeros((n, 1)), -by_reference])
    best = -np.linalg.solve(hessian, cost_map)
    rows = a @ best
    rows[:, : len(STATE) + 1] += rows_from_state
    gain = np.ascontiguousarray(np.vstack([best[variable_of_step], rows]))
    for shared in (hessian, a, variable_of_step, cost_map, gain, rows_from_state):
        shared.setflags(write=False)
    return Program(QpData(h=hessian, a=a, penalty=_SLACK_PENALTY), variable_of_step, cost_map, gain, rows_from_state)
