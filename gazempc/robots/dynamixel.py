"""A neck of Dynamixel X motors, one a joint, on one serial line (protocol 2.0)."""

from __future__ import annotations

import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gazempc.errors import GazempcError, RobotError, SettingsError
from gazempc.neck.spec import NeckSpec
from gazempc.robots.dynamixel_bus import DynamixelBus
from gazempc.robots.options import DynamixelOptions
from gazempc.robots.robot import check_command
from gazempc.types import FloatArray, JointState

_T = TypeVar("_T")

# Parts of the control table: address, bytes. Requests after a failure differ in length from the failed ones, so that a
# late reply is never mistaken for the reply to another request.
_MODE = (11, 1)
_RANGE = (48, 8)  # Max and Min Position Limit
_TORQUE_ENABLE = (64, 1)
_TORQUE = (64, 2)  # Torque Enable and LED
_PROFILE = (108, 8)  # Profile Acceleration and Velocity
_PROFILE_AND_GOAL = (108, 12)
_GOAL = (116, 4)
_PRESENT = (128, 8)  # Present Velocity and Position

_TICKS_PER_TURN = 4096
_TICKS_PER_RAD = _TICKS_PER_TURN / (2.0 * np.pi)
_POSITION_MODE, _EXTENDED_POSITION_MODE = 3, 4

# Period of retries after a timeout; calls in between fail at once.
_RETRY_S = 0.1
_LOST_TORQUE = "a motor has lost its torque; check its power supply"


