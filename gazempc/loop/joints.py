"""Readings of the joints: unusable ones become events, and joints that do not follow their commands are found."""

from __future__ import annotations

import math
from collections import deque
from functools import partial

import numpy as np

from gazempc.loop.boundary import boundary
from gazempc.loop.events import Event
from gazempc.loop.recorder import LoopRecorder
from gazempc.neck.servo import zero_order_hold
from gazempc.neck.spec import NeckSpec
from gazempc.robots.robot import Robot, checked_reading
from gazempc.types import BoolArray, FloatArray, JointState

# The motion in this time is compared with the one that the commands should have caused.
_WINDOW_S = 0.6
# A joint that should have moved by this much has moved, too: encoders are ten times as exact. Eyes that follow a walker
# move by so much in every window.
_EXPECTED_RAD = math.radians(2.0)
# A joint that follows shows more than this share of the expected motion.
_SHARE = 0.2
# With readings missing for a larger share of the window, measured and expected motion are of different times.
_UNREAD_SHARE = 0.2


def read_joints(robot: Robot, neck: NeckSpec, time_s: float, recorder: LoopRecorder) -> JointState | None:
    """Read the joints.

    A driver is to raise `RobotError` only. The loop goes on with any exception, and with any other answer.

    Args:
        robot: The robot.
        neck: The neck.
        time_s: The time, seconds.
        recorder: Records the event `robot_not_answering`.

    Returns:
        The reading; None if there is none, or none that can be used.
    """
    with boundary(robot, "read_state", partial(recorder.event, time_s, Event.ROBOT_NOT_ANSWERING)):
        return checked_reading(robot.read_state(), neck)
    return None


class FollowingWatch:
    """Compares the motion of each joint with the one that its servo makes of the commands, over a sliding window.

    Offsets (gravity, a wrong zero) do not count, and neither does a dead time that is a little off: only motion is
    compared. Commands alone would not do: a leap to and fro moves no joint. A held joint is taken to follow again
    when it has moved by as much as would have to be expected.

    Args:
        neck: The neck.
    """

    def __init__(self, neck: NeckSpec) -> None:
        period_s = neck.servo_period_s
        self._ticks = math.ceil(_WINDOW_S / period_s)
        # Plain numbers: arithmetic with numpy's takes several times as long.
        self._steps = [zero_order_hold(axis, period_s).tolist() for axis in neck.axes]
        self._delay_ticks: list[int] = np.rint(neck.dead_time_s / period_s).astype(int).tolist()
        self._sent: deque[list[float]] = deque(maxlen=max(self._delay_ticks) + 1)
        # Angle and velocity of each joint as its servo makes them of the commands.
        self._states: list[tuple[float, float]] = []
        self._expected: deque[list[float]] = deque(maxlen=self._ticks)
        self._measured: deque[FloatArray] = deque(maxlen=self._ticks)
        self._unread_ticks = 0
        self._stands: BoolArray = np.zeros(neck.joints, dtype=np.bool_)
        #: Joints that do not follow, by their place in `NeckSpec.joint_names`, ascending.
        self.held: tuple[int, ...] = ()

    def sent(self, command_rad: FloatArray) -> None:
        """Take in the angles that the command of this servo period leads to, shape (N,), radians."""
        sent = command_rad.tolist()
        self._sent.append(sent)
        if not self._states:
            self._states = [(angle, 0.0) for angle in sent]
        newest = len(self._sent) - 1
        for joint, ((qq, qv, qu), (vq, vv, vu)) in enumerate(self._steps):
            angle, velocity = self._states[joint]
            acting = self._sent[max(newest - self._delay_ticks[joint], 0)][joint]
            self._states[joint] = qq * angle + qv * velocity + qu * acting, vq * angle + vv * velocity + vu * acting
        self._expected.append([angle for angle, _ in self._states])

    def measured(self, state: JointState | None) -> None:
        """Take in the reading of this servo period; None without one."""
        self._unread_ticks += 1
        if state is not None and np.isfinite(state.position_rad).all():
            self._measured.append(state.position_rad)
            self._unread_ticks = 0

    def judge(self) -> None:
        """Decide which joints do not follow, once the window is full; kept while readings are missing."""
        if (
            self._unread_ticks > _UNREAD_SHARE * self._ticks
            or len(self._expected) < self._ticks
            or len(self._measured) < self._ticks
        ):
            return
        expected_rad, moved_rad = (np.ptp(np.array(each), axis=0) for each in (self._expected, self._measured))
        stops = (expected_rad > _EXPECTED_RAD) & (moved_rad < _SHARE * expected_rad)
        self._stands = np.where(self._stands, moved_rad < _EXPECTED_RAD, stops)
        self.held = tuple(np.flatnonzero(self._stands).tolist())
