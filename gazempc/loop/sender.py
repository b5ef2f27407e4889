"""Transmission of commands: history of commands sent, and detection of lost ones."""

from __future__ import annotations

import math
import sys
from functools import partial

import numpy as np

from gazempc.loop.boundary import boundary, numbers
from gazempc.loop.drive import Drive
from gazempc.loop.events import Event
from gazempc.loop.observer import JointObserver
from gazempc.loop.recorder import LoopRecorder
from gazempc.loop.smoother import Smoother
from gazempc.neck.spec import NeckSpec
from gazempc.robots.robot import Robot
from gazempc.types import FloatArray

# Tolerated consecutive losses before the neck brakes: on a busy line single commands are lost.
_SENDS_FORGIVEN = 2
# Skipped periods are simulated for this time after the dead time: longer than the window of `FollowingWatch`. Earlier
# ones, as of a suspended computer, are summed.
_KEPT_S = 1.0
# Largest rounding by the robot, to the resolution of its protocol.
_ROUNDED_RAD = math.radians(1.0)


class Sender:
    """Sends the smoother's motion to the robot, as angles or speeds.

    An unacknowledged command may have been executed, so it counts as sent.

    Args:
        neck: The neck.
        robot: Executes the commands; connected.
        smoother: Computes the commands.

    Attributes:
        sent: The last command that the robot may have executed, shape (N,), radians or rad/s.
        acknowledged_rad: Angles resulting from the last acknowledged command, shape (N,), radians.
    """

    def __init__(self, neck: NeckSpec, robot: Robot, smoother: Smoother) -> None:
        self._neck, self._robot, self._smoother = neck, robot, smoother
        start_rad = smoother.command.position_rad
        self._drive, self._takes_speeds = Drive(neck, start_rad), neck.takes_speeds
        history = int(np.ceil(float(np.max(neck.dead_time_s)) / neck.servo_period_s)) + 2
        # Angles resulting from the commands sent, one row a servo period, oldest first.
        self._sent_rad: FloatArray = np.tile(start_rad, (history, 1))
        self.sent: FloatArray = np.where(neck.speed_joints, 0.0, start_rad)
        # Accepted answers of the robot: angles within the range, any finite speed.
        low, high = neck.position_min_rad - _ROUNDED_RAD, neck.position_max_rad + _ROUNDED_RAD
        bounds = np.where(neck.speed_joints, [[-sys.float_info.max], [sys.float_info.max]], [low, high])
        self._bounds: list[tuple[float, float]] = list(map(tuple, bounds.T.tolist()))
        self.acknowledged_rad: FloatArray = start_rad
        self._lost = 0

    def for_controllers(self, offset_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Copies of the commands sent and of the offsets, see `Drive.for_controllers`."""
        return self._drive.for_controllers(self._sent_rad, offset_rad)

    def skip(self, ticks: int) -> list[FloatArray]:
        """Account for servo periods without a command: the robot keeps the last one.

        Args:
            ticks: Number of periods.

        Returns:
            The resulting angles, one array of shape (N,) a period, radians; at most those of the last seconds.
        """
        kept = min(ticks, len(self._sent_rad) + math.ceil(_KEPT_S / self._neck.servo_period_s))
        if ticks > kept:
            self._drive.skip(ticks - kept, self.sent)
        return [self._note(got_through=False) for _ in range(kept)]

    @property
    def silent(self) -> bool:
        """Whether more consecutive commands than tolerated are unacknowledged."""
        return self._lost > _SENDS_FORGIVEN

    def send(
        self,
        command_rad: FloatArray,
        observer: JointObserver,
        time_s: float,
        recorder: LoopRecorder,
        limit_rad_s: float,
    ) -> FloatArray:
        """Send one command.

        Args:
            command_rad: The smoother's command, shape (N,), radians.
            observer: Estimates the offsets of the joints, for the position loop of velocity-controlled joints.
            time_s: The time, seconds.
            recorder: Records exceptions of the robot.
            limit_rad_s: Speed limit in force, rad/s, for the position loop of velocity-controlled joints.

        Returns:
            The resulting angles, shape (N,), radians.
        """
        command = command_rad
        if self._takes_speeds:
            command = self._drive.outgoing(self._smoother.motions, observer.estimate.offset_rad, limit_rad_s)
        sent: FloatArray | None = None
        with boundary(self._robot, "send_command", partial(recorder.event, time_s, Event.ROBOT_NOT_ANSWERING)):
            sent = self._checked(self._robot.send_command(command.copy()))
        if sent is None:
            self.sent, self._lost = command, self._lost + 1
        else:
            self.sent, self._lost, self.acknowledged_rad = sent, 0, command_rad
        return self._note(got_through=True)

    def _checked(self, answered: object) -> FloatArray:
        sent = numbers("what send_command() returned", np.array(answered), (self._neck.joints,))
        # Negated to refuse NaN.
        if not all(low <= each <= high for each, (low, high) in zip(sent.tolist(), self._bounds, strict=True)):
            raise ValueError(f"send_command() returned {sent}, expected angles within the range of each joint, radians")
        return sent

    def _note(self, got_through: bool) -> FloatArray:
        sent_rad = self._drive.sent(self.sent, got_through).copy()
        self._sent_rad[:-1] = self._sent_rad[1:]
        self._sent_rad[-1] = sent_rad
        return sent_rad
