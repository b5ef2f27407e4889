"""A simulated neck as a rival drives it: by angles or by speeds, and no faster than its motors turn."""

from __future__ import annotations

from bisect import bisect
from collections import deque
from collections.abc import Callable
from typing import Literal

import numpy as np

from gazempc.neck.spec import NeckSpec
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import FloatArray, JointState

# Bounds of velocity and position error of a device at rest.
_STILL_RAD_S, _THERE_RAD = np.deg2rad(0.5), np.deg2rad(0.25)


def driven_by(neck: NeckSpec, command: Literal["position", "velocity"]) -> NeckSpec:
    """The same neck with joints that take angles, or speeds.

    Args:
        neck: The neck.
        command: What its joints are to take.

    Returns:
        The neck; dead time, servo and limits are the same.
    """
    given = {"command": command} if command == "velocity" else {"command": command, "speed_steps": None}
    axes = {name: axis.model_copy(update=given) for name, axis in (("pan", neck.pan), ("tilt", neck.tilt))}
    return neck.model_copy(update=axes)


class Motor:
    """Holds the command of a rival, and sends it at every tick.

    Angles are cut to the joint's range, and a jump becomes a move at top speed, as a motor makes it. Speeds are cut to
    the top speed.

    Args:
        neck: The neck, with joints that take what the rival gives.
        start_rad: Where it stands at rest, shape (2,), radians.
        clock_s: The present time, seconds.
        seed: Of the encoders' noise.
    """

    def __init__(self, neck: NeckSpec, start_rad: FloatArray, clock_s: Callable[[], float], seed: int) -> None:
        self._neck, self._clock_s, self._takes_speeds = neck, clock_s, neck.takes_speeds
        self._robot = SimulatedNeck(neck, start_rad, clock_s, seed)
        self._robot.connect()
        self._sent = np.zeros(2) if self._takes_speeds else np.array(start_rad)
        self._wanted = self._sent.copy()
        self._sent_s: float | None = None
        self._changed_s = -np.inf

    def true_state(self) -> JointState:
        """True state of the joints."""
        return self._robot.true_state()

    def reading(self) -> JointState:
        """Measured state of the joints."""
        return self._robot.read_state() or self._robot.true_state()

    def ask(self, command: FloatArray) -> None:
        """Take a rival's answer: angles or speeds, shape (2,); held until the next one."""
        neck = self._neck
        if self._takes_speeds:
            low, high = -neck.velocity_max_rad_s, neck.velocity_max_rad_s
        else:
            low, high = neck.position_min_rad, neck.position_max_rad
        self._wanted = np.minimum(np.maximum(command, low), high)

    def tick(self) -> None:
        """Send the present command."""
        now_s = self._clock_s()
        sent = self._wanted
        if not self._takes_speeds:
            passed_s = 0.0 if self._sent_s is None else now_s - self._sent_s
            most = self._neck.velocity_max_rad_s * passed_s
            sent = self._sent + np.minimum(np.maximum(self._wanted - self._sent, -most), most)
        if np.any(np.abs(sent - self._sent) > 1e-9):
            self._changed_s = now_s
        self._sent, self._sent_s = sent, now_s
        self._robot.send_command(sent)

    @property
    def sent(self) -> FloatArray:
        """Last command, shape (2,)."""
        return self._sent

    @property
    def idle(self) -> bool:
        """Whether the device is at rest without a pending move."""
        state = self._robot.true_state()
        if np.any(np.abs(state.velocity_rad_s) > _STILL_RAD_S) or np.any(np.abs(self._wanted - self._sent) > 1e-9):
            return False
        if self._takes_speeds and np.any(self._sent != 0.0):
            return False
        if self._clock_s() - self._changed_s <= float(np.max(self._neck.dead_time_s)):
            return False
        return self._takes_speeds or bool(np.all(np.abs(self._sent - state.position_rad) <= _THERE_RAD))


KEPT_S = 3.0
# Tolerance of times before the first and after the last reading.
_NEAR_S = 0.05


class EncoderHistory:
    """Readings of the last 3 s."""

    def __init__(self) -> None:
        self._readings: deque[JointState] = deque()

    def note(self, reading: JointState) -> None:
        """Add a reading, later than all before."""
        self._readings.append(reading)
        while self._readings[0].time_s < reading.time_s - KEPT_S:
            self._readings.popleft()

    def at(self, time_s: float) -> FloatArray | None:
        """Pan and tilt at a time: linear between readings, else the nearest end.

        Args:
            time_s: The time, seconds.

        Returns:
            Shape (2,), radians; None if it is more than 0.05 s away from all readings.
        """
        readings = self._readings
        if not readings:
            return None
        first, last = readings[0], readings[-1]
        if time_s <= first.time_s:
            return first.position_rad if first.time_s - time_s <= _NEAR_S else None
        if time_s >= last.time_s:
            return last.position_rad if time_s - last.time_s <= _NEAR_S else None
        k = bisect(readings, time_s, key=lambda reading: reading.time_s)
        before, after = readings[k - 1], readings[k]
        share = (time_s - before.time_s) / (after.time_s - before.time_s)
        between: FloatArray = before.position_rad + share * (after.position_rad - before.position_rad)
        return between
