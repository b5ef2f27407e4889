"""A robot object of the user's own in the loop's time."""

from __future__ import annotations

from dataclasses import replace

from gazempc.live.clock import RealClock
from gazempc.live.robots import make_robot
from gazempc.neck.spec import NeckSpec
from gazempc.parts import ROBOT, check_methods, name_of
from gazempc.robots.options import RobotOptions
from gazempc.robots.robot import Robot
from gazempc.types import FloatArray, JointState


class MonotonicRobot:
    """Puts the times of a robot's readings on the loop's clock: it was made before that clock was.

    Args:
        inner: The robot; it stamps its joints with `time.monotonic`.
        clock: The loop's clock.
    """

    def __init__(self, inner: Robot, clock: RealClock) -> None:
        self._inner, self._clock = inner, clock

    def connect(self) -> None:
        """See `gazempc.robots.robot.Robot.connect`."""
        self._inner.connect()

    def read_state(self) -> JointState | None:
        """See `gazempc.robots.robot.Robot.read_state`."""
        state = self._inner.read_state()
        return None if state is None else replace(state, time_s=self._clock.from_monotonic_s(state.time_s))

    def send_command(self, position_rad: FloatArray) -> FloatArray:
        """See `gazempc.robots.robot.Robot.send_command`."""
        return self._inner.send_command(position_rad)

    def close(self) -> None:
        """See `gazempc.robots.robot.Robot.close`."""
        self._inner.close()


def ready_robot(robot: str | Robot, options: RobotOptions, neck: NeckSpec, clock: RealClock) -> tuple[Robot, str]:
    """Make a robot by name, or take an object of the user's own.

    Args:
        robot: A shipped name, ``module:Class``, or a robot.
        options: Options of a robot by name.
        neck: The neck.
        clock: The loop's clock.

    Returns:
        The robot and its name.

    Raises:
        SettingsError: If it cannot be made, or lacks a method.
    """
    if isinstance(robot, str):
        return make_robot(robot, options, neck, clock, neck.rest_rad), robot
    check_methods(ROBOT, robot)
    return MonotonicRobot(robot, clock), name_of(ROBOT, robot)
