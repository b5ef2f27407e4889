"""Commands to the robot: what was sent, and what follows when a command is lost."""

from __future__ import annotations

import math

import numpy as np

from gazempc.controllers.controller import AxisMotion
from gazempc.loop.drive import Drive
from gazempc.loop.events import Event
from gazempc.loop.observer import JointObserver
from gazempc.loop.recorder import LoopRecorder
from gazempc.loop.smoother import Smoother
from gazempc.neck.spec import NeckSpec
from gazempc.robots.robot import Robot
from gazempc.types import FloatArray

# So many commands in a row may get lost before the motion starts again from rest: on a busy line single ones do.
_SENDS_FORGIVEN = 2


class Sender:
    """Sends the smoother's motion as the joints take it, angles or speeds.

    Args:
        neck: The neck.
        robot: Executes the commands; connected.
        smoother: Makes the commands; set back after a lost one.

    Attributes:
        accepted: The last command that the robot accepted, shape (N,), radians or rad/s.
        gets_through: Whether the last command was accepted.
    """

    def __init__(self, neck: NeckSpec, robot: Robot, smoother: Smoother) -> None:
        self._robot, self._smoother = robot, smoother
        start_rad = smoother.command.position_rad
        self._drive, self._takes_speeds = Drive(neck, start_rad), neck.takes_speeds
        history = int(np.ceil(float(np.max(neck.dead_time_s)) / neck.servo_period_s)) + 2
        # Angles that the commands sent lead to, one row a servo period, oldest first.
        self._sent_rad: FloatArray = np.tile(start_rad, (history, 1))
        self.accepted: FloatArray = np.array(
            [0.0 if axis.takes_speed else at for axis, at in zip(neck.axes, start_rad, strict=True)]
        )
        self.gets_through = True
        self._lost = 0

    def seen_by_controllers(self, offset_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Copies of the commands sent and of the offsets, see `Drive.seen_by_controllers`."""
        return self._drive.seen_by_controllers(self._sent_rad, offset_rad)

    def skip(self, ticks: int) -> list[FloatArray]:
        """Account for servo periods without a command: the robot keeps the last accepted one.

        Args:
            ticks: Number of periods.

        Returns:
            The angles that it leads to, one array of shape (N,) a period, radians; at most as many as are kept.
        """
        return [self._note(got_through=False) for _ in range(min(ticks, len(self._sent_rad)))]

    def send(
        self,
        command_rad: FloatArray,
        before: tuple[AxisMotion, ...],
        observer: JointObserver,
        time_s: float,
        recorder: LoopRecorder,
    ) -> tuple[FloatArray, bool]:
        """Send one command. A single lost one is repeated by the motion; after several the motion starts from rest.

        Args:
            command_rad: The smoother's command, shape (N,), radians.
            before: The motions before this command.
            observer: Has the offsets of the joints, which a joint that takes speeds needs.
            time_s: The time, seconds.
            recorder: Records what the robot raises.

        Returns:
            The angles that the accepted command leads to, shape (N,), radians; whether the motion starts from rest.
        """
        command = command_rad
        if self._takes_speeds:
            command = self._drive.outgoing(self._smoother.motions, observer.estimate.offset_rad)
        restarts = False
        try:
            accepted: FloatArray = np.array(self._robot.send_command(command), dtype=np.float64)
            if accepted.shape != command.shape or not all(map(math.isfinite, accepted.tolist())):
                raise ValueError(
                    f"send_command() returned {accepted!r}, needed are {len(command)} finite angles in radians"
                )
        except Exception as error:
            recorder.event(time_s, Event.ROBOT_NOT_ANSWERING, error)
            self.gets_through = False
            self._lost += 1
            restarts = self._lost > _SENDS_FORGIVEN
            if restarts:
                # The robot stands by the last accepted command. Had the command moved on meanwhile, the first one to
                # get through would be a jump.
                self._smoother.reset(self._drive.restart(self.accepted, observer.estimate.offset_rad))
            else:
                self._smoother.resume(before)
        else:
            self.accepted, self.gets_through, self._lost = accepted, True, 0
        return self._note(self.gets_through), restarts

    def _note(self, got_through: bool) -> FloatArray:
        sent_rad = self._drive.sent(self.accepted, got_through).copy()
        self._sent_rad[:-1] = self._sent_rad[1:]
        self._sent_rad[-1] = sent_rad
        return sent_rad
