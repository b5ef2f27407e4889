"""The one interface that all robots have, simulated or real."""

from __future__ import annotations

from typing import Protocol

from gazempc.types import FloatArray, JointState


class Robot(Protocol):
    """A neck that takes positions, or speeds on an axis whose neck file says ``command = "velocity"``.

    Every method but `close` raises `gazempc.errors.RobotError` if the robot does not answer.

    A simulated one says two things more: the class attribute ``keeps_any_clock = True`` (it lives in the loop's time,
    so it may run on a simulated clock), and the method ``true_state() -> JointState`` (where its joints really are).
    """

    def connect(self) -> None:
        """Open the connection; calling it again does nothing."""
        ...

    def read_state(self) -> JointState | None:
        """Read the joints.

        Returns:
            The latest measured state; None if the robot does not measure its joints, or has nothing new.
        """
        ...

    def send_command(self, position_rad: FloatArray) -> FloatArray:
        """Send joint positions to go to.

        Args:
            position_rad: One for each joint, in the order of `NeckSpec.joint_names`, shape (N,), radians.

        Returns:
            What was really sent, shape (N,), radians: clamped to the joints' range.
        """
        ...

    def close(self) -> None:
        """Close the connection; never raises, and may be called at any time."""
        ...
