"""The condensed program against matrices built in NumPy, without CasADi."""

import math

import numpy as np
import pytest

from gazempc.controllers.mpc.acquisition import ACQUISITION_DAMPING
from gazempc.controllers.mpc.condense import AxisModel, condense, growing_steps
from gazempc.controllers.mpc.problem import PLAIN_DAMPING, Tuning
from gazempc.neck.servo import zero_order_hold
from gazempc.neck.spec import load_neck, neck_names

SHARE = 1.0 - 1e-6  # of the limits


def trajectories(neck, index, lengths):
    """q, v, a, u, du, ddu at the ends of the steps, shape (6, n, 5 + n): a column for each start and each jerk."""
    axis, h, n = neck.axes[index], neck.servo_period_s, len(lengths)
    wn, zeta = axis.natural_frequency_rad_s, axis.damping_ratio
    hold, jerk_max = zero_order_hold(axis, h), SHARE * neck.command_limits.jerk_max_rad_s3[index]
    found = np.zeros((6, n, 5 + n))
    for column in range(5 + n):
        q, v, u, du, ddu = np.eye(5)[column] if column < 5 else np.zeros(5)
        for k, length in enumerate(lengths):
            j = jerk_max if column == 5 + k else 0.0
            for _ in range(length * neck.servo_ticks_per_plan):
                u, du, ddu = u + h * du + h**2 / 2 * ddu + h**3 / 6 * j, du + h * ddu + h**2 / 2 * j, ddu + h * j
                before, (q, v) = v, hold @ [q, v, u]
            a = (v - before) / h if wn * h > 0.15 else wn**2 * (u - q) - 2 * zeta * wn * v
            found[:, k, column] = q, v, a, u, du, ddu
    return found


def by_hand(neck, index, lengths, T, zeta, bounded):
    """Hessian, linear cost from [z0; r], soft rows from z0 and from the jerks, and their constant parts."""
    n, each = len(lengths), np.array(lengths, dtype=float)
    q, v, a, u, du, ddu = trajectories(neck, index, lengths)
    following = np.append(each[1:], each[-1])
    w, ends_s = (each + following) / 2, np.cumsum(each) * neck.control_period_s
    share = math.sqrt(max(4 * zeta**2 - 2, 0.0)) * T
    squared, weighted = (
        np.vstack([q, share * v, T**2 * a]),
        np.vstack([np.eye(n), share * np.gradient(np.eye(n), ends_s, axis=0), np.zeros((n, n))]),
    )
    weights = 2e4 * np.tile(w, 3)
    of_jerk = squared[:, 5:].T * weights
    limits = neck.command_limits
    jerk_cost = 2e4 * (0.025**3 * SHARE * limits.jerk_max_rad_s3[index]) ** 2
    H = of_jerk @ squared[:, 5:] + jerk_cost * np.diag(each)
    low, high = limits.position_min_rad[index], limits.position_max_rad[index]
    half_s = neck.control_period_s * following[:, None] / 2
    rows = [
        u / ((high - low) / 2),
        (du + half_s * ddu) / (SHARE * limits.velocity_max_rad_s[index]),
        ddu / (SHARE * limits.acceleration_max_rad_s2[index]),
    ]
    constant = np.repeat([-(high + low) / (high - low), 0.0, 0.0], n)
    if bounded:
        rows, constant = [*rows, q / 150.0], np.append(constant, np.zeros(n))
    rows = np.vstack(rows)
    return H, of_jerk @ np.hstack([squared[:, :5], -weighted]), rows[:, :5], rows[:, 5:], constant


@pytest.mark.parametrize("bounded", [False, True])
@pytest.mark.parametrize("name", neck_names())
def test_the_condensed_matrices_equal_those_by_hand(name, bounded):
    neck = load_neck(name)
    lengths = growing_steps(0.8, neck.control_period_s)
    T, zeta = (0.09, ACQUISITION_DAMPING) if bounded else (0.12, PLAIN_DAMPING)
    for index in range(2):
        program = condense(AxisModel(neck, index, lengths, 3), Tuning(T, zeta), bounded)
        H, cost, rows, a, constant = by_hand(neck, index, lengths, T, zeta, bounded)
        # Relative to the largest element; in the Hessian relative to its diagonal.
        unit = 1.0 / np.sqrt(np.diag(H))
        assert np.abs(unit[:, None] * (program.data.h - H) * unit).max() < 1e-12
        for ours, theirs in (
            (np.delete(program.cost_map, 5, axis=1), cost),
            (program.rows_map[:, :5], rows),
            (program.rows_map[:, 5], constant),
            (program.data.a, a),
        ):
            assert np.abs(ours - theirs).max() <= 1e-12 * np.abs(theirs).max()
        assert not program.cost_map[:, 5].any()
        assert not program.rows_map[:, 6:].any()
        free = -np.linalg.solve(H, cost)
        gain = np.delete(program.gain, 5, axis=1)
        # The Hessian's condition number is 1e7, which leaves nine digits of the gain.
        assert np.abs(gain[: len(lengths)] - free).max() < 2e-9 * np.abs(free).max()
        at_free = a @ free[:, :5]
        apart = gain[len(lengths) : len(lengths) + len(a), :5] - rows - at_free
        assert np.abs(apart).max() < 2e-9 * np.abs(at_free).max()
