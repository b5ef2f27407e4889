"""Robots of a live run or an identification: construction, approach to the command limits, reading in a thread."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from gazempc.errors import RobotError
from gazempc.live.clock import Clock
from gazempc.loop.boundary import boundary, slow_calls
from gazempc.neck.spec import NeckSpec
from gazempc.part_options import make, options_for
from gazempc.parts import ROBOT, Kind, error_line, find, is_own, split_address
from gazempc.robots.options import RobotOptions
from gazempc.robots.robot import Robot, checked_reading, way_in_rad
from gazempc.types import FloatArray, JointState


def keeps_any_clock(kind: Kind, choice: str) -> bool:
    """Whether a robot or source runs on any clock, real or simulated, by its class attribute.

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
        choice: A shipped name or ``module:Class``. A user's constructor may have the parameters ``neck``, ``clock_s``
            (returns the loop's time in seconds), ``clock``, ``position_rad`` and ``seed``.
        options: Options of shipped and user-defined robots.
        neck: The neck; complete model of a simulated robot.
        clock: The loop's clock.
        position_rad: Initial angles of a simulated robot, shape (N,), radians.
        seed: Seed of the encoder noise of a simulated robot.

    Returns:
        The robot.

    Raises:
        SettingsError: If there is no such robot, an option is invalid or a method is missing.
    """
    given = {"neck": neck, "clock_s": clock.now_s, "clock": clock, "position_rad": position_rad, "seed": seed}
    if not is_own(choice):
        name, address = split_address(choice)
        given |= {"address": address, "options": getattr(options, name, None), "to_loop_s": clock.from_unix_s}
    robot: Robot = make(ROBOT, choice, given, options_for(ROBOT, choice, options.own))
    return robot


# Timeout of the first reading.
_FIRST_READING_S = 1.0
# Difference from the present time that indicates a stamp of another clock, such as Unix time.
_OTHER_CLOCK_S = 10.0


def first_position_rad(robot: Robot, neck: NeckSpec, clock: Clock, stop: threading.Event) -> FloatArray | None:
    """Read the initial joint angles: a first command elsewhere would be a step.

    Args:
        robot: The robot, connected.
        neck: The neck.
        clock: The loop's clock.
        stop: Ends the wait.

    Returns:
        Angles of all joints, shape (N,), radians; None if stopped before a reading.

    Raises:
        RobotError: Without a valid reading within 1 s.
    """
    if not neck.reports_joints:
        return neck.rest_rad
    until_s = clock.now_s() + _FIRST_READING_S
    problem = "there is no reading"
    while not stop.is_set():
        try:
            state = checked_reading(robot.read_state(), neck)
            if state is not None:
                _check_first(state, clock.now_s())
                return state.position_rad
        except Exception as error:
            problem = str(error) if isinstance(error, RobotError) else error_line(error)
        if clock.now_s() >= until_s:
            raise RobotError(
                f"the joints cannot be read ({problem}), and a first command elsewhere would be a step: check the "
                "robot; live runs accept one without encoders that stands at rest (reports_joints = false in the neck "
                "file), identification does not"
            )
        clock.sleep_until_s(clock.now_s() + neck.servo_period_s)
    return None


def go_in(robot: Robot, neck: NeckSpec, clock: Clock, start_rad: FloatArray, stop: threading.Event) -> None:
    """Move a neck slowly from the margin of its joints' range into the command limits.

    Args:
        robot: The robot, connected.
        neck: The neck.
        clock: The loop's clock.
        start_rad: Present angles, shape (N,), radians.
        stop: Ends the motion.
    """
    start_s = clock.now_s()
    for k, command_rad in enumerate(way_in_rad(neck, start_rad)):
        if stop.is_set():
            return
        clock.sleep_until_s(start_s + k * neck.servo_period_s)
        # The position loop moves a velocity-controlled joint into the limits.
        robot.send_command(np.where(neck.speed_joints, 0.0, command_rad))


def _check_first(state: JointState, now_s: float) -> None:
    """Refuse a reading without angles, or with a stamp of another clock."""
    if not np.all(np.isfinite(state.position_rad)):
        raise RobotError(f"read_state() returned position_rad {state.position_rad}, expected finite radians")
    if abs(state.time_s - now_s) > _OTHER_CLOCK_S:
        raise RobotError(
            f"read_state() returned time_s {state.time_s:.1f}, but the loop's clock is at {now_s:.1f}: "
            "stamp readings by clock_s, an argument of the robot's constructor"
        )


class MonotonicRobot:
    """Converts stamps of a robot from `time.monotonic` to the loop's clock.

    Args:
        inner: The robot.
        clock: The loop's clock.
    """

    def __init__(self, inner: Robot, clock: Clock) -> None:
        self.wrapped, self._clock = inner, clock
        self.connect, self.send_command, self.close = inner.connect, inner.send_command, inner.close

    def read_state(self) -> JointState | None:
        """See `gazempc.robots.robot.Robot.read_state`."""
        state = self.wrapped.read_state()
        return None if state is None else replace(state, time_s=self._clock.from_monotonic_s(state.time_s))


# Timeout of a command that waits for a reading in progress; after it the command is sent concurrently.
_PATIENCE_S = 0.012


class ReadAside:
    """A robot whose joints are read in a separate thread, once after each command.

    Calls of the driver are mutually exclusive, except for commands during a reading beyond its timeout.

    Args:
        robot: The robot, connected.
    """

    def __init__(self, robot: Robot) -> None:
        self.wrapped = robot
        self._reading, self._hangs = threading.Lock(), False
        self._wake, self._closed = threading.Event(), False
        self._answer: deque[JointState | BaseException | None] = deque(maxlen=1)
        # A driver that never returns must not keep the process alive.
        self._thread = threading.Thread(target=self._work, name="joints", daemon=True)
        self._thread.start()

    def connect(self) -> None:
        """See `gazempc.robots.robot.Robot.connect`."""
        self.wrapped.connect()

    def read_state(self) -> JointState | None:
        """The reading since the last call; None without one."""
        answer = self._answer.popleft() if self._answer else None
        if isinstance(answer, BaseException):
            raise answer
        return answer

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Exclusive access to the robot, unless a reading is beyond its timeout."""
        free = self._reading.acquire(timeout=0.0 if self._hangs else _PATIENCE_S)
        self._hangs = not free
        try:
            yield
        finally:
            if free:
                self._reading.release()

    def send_command(self, position_rad: FloatArray) -> FloatArray:
        """See `gazempc.robots.robot.Robot.send_command`."""
        try:
            with self.alone():
                return self.wrapped.send_command(position_rad)
        finally:
            self._wake.set()

    def slow_calls(self, ended: bool) -> list[TimeoutError | None]:
        """A slow reading, see `gazempc.loop.boundary.slow_calls`."""
        return slow_calls(self._thread.ident or 0, ended)

    def close(self) -> None:
        """Close the robot; waits only briefly for a reading in progress."""
        self._closed = True
        self._wake.set()
        self._thread.join(timeout=1.0)
        self.wrapped.close()

    def _work(self) -> None:
        while self._wake.wait() and not self._closed:
            self._wake.clear()
            try:
                with self._reading, boundary(self.wrapped, "read_state"):
                    answer: JointState | BaseException | None = self.wrapped.read_state()
            except BaseException as error:
                answer = error
            self._answer.append(answer)
