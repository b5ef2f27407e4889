"""The one interface that all robots have, simulated or real."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class JointState:
    """Measured state of the joints.

    Attributes:
        time_s: When it was measured, seconds, on the loop's clock.
        position_rad: Pan and tilt, shape (2,), radians.
        velocity_rad_s: Their velocities, shape (2,), rad/s.
    """

    time_s: float
    position_rad: FloatArray
    velocity_rad_s: FloatArray


class Robot(Protocol):
    """A pan-tilt neck that takes position commands.

    Every method but `close` raises `gazempc.errors.RobotError` if the robot does not answer.
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
            position_rad: Pan and tilt, shape (2,), radians.

        Returns:
            What was really sent, shape (2,), radians: clamped to the joints' range.
        """
        ...

    def close(self) -> None:
        """Close the connection; never raises, and may be called at any time."""
        ...
