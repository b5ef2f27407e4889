"""A neck simulated by its specification, with encoder noise and load."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from gazempc.errors import RobotError
from gazempc.neck.servo import DelayedServo
from gazempc.neck.spec import NeckSpec
from gazempc.neck.speed_steps import SpeedDither
from gazempc.types import FloatArray, JointState


class SimulatedNeck:
    """Simulates a servo with exact dead time for each joint, at the clock's time of each method call.

    Args:
        neck: The simulated neck.
        position_rad: Initial angles, at rest, shape (N,), radians.
        clock_s: Returns the present time, seconds; not decreasing.
        seed: Seed of encoder noise.
    """

    keeps_any_clock = True

    def __init__(self, neck: NeckSpec, position_rad: FloatArray, clock_s: Callable[[], float], seed: int = 0) -> None:
        self._neck = neck
        self._start_rad = np.asarray(position_rad, dtype=np.float64)
        self._clock_s = clock_s
        self._servos: list[DelayedServo] | None = None
        self._true: JointState | None = None
        self._advanced_s = -math.inf
        self._load_rad: list[float] = np.deg2rad([axis.load_offset_deg for axis in neck.axes]).tolist()
        self._limits_rad = list(zip(neck.position_min_rad.tolist(), neck.position_max_rad.tolist(), strict=True))
        # Limits of the input: angles, or speeds.
        self._sendable = [
            (-axis.velocity_max_rad_s, axis.velocity_max_rad_s) if axis.takes_speed else limits
            for axis, limits in zip(neck.axes, self._limits_rad, strict=True)
        ]
        self._dithers = [
            SpeedDither(axis.speed_steps, axis.velocity_max_rad_s) if axis.speed_steps else None for axis in neck.axes
        ]
        self._noise_rad = np.deg2rad([axis.encoder_noise_deg for axis in neck.axes])
        self._noisy = bool(self._noise_rad.any())
        self._rng = np.random.default_rng(seed)

    def connect(self) -> None:
        """Start the simulation at the clock's time; see `gazempc.robots.robot.Robot.connect`."""
        if self._servos is None:
            now_s = self._advanced_s = self._clock_s()
            self._servos = [
                DelayedServo(axis, float(start), now_s, stops)
                for axis, start, stops in zip(self._neck.axes, self._start_rad, self._limits_rad, strict=True)
            ]

    def read_state(self) -> JointState | None:
        """See `gazempc.robots.robot.Robot.read_state`; the velocity is without noise."""
        true = self.true_state()
        if not self._neck.reports_joints:
            return None
        if not self._noisy:
            return true
        noise_rad = self._rng.normal(0.0, self._noise_rad)
        return JointState(true.time_s, true.position_rad + noise_rad, true.velocity_rad_s)

    def true_state(self) -> JointState:
        """True joint state; raises as `read_state`."""
        # Cached: read several times a tick; commands within the tick do not change it.
        true = self._true
        if true is not None and true.time_s == self._clock_s():
            return true
        servos, now_s = self._advance()
        states = [servo.state for servo in servos]
        position_rad = [state[0] + load_rad for state, load_rad in zip(states, self._load_rad, strict=True)]
        motion = np.array([position_rad, [state[1] for state in states]])
        self._true = true = JointState(now_s, motion[0], motion[1])
        return true

    def send_command(self, command: FloatArray) -> FloatArray:
        """See `gazempc.robots.robot.Robot.send_command`; rad/s for a velocity-controlled axis."""
        wanted = command.tolist()
        if not all(map(math.isfinite, wanted)):
            raise RobotError(f"refused a command that is not finite: {command}")
        servos, _ = self._advance()
        sent = [min(max(to, low), high) for to, (low, high) in zip(wanted, self._sendable, strict=True)]
        hold_s = self._neck.servo_period_s
        for joint, dither in enumerate(self._dithers):
            if dither is not None:
                wanted_rad_s, sent[joint] = sent[joint], dither.choose(sent[joint], hold_s)
                dither.hold(wanted_rad_s, hold_s)
        for servo, to in zip(servos, sent, strict=True):
            servo.send(to)
        return np.array(sent)

    def close(self) -> None:
        """Stop the simulation; see `gazempc.robots.robot.Robot.close`."""
        self._servos = self._true = None

    def _advance(self) -> tuple[list[DelayedServo], float]:
        if self._servos is None:
            raise RobotError("the simulated neck is not connected: call connect() first")
        now_s = self._clock_s()
        if now_s != self._advanced_s:
            for servo in self._servos:
                servo.advance_to(now_s)
            self._advanced_s = now_s
        return self._servos, now_s
