"""One joint over the horizon: its steps, its prediction and the limits of its command, the same for all weights."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gazempc.controllers.mpc.prediction import predict
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# Room for the rounding of those who follow the plan.
_SHARE_OF_LIMITS = 1.0 - 1e-6
# A step lasts so long at least, but for the first, and this share of the time that has passed when it begins: what is
# planned for later is planned again before it comes, and a solver's time grows with the number of steps.
_STEP_S = 0.02
_SHARE_OF_TIME = 0.25


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


class AxisModel:
    """One joint over the horizon.

    Args:
        neck: The neck, for limits and rates.
        index: 0 for pan, 1 for tilt.
        lengths: Length of each of the n steps, control periods.
        knots: Control periods at whose ends the command is wanted, K.

    Attributes:
        times_s: End of each step, from the start of the first, seconds, shape (n,).
        lengths: Length of each step, control periods, shape (n,).
        jerk_scale: Jerk that a scaled jerk of 1 stands for, rad/s^3.
        prediction: The maps of the condensed problem.
        rows: The command's n positions, then its velocities half a step on, then its accelerations, as shares of their
            limits: rows of a map from [z0; 1; scaled jerks], shape (3 n, 6 + n).
        knots: The command's K positions, velocities and accelerations from the same, shape (3 K, 6 + n).
    """

    def __init__(self, neck: NeckSpec, index: int, lengths: tuple[int, ...], knots: int) -> None:
        limits = neck.command_limits
        self.lengths: FloatArray = np.array(lengths, dtype=np.float64)
        lengths_s = neck.control_period_s * self.lengths
        self.times_s: FloatArray = np.cumsum(lengths_s)
        self.jerk_scale = _SHARE_OF_LIMITS * float(limits.jerk_max_rad_s3[index])
        self.prediction = predict(neck.axes[index], neck, lengths, self.jerk_scale, knots)
        n = len(lengths)
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
        rows = np.insert(ahead @ self.prediction.command, 5, 0.0, axis=1)
        rows[:n, 5] = -0.5 * (high + low)
        self.rows: FloatArray = rows / np.repeat(units, n)[:, None]
        self.knots: FloatArray = np.insert(self.prediction.knots, 5, 0.0, axis=1)


# The model of a joint, made once for all controllers of the same neck and horizon: two for each of the last four
# controllers. Safe: the key is frozen, and nobody changes a model.
axis_model = lru_cache(maxsize=8)(AxisModel)
