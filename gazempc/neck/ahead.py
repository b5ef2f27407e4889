"""Prediction of joints through servo and dead time, from the commands sent, committed and planned."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from gazempc.neck.servo import zero_order_hold
from gazempc.neck.spec import Axis, NeckSpec
from gazempc.types import FloatArray

_SAME_TIME_S = 1e-9


class JointAhead:
    """Predicts a joint with servo and dead time, at fixed times from now.

    The predicted state is a constant linear map of the present state and of past and future commands. Exact at whole
    servo periods and when a command begins to act; interpolated between these times.

    Args:
        axis: The joint.
        period_s: Time between two commands, seconds.
        ahead_s: Times from now, not negative, ascending, shape (K,), seconds.

    Attributes:
        sent_needed: Number of latest commands in the dead time, or acting.
        future_needed: Number of future commands that act before the last of the times.
        maps: Position and velocity from [position, velocity now; commands, the oldest needed one first], shape
            (2, K, 2 + sent_needed + future_needed).
    """

    def __init__(self, axis: Axis, period_s: float, ahead_s: FloatArray) -> None:
        whole = math.floor(axis.dead_time_s / period_s + _SAME_TIME_S)
        rest_s = max(axis.dead_time_s - whole * period_s, 0.0)
        if rest_s < _SAME_TIME_S:
            rest_s = 0.0
        # The older command acts for the fractional part of the dead time in each period.
        older, newer = (zero_order_hold(axis, round(part_s, 12)) for part_s in (rest_s, period_s - rest_s))
        ticks = math.ceil(float(ahead_s[-1]) / period_s - _SAME_TIME_S)
        self.sent_needed = whole + 1
        # Rows are [position; velocity], columns [state now; commands from the oldest needed one on].
        state = np.eye(2, 2 + max(self.sent_needed, ticks + 1))
        times_s, states = [0.0], [state]
        for tick in range(ticks):
            for step, command, part_s in ((older, tick, rest_s), (newer, tick + 1, period_s - rest_s)):
                if part_s == 0.0:
                    continue
                state = step[:, :2] @ state
                state[:, 2 + command] += step[:, 2]
                times_s.append(times_s[-1] + part_s)
                states.append(state)
        rolled, last = np.array(states), len(times_s) - 1
        before = np.clip(np.searchsorted(times_s, ahead_s + _SAME_TIME_S, side="right") - 1, 0, max(last - 1, 0))
        after = np.minimum(before + 1, last)
        since_s, lasts_s = ahead_s - np.take(times_s, before), np.take(times_s, after) - np.take(times_s, before)
        share = np.where(since_s < _SAME_TIME_S, 0.0, since_s / np.maximum(lasts_s, _SAME_TIME_S))[:, None, None]
        maps = ((1.0 - share) * rolled[before] + share * rolled[after]).transpose(1, 0, 2)
        used = np.flatnonzero(maps.any(axis=(0, 1)))
        self.future_needed = max(int(used[-1]) - 1 - self.sent_needed, 0)
        self.maps: FloatArray = maps[:, :, : 2 + self.sent_needed + self.future_needed]

    def __call__(
        self, position_rad: float, velocity_rad_s: float, sent_rad: FloatArray, future_rad: FloatArray
    ) -> FloatArray:
        """Angles at the times.

        Args:
            position_rad: Joint angle now, without its offset, radians.
            velocity_rad_s: Its velocity now, rad/s.
            sent_rad: Commands sent before now, one a period, oldest first, the last one a period ago; at least
                `sent_needed`, shape (M,), radians.
            future_rad: Commands from now on, at least `future_needed`, shape (L,), radians.

        Returns:
            Angles without the offset, shape (K,), radians.
        """
        sent, future = sent_rad[len(sent_rad) - self.sent_needed :], future_rad[: self.future_needed]
        return np.asarray(self.maps[0] @ np.concatenate(((position_rad, velocity_rad_s), sent, future)))


class JointsAfterDeadTime:
    """State of all joints one dead time after the start of a plan: its initial state.

    The motion until then is independent of the plan: sent and committed commands determine it.

    Args:
        neck: The neck.
        committed: Number of commands that will be sent from now until a plan starts.
    """

    def __init__(self, neck: NeckSpec, committed: int) -> None:
        period_s = neck.servo_period_s
        each = [JointAhead(axis, period_s, np.array([committed * period_s + axis.dead_time_s])) for axis in neck.axes]
        self._sent = max(joint.sent_needed for joint in each)
        self._maps: FloatArray = np.zeros((neck.joints, 2, 2 + self._sent + committed))
        for maps, joint in zip(self._maps, each, strict=True):
            maps[:, :2] = joint.maps[:, 0, :2]
            first = 2 + self._sent - joint.sent_needed
            maps[:, first : first + joint.maps.shape[2] - 2] = joint.maps[:, 0, 2:]

    def __call__(
        self, position_rad: FloatArray, velocity_rad_s: FloatArray, sent_rad: FloatArray, committed_rad: FloatArray
    ) -> FloatArray:
        """Predict the joints.

        Args:
            position_rad: Joint angles now, without their offsets, shape (N,), radians.
            velocity_rad_s: Joint velocities now, shape (N,), rad/s.
            sent_rad: Commands sent before now, one a servo period, oldest first, shape (M, N), radians.
            committed_rad: Commands that will be sent before the plan starts, shape (n, N), radians.

        Returns:
            Angles without offsets, and velocities, shape (2, N), radians and rad/s.
        """
        sent = sent_rad[len(sent_rad) - self._sent :]
        known = np.concatenate((position_rad[None], velocity_rad_s[None], sent, committed_rad))
        return np.asarray((self._maps @ known.T[:, :, None])[:, :, 0].T)


# Cached for each neck and delay. Safe: the key is frozen, and the maps are constant.
joints_after_dead_time = lru_cache(maxsize=16)(JointsAfterDeadTime)
