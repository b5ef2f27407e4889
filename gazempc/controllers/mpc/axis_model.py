"""One joint over the horizon: its prediction and the limits of its command, condensed once for all smoothing times."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gazempc.controllers.mpc.prediction import predict
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# Room for the rounding of those who follow the plan.
_SHARE_OF_LIMITS = 1.0 - 1e-6


class AxisModel:
    """One joint over the horizon: prediction and limits, condensed once for all smoothing times.

    Args:
        neck: The neck, for limits and rates.
        index: 0 for pan, 1 for tilt.
        steps: Length of the horizon N, control periods.
        first_parts: Steps of the command in the first control period; in each other there is one.

    Attributes:
        steps: N.
        step_s: Control period, seconds.
        shares: Length of each step of the command, as a share of the control period, shape (n,).
        jerk_scale: Jerk that a scaled jerk of 1 stands for, rad/s^3.
        prediction: The maps of the condensed problem.
        rows_from_jerk: The command's n positions, then its velocities half a step on, then its accelerations, as
            shares of their limits, from scaled jerks; shape (3 n, n).
        rows_from_state: The same from [z0; 1], shape (3 n, 6).
    """

    def __init__(self, neck: NeckSpec, index: int, steps: int, first_parts: int = 1) -> None:
        limits = neck.command_limits
        self.steps, self.step_s = steps, neck.control_period_s
        self.jerk_scale = _SHARE_OF_LIMITS * float(limits.jerk_max_rad_s3[index])
        self.prediction = predict(neck.axes[index], neck, steps, self.jerk_scale, first_parts)
        self.shares: FloatArray = np.repeat([1.0 / first_parts, 1.0], [first_parts, steps - 1])
        n = self.shares.size
        low, high = limits.position_min_rad[index], limits.position_max_rad[index]
        # Each limit's rows are counted in units of that limit, which makes their slacks comparable.
        self._unit = np.array(
            [
                0.5 * (high - low),
                _SHARE_OF_LIMITS * limits.velocity_max_rad_s[index],
                _SHARE_OF_LIMITS * limits.acceleration_max_rad_s2[index],
            ]
        )[:, None]
        self._centre_rad = 0.5 * (high + low)
        unit_of_row = np.repeat(self._unit, n, axis=0)
        # v_k + a_k h/2, with h the next step's length, is the middle control point of the velocity's parabola over that
        # step, and v_k is a mean of two of them: kept within the limit, they keep the velocity within it also between
        # the steps.
        self._half_s = 0.5 * self.step_s * np.append(self.shares[1:], 1.0)
        ahead = np.eye(3 * n) + np.diag(np.concatenate([np.zeros(n), self._half_s]), k=n)
        centre_of_row = np.repeat([[self._centre_rad], [0.0], [0.0]], n, axis=0) / unit_of_row
        self.rows_from_jerk: FloatArray = (ahead @ self.prediction.command_from_jerk) / unit_of_row
        rows_from_z0 = (ahead @ self.prediction.command_from_state) / unit_of_row
        self.rows_from_state: FloatArray = np.hstack([rows_from_z0, -centre_of_row])

    def command(self, rows: FloatArray) -> FloatArray:
        """Position, velocity and acceleration of the command, shape (3, n), from its rows, shape (3 n,)."""
        command: FloatArray = rows.reshape(3, -1) * self._unit
        command[0] += self._centre_rad
        command[1] -= self._half_s * command[2]
        return command


# Two joints for each of the last four controllers. Safe: the key is frozen, and nobody changes a model.
@lru_cache(maxsize=8)
def axis_model(neck: NeckSpec, index: int, steps: int, first_parts: int) -> AxisModel:
    """The model of a joint, made once for all controllers of the same neck and horizon.

    Args:
        neck: See `AxisModel`.
        index: See `AxisModel`.
        steps: See `AxisModel`.
        first_parts: See `AxisModel`.

    Returns:
        The model; do not change it.
    """
    return AxisModel(neck, index, steps, first_parts)
