"""Robots by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from gazempc.clock import Clock
from gazempc.neck import NeckSpec
from gazempc.robots.mujoco import MujocoNeck
from gazempc.robots.robot import JointState, Robot
from gazempc.robots.simulated import SimulatedNeck

FloatArray = NDArray[np.float64]

RobotName = Literal["simulated", "mujoco"]
# These keep the loop's time: they can be run on a simulated clock, and their true state is known.
SIMULATED: tuple[RobotName, ...] = ("simulated", "mujoco")


class RobotOptions(BaseModel):
    """Options of all robots; each reads its own."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def make_robot(
    name: RobotName, options: RobotOptions, neck: NeckSpec, clock: Clock, position_rad: FloatArray, seed: int = 0
) -> Robot:
    """Make a robot; it is not connected yet.

    Args:
        name: Which one.
        options: Its options are in here.
        neck: Its limits; of a simulated one all that it is.
        clock: The loop's clock.
        position_rad: Where a simulated one stands in the beginning, shape (2,), radians.
        seed: Of a simulated one's encoder noise.

    Returns:
        The robot.
    """
    if name == "mujoco":
        return MujocoNeck(neck, clock.now_s, position_rad, seed)
    return SimulatedNeck(neck, position_rad, clock.now_s, seed)


def true_state_of(robot: Robot) -> Callable[[], JointState] | None:
    """How to ask a simulated robot where its joints really are; None for a robot that nobody can ask."""
    return robot.true_state if isinstance(robot, SimulatedNeck | MujocoNeck) else None
