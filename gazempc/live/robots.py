"""Robots by name, ``module:Class`` or as objects; a live run and an identification make them here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gazempc.errors import SettingsError
from gazempc.live.clock import Clock, RealClock
from gazempc.neck.spec import NeckSpec
from gazempc.part_options import make, options_for
from gazempc.parts import ROBOT, Kind, find, is_own
from gazempc.robots.options import RobotOptions
from gazempc.robots.robot import Robot
from gazempc.types import FloatArray, JointState


def keeps_any_clock(kind: Kind, choice: str) -> bool:
    """Whether a robot or source lives in the loop's time, simulated or not: what its class says.

    Args:
        kind: The kind of part.
        choice: A shipped name or ``module:Class``.

    Returns:
        True if it may run on a simulated clock.

    Raises:
        SettingsError: If there is no such part.
    """
    return bool(getattr(find(kind, choice), "keeps_any_clock", False))


def make_robot(
    choice: str, options: RobotOptions, neck: NeckSpec, clock: Clock, position_rad: FloatArray, seed: int = 0
) -> Robot:
    """Make a robot; it is not connected yet.

    Args:
        choice: A shipped name or ``module:Class``. A constructor of your own may ask for ``neck``, ``clock_s`` (gives
            the loop's time in seconds), ``clock``, ``position_rad`` and ``seed``.
        options: Options of the shipped ones and of your own.
        neck: Its limits; of a simulated one all that it is.
        clock: The loop's clock.
        position_rad: Where a simulated one stands in the beginning, shape (N,), radians.
        seed: Of a simulated one's encoder noise.

    Returns:
        The robot.

    Raises:
        SettingsError: If there is no such robot, an option is wrong or a method is missing. Also if a robot that needs
            real time gets another clock.
    """
    given: dict[str, Any] = {
        "neck": neck,
        "clock_s": clock.now_s,
        "clock": clock,
        "position_rad": position_rad,
        "seed": seed,
    }
    if is_own(choice):
        own: Robot = make(ROBOT, choice, given, options_for(ROBOT, choice, options.own))
        return own
    if choice in type(options).model_fields:
        given["options"] = getattr(options, choice)
    if choice == "ros2":
        if not isinstance(clock, RealClock):
            raise SettingsError("robot ros2 keeps real time")
        given["to_loop_s"] = clock.from_unix_s
    robot: Robot = make(ROBOT, choice, given, {})
    return robot


def true_state_of(robot: object) -> Callable[[], JointState] | None:
    """How to ask a simulated robot where its joints really are.

    Args:
        robot: The robot.

    Returns:
        Its method `true_state`; None if it has none.
    """
    found: Callable[[], JointState] | None = getattr(robot, "true_state", None)
    return found
