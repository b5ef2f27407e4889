"""Velocity-controlled camera: commands are sent in a thread, renewed, and stopped at the end."""

from __future__ import annotations

import atexit
import contextlib
import threading
from collections.abc import Callable
from typing import Protocol

import numpy as np

from gazempc.errors import RobotError, SettingsError
from gazempc.neck.spec import NeckSpec
from gazempc.neck.speed_steps import SpeedDither, SpeedSteps
from gazempc.robots.robot import check_command
from gazempc.types import FloatArray, JointState

Pair = tuple[float, float]
STILL: Pair = (0.0, 0.0)
# Minimum time between new speeds; a higher rate fills the command queue of cheap cameras.
_HOLD_S = 0.04
# Watchdog: without a command for this time the camera is stopped.
_WATCHDOG_S = 0.4
# Renewal period of moves with a timeout of one second.
_RENEW_S = 0.4
# Minimum period of position requests, in seconds and in reply times: commands have precedence.
_POLL_S, _POLL_ANSWERS = 0.1, 4.0


class SpeedDevice(Protocol):
    """The protocol of a camera. Every method except `close` may raise `RobotError`; not thread-safe."""

    def open(self) -> None:
        """Connect, without motion."""

    def drive(self, speeds_rad_s: Pair) -> None:
        """Hold speeds of pan and tilt, rad/s, positive to the left and up; returns after acceptance by the device.

        Args:
            speeds_rad_s: Available speeds of the device; two zeros stop it.
        """

    def angles_rad(self) -> Pair | None:
        """Read pan and tilt, radians; None for a device without position feedback."""

    def recover(self) -> None:
        """Prepare for the next attempt after a fault."""

    def about(self) -> list[tuple[str, str]]:
        """Identity and capabilities of the device, as pairs of name and value; without motion."""

    def close(self) -> None:
        """Disconnect; the device has been stopped."""


