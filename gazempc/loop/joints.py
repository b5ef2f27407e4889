"""Joint readings: validation, and detection of joints that do not follow their commands."""

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

# Sliding window over which measured and expected motion are compared.
_WINDOW_S = 0.6
# Smallest expected motion that is judged: ten times the error of encoders. Eyes that follow a walker exceed it in every
# window.
_EXPECTED_RAD = math.radians(2.0)
# Least ratio of measured to expected motion of a joint that follows.
_SHARE = 0.2
# Above this share of missing readings in the window, measured and expected motion are not comparable.
_UNREAD_SHARE = 0.2


def read_joints(robot: Robot, neck: NeckSpec, time_s: float, recorder: LoopRecorder) -> JointState | None:
    """Read the joints.

    The contract of a driver allows `RobotError` only; here any exception or invalid reading becomes an event.

    Args:
        robot: The robot.
        neck: The neck.
        time_s: The time, seconds.
        recorder: Records the event `robot_not_answering`.

    Returns:
        The reading; None if it is missing or invalid.
    """
    with boundary(robot, "read_state", partial(recorder.event, time_s, Event.ROBOT_NOT_ANSWERING)):
        return checked_reading(robot.read_state(), neck)
    return None


class FollowingWatch:
    """Compares the range of motion of each joint with that of its simulated servo, over a sliding window.

    Insensitive to offsets (gravity, a wrong zero) and to small errors of the dead time, as only motion is compared. The
    servo model is needed because brief command pulses move no joint. A held joint is released when its range of motion
    reaches the smallest one that is judged.

    Args:
        neck: The neck.
    """

    def __init__(self, neck: NeckSpec) -> None:
        period_s = neck.servo_period_s
        self._ticks = math.ceil(_WINDOW_S / period_s)
        # Python floats: NumPy scalars take several times as long.
        self._steps = [zero_order_hold(axis, period_s).tolist() for axis in neck.axes]
        self._delay_ticks: list[int] = np.rint(neck.dead_time_s / period_s).astype(int).tolist()
        self._sent: deque[list[float]] = deque(maxlen=max(self._delay_ticks) + 1)
        # Simulated angle and velocity of each joint.
        self._states: list[tuple[float, float]] = []
        # Ring buffers, shape (ticks, joints): the range of motion is that of all rows.
        self._expected_rad, self._measured_rad = np.zeros((2, self._ticks, neck.joints))
        self._sent_ticks = self._read_ticks = self._unread_ticks = 0
        self._stands: BoolArray = np.zeros(neck.joints, dtype=np.bool_)
        #: Indices in `NeckSpec.joint_names` of joints that do not follow, ascending.
        self.held: tuple[int, ...] = ()

    def sent(self, command_rad: FloatArray) -> None:
        """Add the angles commanded in this servo period, shape (N,), radians."""
        sent = command_rad.tolist()
        self._sent.append(sent)
        if not self._states:
            self._states = [(angle, 0.0) for angle in sent]
        newest = len(self._sent) - 1
        for joint, ((qq, qv, qu), (vq, vv, vu)) in enumerate(self._steps):
            angle, velocity = self._states[joint]
            acting = self._sent[max(newest - self._delay_ticks[joint], 0)][joint]
            self._states[joint] = qq * angle + qv * velocity + qu * acting, vq * angle + vv * velocity + vu * acting
        self._expected_rad[self._sent_ticks % self._ticks] = [angle for angle, _ in self._states]
        self._sent_ticks += 1

    def measured(self, state: JointState | None) -> None:
        """Add the reading of this servo period; None for a missing one."""
        self._unread_ticks += 1
        if state is not None and all(map(math.isfinite, state.position_rad.tolist())):
            self._measured_rad[self._read_ticks % self._ticks] = state.position_rad
            self._read_ticks, self._unread_ticks = self._read_ticks + 1, 0

    def judge(self) -> None:
        """Update `held` once the window is full; unchanged while readings are missing."""
        if self._unread_ticks > _UNREAD_SHARE * self._ticks or min(self._sent_ticks, self._read_ticks) < self._ticks:
            return
        expected_rad, moved_rad = (np.ptp(each, axis=0) for each in (self._expected_rad, self._measured_rad))
        stops = (expected_rad > _EXPECTED_RAD) & (moved_rad < _SHARE * expected_rad)
        self._stands = np.where(self._stands, moved_rad < _EXPECTED_RAD, stops)
        self.held = tuple(np.flatnonzero(self._stands).tolist())
