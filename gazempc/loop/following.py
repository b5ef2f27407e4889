"""Joints that stand still although their commands move: blocked, unplugged or broken."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray, JointState

# The commands of this time are compared with the motion that they should have caused.
_WINDOW_S = 0.6
# A joint whose commands moved by this much has moved, too: encoders are ten times as exact. Eyes that follow a walker
# move by so much in every window.
_COMMANDED_RAD = math.radians(2.0)
# A joint that follows shows more than this share of its commands' motion.
_SHARE = 0.2


class FollowingWatch:
    """Compares the motion of each joint with the motion of its commands, over a sliding window.

    Offsets (gravity, a wrong zero) do not count, and neither does a dead time that is a little off: only motion is
    compared. A joint that is held is taken to follow again when it has moved by as much as its commands would have to.

    Args:
        neck: The neck; joints that take speeds are not watched.
    """

    def __init__(self, neck: NeckSpec) -> None:
        self._watched = [i for i, axis in enumerate(neck.axes) if not axis.takes_speed]
        period_s = neck.servo_period_s
        self._ticks = math.ceil(_WINDOW_S / period_s)
        # From a command to most of its motion.
        answer_s = neck.dead_time_s + neck.servo_lag_s
        self._delay_ticks = [math.ceil(float(each_s) / period_s) for each_s in answer_s]
        self._sent: deque[FloatArray] = deque(maxlen=self._ticks + max(self._delay_ticks))
        self._measured: deque[FloatArray] = deque(maxlen=self._ticks)
        #: Joints that do not follow, by their place in `NeckSpec.joint_names`, ascending.
        self.held: tuple[int, ...] = ()

    def sent(self, command_rad: FloatArray) -> None:
        """Take note of what was sent in this servo period, shape (N,), radians."""
        self._sent.append(command_rad.copy())

    def measured(self, state: JointState | None) -> None:
        """Take note of what was measured in this servo period; None if nothing was, which changes nothing."""
        if state is not None and np.isfinite(state.position_rad).all():
            self._measured.append(state.position_rad)

    def judge(self) -> tuple[int, ...]:
        """Say anew which joints do not follow, as soon as a whole window is known.

        Returns:
            Joints that follow no longer since the last call.
        """
        if len(self._sent) < self._sent.maxlen or len(self._measured) < self._ticks:  # type: ignore[operator]
            return ()
        sent, moved_rad = np.array(self._sent), np.ptp(np.array(self._measured), axis=0)
        held = []
        for joint in self._watched:
            end = len(sent) - self._delay_ticks[joint]
            commanded_rad = float(np.ptp(sent[end - self._ticks : end, joint]))
            if joint in self.held:
                stands = moved_rad[joint] < _COMMANDED_RAD
            else:
                stands = commanded_rad > _COMMANDED_RAD and moved_rad[joint] < _SHARE * commanded_rad
            if stands:
                held.append(joint)
        before, self.held = self.held, tuple(held)
        return tuple(joint for joint in self.held if joint not in before)