class SpeedCamera:
    """Robot: a pan-tilt camera with speed commands, see `gazempc.robots.robot.Robot`.

    `send_command` chooses speeds of the device by `SpeedDither`; a thread sends the newest. New speeds are chosen only
    after the previous ones were sent, so the return value equals the device's input. The thread renews each move, stops
    the device after the watchdog time, and after a fault repeats a stop until it is accepted. `close`, the end of the
    program and a fault of the loop also stop the device.

    Args:
        device: The protocol of the camera.
        neck: The neck: two joints with ``command = "velocity"``, or both position-controlled if `go_to` is given.
        clock_s: Returns the loop's time, seconds.
        steps: Speeds of pan and tilt; None for continuous speeds.
        go_to: Moves to angles of pan and tilt, radians, and returns after acceptance by the device; None for a device
            without position commands.

    Raises:
        SettingsError: If the neck has other joints, or unsupported command types.
    """

    def __init__(
        self,
        device: SpeedDevice,
        neck: NeckSpec,
        clock_s: Callable[[], float],
        steps: tuple[SpeedSteps | None, SpeedSteps | None],
        go_to: Callable[[Pair], None] | None = None,
    ) -> None:
        self._angles = go_to is not None and not neck.takes_speeds
        if neck.joints != 2 or not (self._angles or neck.speed_joints.all()):
            raise SettingsError(f'neck {neck.name!r}: accepted: pan and tilt with command = "velocity", such as ptz')
        self._send = device.drive if go_to is None or neck.takes_speeds else go_to
        self._limits_rad = neck.position_min_rad, neck.position_max_rad
        self._device, self._clock_s, self._reports = device, clock_s, neck.reports_joints
        self._dithers = [SpeedDither(s, axis.velocity_max_rad_s) for s, axis in zip(steps, neck.axes, strict=True)]
        self._wake = threading.Condition()
        self._thread: threading.Thread | None = None
        self._mail: Pair | None = None
        self._sending = self._closing = False
        self._problem = ""
        self._state: JointState | None = None
        self._chosen_s = self._fed_s = -np.inf

    def connect(self) -> None:
        """Connect and stop the camera; see `gazempc.robots.robot.Robot.connect`."""
        if self._thread is not None:
            return
        try:
            self._device.open()
            self._device.drive(STILL)
            try:
                if self._reports:
                    self._poll()
            except RobotError as error:
                hint = "for a camera without position replies set reports_joints = false in the neck file"
                raise RobotError(f"{error}; {hint}") from None
        except BaseException:
            self._device.close()
            raise
        self._closing, self._problem, self._mail, self._sending = False, "", None, False
        for dither in self._dithers:
            dither.choose(0.0, _HOLD_S)
        self._chosen_s = self._fed_s = -np.inf
        self._thread = threading.Thread(target=self._work, name="speeds", daemon=True)
        self._thread.start()
        atexit.register(self.close)

    def read_state(self) -> JointState | None:
        """See `gazempc.robots.robot.Robot.read_state`: each position reply once; None without a new one."""
        with self._wake:
            state, self._state = self._state, None
        return state

    def send_command(self, command: FloatArray) -> FloatArray:
        """See `gazempc.robots.robot.Robot.send_command`; returns at once.

        Args:
            command: Speeds of pan and tilt, shape (2,), rad/s; or angles, radians.

        Returns:
            The speeds in force, shape (2,), rad/s; or the angles clamped to the range.
        """
        check_command(command, 2)
        wanted: list[float] = command.tolist()
        now_s = self._clock_s()
        with self._wake:
            if self._thread is None:
                raise RobotError("the camera is not connected: call connect() first")
            since_s, self._fed_s = now_s - self._fed_s, now_s
            if self._problem:
                raise RobotError(self._problem)
            if self._angles:
                sent: FloatArray = np.clip(command, *self._limits_rad)
                self._mail = float(sent[0]), float(sent[1])
                self._wake.notify()
                return sent
            for dither, speed in zip(self._dithers, wanted, strict=True):
                dither.hold(speed, min(max(since_s, 0.0), _WATCHDOG_S))
            if wanted == [0.0, 0.0] or not (self._sending or now_s - self._chosen_s < _HOLD_S):
                before = tuple(dither.held_rad_s for dither in self._dithers)
                pan, tilt = (d.choose(speed, _HOLD_S) for d, speed in zip(self._dithers, wanted, strict=True))
                self._chosen_s = now_s
                if (pan, tilt) != before:
                    self._mail, self._sending = (pan, tilt), True
                    self._wake.notify()
            return np.array([dither.held_rad_s for dither in self._dithers])

    def close(self) -> None:
        """Stop the camera and disconnect; see `gazempc.robots.robot.Robot.close`."""
        thread, self._thread = self._thread, None
        if thread is None:
            return
        with self._wake:
            self._closing = True
            self._wake.notify()
        thread.join(5.0)
        for _ in range(3):
            with contextlib.suppress(Exception):
                self._device.drive(STILL)
                break
        with contextlib.suppress(Exception):
            self._device.close()
        atexit.unregister(self.close)

    def probe(self) -> list[tuple[str, str]]:
        """Connect, read identity and capabilities of the device, and disconnect; without motion.

        Returns:
            Pairs of name and value.

        Raises:
            RobotError: If the device does not reply.
        """
        with contextlib.closing(self._device) as device:
            device.open()
            return device.about()

    def _work(self) -> None:
        # None before the first command: no renewal.
        speeds: Pair | None = None
        sent_s, polls_s = self._clock_s(), -np.inf if self._reports else np.inf
        self._fed_s = sent_s
        while True:
            with self._wake:
                # Time between two attempts after a fault.
                pause_s = 0.3 if self._problem else max(min(sent_s + _RENEW_S, polls_s) - self._clock_s(), 0.0)
                self._wake.wait_for(lambda: self._closing or (self._mail and not self._problem), pause_s)
                if self._closing:
                    return
                fresh, send = self._mail is not None, self._send
                speeds, self._mail = self._mail or speeds, None
                if self._problem or self._clock_s() - self._fed_s > _WATCHDOG_S:
                    # The next command starts from rest.
                    fresh, speeds, send = speeds not in (None, STILL), STILL, self._device.drive
                    for dither in self._dithers:
                        dither.choose(0.0, _HOLD_S)
            try:
                if self._problem:
                    self._device.recover()
                if speeds is not None and (fresh or self._problem or self._clock_s() - sent_s >= _RENEW_S):
                    send(speeds)
                    sent_s = self._clock_s()
                with self._wake:
                    self._sending = self._mail is not None
                if (asked_s := self._clock_s()) >= polls_s:
                    # Optional: without readings the observer runs open-loop; a lost camera also refuses moves.
                    with contextlib.suppress(RobotError):
                        self._poll()
                    polls_s = asked_s + max(_POLL_S, _POLL_ANSWERS * (self._clock_s() - asked_s))
                problem = ""
            except Exception as error:
                problem = str(error) or type(error).__name__
            with self._wake:
                self._problem, self._sending = problem, self._mail is not None

    def _poll(self) -> None:
        asked_s = self._clock_s()
        angles = self._device.angles_rad()
        if angles is not None:
            speeds = np.array([dither.held_rad_s for dither in self._dithers])
            with self._wake:
                self._state = JointState(0.5 * (asked_s + self._clock_s()), np.array(angles), speeds)
