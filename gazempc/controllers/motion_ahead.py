"""Where a joint will be: rolled through the commands that are sent, committed and planned."""

from __future__ import annotations

import math

import numpy as np

from gazempc.neck.servo import zero_order_hold
from gazempc.neck.spec import Axis
from gazempc.types import FloatArray

_SAME_TIME_S = 1e-9


class MotionAhead:
    """Predicts a joint that obeys its servo and its dead time, at fixed times from now on.

    The joint's angle at these times is a fixed linear map of its state now and of the commands around now.

    Args:
        axis: The joint.
        period_s: Time between two commands, seconds.
        ahead_s: Times from now, not negative, ascending, shape (K,), seconds; between servo periods the angle is
            interpolated.
    """

    def __init__(self, axis: Axis, period_s: float, ahead_s: FloatArray) -> None:
        whole = math.floor(axis.dead_time_s / period_s + _SAME_TIME_S)
        rest_s = max(axis.dead_time_s - whole * period_s, 0.0)
        # In each period the older command still acts for the part by which the dead time exceeds whole periods.
        older, newer = zero_order_hold(axis, rest_s), zero_order_hold(axis, period_s - rest_s)
        ticks = math.ceil(float(ahead_s[-1]) / period_s - _SAME_TIME_S)
        self.sent_needed = whole + 1
        self.future_needed = max(ticks - whole, 0)
        # Rows are [position; velocity], columns [state now; commands from the oldest needed one on].
        columns = 2 + self.sent_needed + self.future_needed
        state = np.eye(2, columns)
        angles = [state[0].copy()]
        for tick in range(ticks):
            for step, command in ((older, tick), (newer, tick + 1)):
                state = step[:, :2] @ state
                # The newest command that is needed acts to the end.
                state[:, 2 + min(command, columns - 3)] += step[:, 2]
            angles.append(state[0].copy())
        at = np.minimum(ahead_s / period_s, ticks)
        before = np.minimum(np.floor(at + _SAME_TIME_S).astype(int), max(ticks - 1, 0))
        share = (at - before)[:, None]
        rows = np.array(angles)
        self._map: FloatArray = (1.0 - share) * rows[before] + share * rows[np.minimum(before + 1, ticks)]

    def __call__(
        self, position_rad: float, velocity_rad_s: float, sent_rad: FloatArray, future_rad: FloatArray
    ) -> FloatArray:
        """Angles at the times.

        Args:
            position_rad: Where the joint is now, without its offset, radians.
            velocity_rad_s: Its velocity now, rad/s.
            sent_rad: Commands sent before now, one a period, oldest first, the last one a period ago; at least
                `sent_needed`, shape (M,), radians.
            future_rad: Commands from now on, at least `future_needed`, shape (L,), radians.

        Returns:
            Angles without the offset, shape (K,), radians.
        """
        known = np.concatenate(
            (
                (position_rad, velocity_rad_s),
                sent_rad[len(sent_rad) - self.sent_needed :],
                future_rad[: self.future_needed],
            )
        )
        angles_rad: FloatArray = self._map @ known
        return angles_rad
