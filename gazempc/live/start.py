"""The start of a live run: where the joints stand, and the way to where commands may begin."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from gazempc.errors import GazempcError, RobotError
from gazempc.live.parts import LiveParts
from gazempc.neck.spec import NeckSpec
from gazempc.parts import said
from gazempc.robots.start import way_in_rad, wrong_reading
from gazempc.types import FloatArray, JointState

# For so long the joints are asked for before the first command.
_FIRST_READING_S = 1.0
# A first reading this far from now is stamped on another clock, such as Unix time.
_OTHER_CLOCK_S = 10.0


def opened(what: str, call: Callable[[], None], refusal: type[GazempcError]) -> None:
    """Open a robot or a source; whatever one of the user's own raises is a message.

    Args:
        what: The call, for the message.
        call: Does it.
        refusal: The error that is promised.

    Raises:
        GazempcError: If it cannot be opened.
    """
    try:
        call()
    except (GazempcError, OSError):
        raise
    except Exception as error:
        raise refusal(f"{what} raised {said(error)}") from error


def first_position_rad(parts: LiveParts, stop: threading.Event) -> FloatArray | None:
    """Where the joints stand. A command that begins elsewhere is a jump.

    Args:
        parts: The parts; the robot is connected.
        stop: Ends the wait.

    Returns:
        Angles of all joints, shape (N,), radians; None if told to stop before they are known.

    Raises:
        RobotError: If they do not become known.
    """
    if not parts.neck.reports_joints:
        return parts.neck.rest_rad
    clock = parts.clock
    until_s = clock.now_s() + _FIRST_READING_S
    problem = "there is no reading"
    while not stop.is_set():
        try:
            state = parts.robot.read_state()
            wrong = _wrong(state, parts.neck, clock.now_s())
            if state is not None and not wrong:
                return state.position_rad
            problem = wrong or problem
        except RobotError as error:
            problem = str(error)
        except Exception as error:
            problem = said(error)
        if clock.now_s() >= until_s:
            raise RobotError(
                f"the joints cannot be read ({problem}). A command that begins elsewhere than where they stand is a "
                "jump: check the robot, or say reports_joints = false in the neck file if it has no encoders and "
                "stands at rest"
            )
        clock.sleep_until_s(clock.now_s() + parts.neck.servo_period_s)
    return None


def go_in(parts: LiveParts, start_rad: FloatArray, stop: threading.Event) -> None:
    """Bring a neck that stands in the last bit of its range slowly to where commands may be.

    Args:
        parts: The parts; the robot is connected.
        start_rad: Where it stands, shape (N,), radians.
        stop: Ends it.
    """
    start_s = parts.clock.now_s()
    for k, command_rad in enumerate(way_in_rad(parts.neck, start_rad)):
        if stop.is_set():
            return
        parts.clock.sleep_until_s(start_s + k * parts.neck.servo_period_s)
        parts.robot.send_command(command_rad)


def _wrong(state: JointState | None, neck: NeckSpec, now_s: float) -> str:
    """What is wrong with a reading; empty if nothing is."""
    wrong = wrong_reading(state, neck)
    if wrong or state is None:
        return wrong
    if not np.all(np.isfinite(state.position_rad)):
        return f"read_state() returned position_rad {state.position_rad}, needed are finite angles in radians"
    if abs(state.time_s - now_s) > _OTHER_CLOCK_S:
        return (
            f"read_state() returned time_s {state.time_s:.1f}, where the loop's clock says {now_s:.1f}: "
            "stamp readings with the clock_s that the robot's constructor is given"
        )
    return ""