class DynamixelNeck:
    """X motors (or MX with protocol 2.0), in position or extended position mode, driven by sync read and write.

    `connect` sets Profile Velocity and Profile Acceleration to 0 (no limit), because the smoother shapes the motion and
    a second profile would add unmodelled lag. EEPROM is never written. A motor without torque gets its present position
    as goal before torque is enabled; a motor with torque keeps its goal. After that the first commands are approached
    at `approach_speed_rad_s`, to avoid a jump of a displaced neck.

    A lost reply costs one call: the next one checks whether torque is still enabled, and continues if it is. Otherwise
    set-up is repeated, one exchange a call (a few ms each), also after loss of the port. Without replies, one call in
    0.1 s waits for the timeout and the others fail at once. A motor that has shut down is not restarted: after a reboot
    or a power cycle it is set up again.

    Args:
        neck: Limits and rates.
        clock_s: Returns the present time, seconds; not decreasing.
        options: Port and motors.

    Raises:
        SettingsError: If the number of ids, zero ticks or directions is not N, or two ids are equal.
    """

    def __init__(self, neck: NeckSpec, clock_s: Callable[[], float], options: DynamixelOptions) -> None:
        motor_ids, directions, zero_ticks = options.motor_ids, options.directions, options.zero_ticks
        for name, values in (("motor_ids", motor_ids), ("zero_ticks", zero_ticks), ("directions", directions)):
            if len(values) != neck.joints:
                joints = ", ".join(neck.joint_names)
                raise SettingsError(f"{name} {values}: neck {neck.name!r} needs {neck.joints} numbers, for {joints}")
        if len(set(motor_ids)) < neck.joints:
            raise SettingsError(f"motor_ids {motor_ids}: expected different numbers")
        self._clock_s, self._options, self._ids = clock_s, options, motor_ids
        self._zero = np.array(zero_ticks, dtype=np.float64)
        self._direction = np.array(directions, dtype=np.float64)
        self._bus = DynamixelBus(options, neck.joint_names)
        self._step_ticks = options.approach_speed_rad_s * neck.servo_period_s * _TICKS_PER_RAD
        ends = self._zero + self._direction * np.stack([neck.position_min_rad, neck.position_max_rad]) * _TICKS_PER_RAD
        # Integer ticks, rounded towards the inside of the limits.
        self._tick_min, self._tick_max = np.ceil(ends.min(axis=0)), np.floor(ends.max(axis=0))
        self._connected = self._ready = self._has_reply = False
        self._steps: Iterator[bool] | None = None
        self._retry_at_s, self._trouble = -np.inf, ""
        self._approaching = True
        self._goal = np.zeros(neck.joints)
        self._line = threading.Lock()

    def connect(self) -> None:
        """Open the port, find the motors and enable torque at the present positions; see `Robot.connect`.

        Raises:
            RobotError: If the port cannot be opened, or a motor does not reply, has an error, an unsupported model or
                operating mode, or a range smaller than the neck's; names port, baud rate, id and remedy.
            MissingOptionalDependencyError: If dynamixel-sdk is not installed.
        """
        if self._connected:
            return
        # During set-up motors may reply later.
        self._bus.wait_ms = max(self._options.reply_timeout_ms, 100.0)
        try:
            for _ in self._set_up():
                pass
        except GazempcError:
            self._drop_port()
            raise
        except Exception as error:
            raise self._port_error(error) from error
        finally:
            self._bus.wait_ms = self._options.reply_timeout_ms
        self._connected = self._ready = True
        self._retry_at_s = -np.inf

    def read_state(self) -> JointState | None:
        """Read all joints, in one exchange; see `gazempc.robots.robot.Robot.read_state`.

        Returns:
            Angles and velocities; its time is the middle of the exchange.

        Raises:
            RobotError: If a reply is missing or invalid, a motor has an error, or set-up is in progress.
        """
        return self._perform(self._state)

    def send_command(self, position_rad: FloatArray) -> FloatArray:
        """Send goal positions; see `gazempc.robots.robot.Robot.send_command`.

        A sync write is not acknowledged. So a reply since the last command is required; without a reading in between,
        torque is read first.

        Args:
            position_rad: Angles of all joints, shape (N,), radians.

        Returns:
            The angles sent, shape (N,), radians: clamped to the joints' range, in integer ticks, and after set-up
            limited to the approach speed.

        Raises:
            RobotError: If the command is not finite, or the robot does not reply.
        """
        check_command(position_rad, self._zero.size)
        ticks = np.rint(self._zero + self._direction * position_rad * _TICKS_PER_RAD)
        return self._perform(lambda: self._send(np.clip(ticks, self._tick_min, self._tick_max)))

    def close(self) -> None:
        """Release the port; the motors hold their last goal, or lose torque if `torque_off_on_close`; never raises."""
        if self._bus.is_open and self._connected and self._options.torque_off_on_close:
            with suppress(Exception):
                self._bus.write(_TORQUE_ENABLE, dict.fromkeys(self._ids, b"\0"))
                self._read(_TORQUE)  # a reply confirms its execution
        self._drop_port()
        self._connected = self._ready = False

    def _perform(self, exchange: Callable[[], _T]) -> _T:
        # Mutual exclusion on the bus: a live run reads and sends in two threads.
        with self._line:
            if not self._connected:
                raise RobotError(f"the Dynamixel neck at {self._bus.port_name} is not connected: call connect() first")
            if self._clock_s() < self._retry_at_s:
                raise RobotError(self._trouble)
            try:
                if self._ready or self._recover():
                    return exchange()
            except Exception as error:
                fault = error if isinstance(error, RobotError) else self._port_error(error)
                if self._steps is not None:
                    self._drop_port()
                # The first retry is immediate: single losses are the most frequent failure.
                self._retry_at_s = -np.inf if self._ready else self._clock_s() + _RETRY_S
                self._ready = self._has_reply = False
                self._trouble = str(fault)
                raise fault from error.__cause__ if fault is error else error
            raise RobotError(f"{self._trouble} (it is being set up again)")

    def _recover(self) -> bool:
        """Execute one step of the recovery; True after the last one."""
        if self._steps is None and self._bus.is_open:
            if self._torque_is_on().all():
                self._ready = True
                return True
            self._trouble = f"{self._bus.line}: {_LOST_TORQUE}"
        self._steps = self._steps or self._set_up()
        self._ready = next(self._steps, True)
        if self._ready:
            self._steps = None
        return self._ready

    def _set_up(self) -> Iterator[bool]:
        """Find the motors and enable torque at the present positions; at most one exchange before each yield."""
        if not self._bus.is_open:
            self._bus.open()
        for i in range(len(self._ids)):
            self._bus.ping(i)
            yield False
        modes = [answer[0] for answer in self._read(_MODE)]
        for i, mode in enumerate(modes):
            if mode not in (_POSITION_MODE, _EXTENDED_POSITION_MODE):
                needed = f"{_POSITION_MODE} (position) or {_EXTENDED_POSITION_MODE} (extended position)"
                raise RobotError(f"{self._bus.motor(i)}: Operating Mode (11) is {mode}, but must be {needed}")
        yield False
        for i, answer in enumerate(self._read(_RANGE)):
            high, low = struct.unpack("<ii", answer)
            if modes[i] == _POSITION_MODE and not low <= self._tick_min[i] <= self._tick_max[i] <= high:
                needed = f"the neck needs {self._tick_min[i]:.0f}..{self._tick_max[i]:.0f} ticks"
                raise RobotError(f"{self._bus.motor(i)}: {needed}, but the Position Limits (52, 48) are {low}..{high}")
        yield False
        holds = self._torque_is_on()
        yield False
        present = [struct.unpack("<ii", answer)[1] for answer in self._read(_PRESENT)]
        # With torque off the position is multi-turn; with torque on in position mode it is within one turn.
        goals = [p % _TICKS_PER_TURN if m == _POSITION_MODE else p for p, m in zip(present, modes, strict=True)]
        yield False
        unlimited = bytes(_PROFILE[1])
        if holds.any():
            self._bus.write(_PROFILE, {m: unlimited for m, on in zip(self._ids, holds, strict=True) if on})
        limp = {m: goals[i] for i, m in enumerate(self._ids) if not holds[i]}
        if limp:
            self._bus.write(_PROFILE_AND_GOAL, {m: unlimited + struct.pack("<i", goal) for m, goal in limp.items()})
        for i, answer in enumerate(self._read(_PROFILE_AND_GOAL)):
            # A motor with torque keeps its goal.
            self._goal[i] = goal = struct.unpack("<i", answer[8:])[0]
            if answer[:8] != unlimited or goal != limp.get(self._ids[i], goal):
                hint = "is it inside its Position Limits (52, 48)?"
                raise RobotError(f"{self._bus.motor(i)}: did not accept profile 0 and its goal: {hint}")
        yield False
        self._bus.write(_TORQUE_ENABLE, dict.fromkeys(self._ids, b"\1"))
        for i, on in enumerate(self._torque_is_on()):
            if not on:
                raise RobotError(f"{self._bus.motor(i)}: did not enable torque: check its supply and its errors")
        self._approaching = True

    def _torque_is_on(self) -> NDArray[np.bool_]:
        return np.array([answer[0] == 1 for answer in self._read(_TORQUE)])

    def _state(self) -> JointState:
        before_s = self._clock_s()
        answers = np.array([struct.unpack("<ii", answer) for answer in self._read(_PRESENT)], dtype=np.float64)
        time_s = 0.5 * (before_s + self._clock_s())
        position_rad = self._direction * (answers[:, 1] - self._zero) / _TICKS_PER_RAD
        # Present Velocity is in units of 0.229 rev/min.
        return JointState(time_s, position_rad, self._direction * answers[:, 0] * (0.229 * 2.0 * np.pi / 60.0))

    def _send(self, ticks: FloatArray) -> FloatArray:
        if not self._has_reply and not self._torque_is_on().all():
            raise RobotError(f"{self._bus.line}: {_LOST_TORQUE}")
        goal = ticks
        if self._approaching:
            near = np.clip(ticks, self._goal - self._step_ticks, self._goal + self._step_ticks)
            goal = np.clip(near, self._tick_min, self._tick_max)
            self._approaching = bool(np.any(goal != ticks))
        sent = np.rint(goal)
        self._bus.write(_GOAL, {m: struct.pack("<i", int(g)) for m, g in zip(self._ids, sent, strict=True)})
        # Not rounded: steps of a slow approach are smaller than a tick.
        self._goal = goal
        self._has_reply = False
        return self._direction * (sent - self._zero) / _TICKS_PER_RAD

    def _read(self, part: tuple[int, int]) -> list[bytes]:
        answers = self._bus.read(part)
        self._has_reply = True
        return answers

    def _drop_port(self) -> None:
        self._bus.drop()
        self._steps = None

    def _port_error(self, error: Exception) -> RobotError:
        self._drop_port()
        return RobotError(f"{self._bus.line}: the port failed ({error}): check that the adapter is plugged in")
