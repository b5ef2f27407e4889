"""One joint over the horizon: its steps, its motion and the limits of its command, the same for all weights."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gazempc.neck.servo import servo_model, zero_order_hold
from gazempc.neck.spec import Axis, NeckSpec
from gazempc.types import FloatArray

# Joint angle and velocity; command, its velocity and acceleration.
STATE = ("q", "v", "u", "du", "ddu")
# Room for the rounding of those who follow the plan.
_SHARE_OF_LIMITS = 1.0 - 1e-6
# A step lasts so long at least, but for the first, and this share of the time that has passed when it begins: what is
# planned for later is planned again before it comes, and a solver's time grows with the number of steps.
_STEP_S = 0.02
_SHARE_OF_TIME = 0.25
# Natural frequency times servo period. The command is constant between servo ticks, so a joint above this value
# accelerates in pulses. For such a joint the mean over a servo period counts. For a slower joint both are nearly equal.
_FAST = 0.15


def growing_steps(horizon_s: float, period_s: float) -> tuple[int, ...]:
    """Steps of the horizon, longer and longer.

    Args:
        horizon_s: Length of the horizon, seconds; rounded to control periods, of which there are two at least.
        period_s: Control period, seconds.

    Returns:
        Length of each step, control periods; the first one is a single one.
    """
    left = max(2, round(horizon_s / period_s))
    least = max(1, round(_STEP_S / period_s))
    lengths = [1]
    while (done := sum(lengths)) < left:
        lengths.append(min(max(least, int(_SHARE_OF_TIME * done)), left - done))
    return tuple(lengths)


def servo_step(axis: Axis, period_s: float) -> tuple[FloatArray, FloatArray]:
    """M, shape (5, 5), and m, shape (5,), of a servo period, seconds, of command and joint: ``z+ = M z + m j``."""
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


class AxisModel:
    """One joint over the horizon, as maps from [z0; 1; scaled jerks] with z0 of `STATE`: each has 6 + n columns.

    Args:
        neck: The neck, for limits and rates.
        index: Place of the joint among the neck's.
        lengths: Length of each of the n steps, in which the jerk is constant, control periods.
        knots: Control periods at whose ends the command is wanted, K; not more than the sum of the lengths.

    Attributes:
        times_s: End of each step, from the start of the first, seconds, shape (n,).
        lengths: Length of each step, control periods, shape (n,).
        jerk_scale: Jerk that a scaled jerk of 1 stands for, rad/s^3.
        joint: Joint angles at the ends of the steps, n rows; `velocity` and `acceleration` have the same of these. The
            accelerations of a fast joint are the means over the last servo period.
        rows: The command's n positions, then its velocities half a step on, then its accelerations, as shares of their
            limits.
        knots: The command's K positions, velocities and accelerations at the end of each control period.
    """

    def __init__(self, neck: NeckSpec, index: int, lengths: tuple[int, ...], knots: int) -> None:
        axis, limits, n = neck.axes[index], neck.command_limits, len(lengths)
        self.lengths: FloatArray = np.array(lengths, dtype=np.float64)
        lengths_s = neck.control_period_s * self.lengths
        self.times_s: FloatArray = np.cumsum(lengths_s)
        self.jerk_scale = _SHARE_OF_LIMITS * float(limits.jerk_max_rad_s3[index])
        states, accelerations = _rolled(axis, neck, lengths, self.jerk_scale)
        ends = np.cumsum(lengths) - 1
        low, high = limits.position_min_rad[index], limits.position_max_rad[index]
        # Each limit's rows are counted in units of that limit, which makes their slacks comparable.
        units = (
            0.5 * (high - low),
            _SHARE_OF_LIMITS * limits.velocity_max_rad_s[index],
            _SHARE_OF_LIMITS * limits.acceleration_max_rad_s2[index],
        )
        # v_k + a_k h/2, with h the next step's length, is the middle control point of the velocity's parabola over that
        # step, and v_k is between two of them: kept within the limit, they keep the velocity within it also between
        # the steps.
        half_s = 0.5 * np.append(lengths_s[1:], lengths_s[-1])
        ahead = np.eye(3 * n) + np.diag(np.concatenate([np.zeros(n), half_s]), k=n)
        rows = _with_one(ahead @ _command(states[ends]))
        rows[:n, 5] = -0.5 * (high + low)
        self.rows: FloatArray = rows / np.repeat(units, n)[:, None]
        self.joint, self.velocity = _with_one(states[ends, 0]), _with_one(states[ends, 1])
        self.acceleration = _with_one(accelerations[ends])
        self.knots = _with_one(_command(states[:knots]))


def _rolled(axis: Axis, neck: NeckSpec, lengths: tuple[int, ...], jerk_scale: float) -> tuple[FloatArray, FloatArray]:
    # `STATE` at the end of each of the P control periods, shape (P, 5, 5 + n), and the joint's acceleration, shape
    # (P, 5 + n), for every start and all jerks at once.
    M, m = servo_step(axis, neck.servo_period_s)
    over_period, by_jerk = np.eye(5), np.zeros(5)
    for _ in range(neck.servo_ticks_per_plan):
        before_last, before_by_jerk = over_period[1], by_jerk[1]
        over_period, by_jerk = M @ over_period, M @ by_jerk + m * jerk_scale
    faster, faster_by_jerk = over_period[1] - before_last, by_jerk[1] - before_by_jerk
    z = np.eye(5, 5 + len(lengths))
    states, gains = [], []
    for k in np.repeat(np.arange(5, 5 + len(lengths)), lengths):
        gained = faster @ z
        gained[k] += faster_by_jerk
        z = over_period @ z
        z[:, k] += by_jerk
        states.append(z)
        gains.append(gained)
    rolled = np.array(states)
    if axis.natural_frequency_rad_s * neck.servo_period_s > _FAST:
        return rolled, np.array(gains) / neck.servo_period_s
    return rolled, np.einsum("i,kij->kj", servo_model(axis)[1], rolled[:, :3])


def _command(states: FloatArray) -> FloatArray:
    # Positions, velocities and accelerations of the command, stacked.
    return np.concatenate(states[:, 2:].transpose(1, 0, 2))


def _with_one(maps: FloatArray) -> FloatArray:
    # A column of zeros for the constant 1: only the limits have a constant part, the middle of the range.
    return np.insert(maps, len(STATE), 0.0, axis=1)


# The model of a joint, made once for all controllers of the same neck and horizon: two for each of the last four
# controllers. Safe: the key is frozen, and nobody changes a model.
axis_model = lru_cache(maxsize=8)(AxisModel)
