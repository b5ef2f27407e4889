"""Where the joints are now: model and measurement together, so that noise, silence and constant loads do no harm."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from gazempc.neck.servo import DelayedServo, zero_order_hold
from gazempc.neck.spec import Axis, NeckSpec
from gazempc.types import FloatArray, JointState

# An error of the model's joint is corrected with this time constant; noise of encoders is averaged over it.
_STATE_TIME_S = 0.05
# Noise that lets the offset change, in response times (dead time and lag). As the servo pulls the joint back to the
# command meanwhile, a load is learned in about three response times (1.6 s for the neck `reference`). Faster would
# mistake a dead time that is modelled wrongly for a load, and the two delays would chase each other.
_LOAD_RESPONSES = 0.7
# A measurement older than this is not used.
_MEMORY_S = 0.25
# A robot reads its joints a moment after the tick began; clocks that agree still differ by this much.
_CLOCK_TOLERANCE_S = 0.01
# A joint this far from where it should be has been misread; after so many readings in a row it has been moved.
_GATE_RAD = math.radians(15.0)
_READINGS_TO_BELIEVE = 20
# More than this is no load: a joint that is blocked, or an encoder that is stuck.
_OFFSET_MAX_RAD = math.radians(10.0)
# No joint turns so far; a reading beyond it is a wrong unit or a broken message.
_ANY_TURN_RAD = 100.0


@dataclass(frozen=True)
class JointEstimate:
    """Estimate of the joints at one instant; arrays of shape (2,), pan and tilt.

    Attributes:
        position_rad: Joint angles, radians.
        velocity_rad_s: Joint velocities, rad/s.
        offset_rad: How far from a command that stands still the joint settles, radians: a constant load (gravity,
            friction) or an encoder that is off.
    """

    position_rad: FloatArray
    velocity_rad_s: FloatArray
    offset_rad: FloatArray


class JointObserver:
    """Steady-state Kalman filter for each joint, with the offset from the command as a state of its own.

    Between measurements the joints follow the commands that were sent, through servo and dead time, exactly; without
    any measurement that is all (open loop). The offset makes the control free of steady errors: Maeder, Borrelli &
    Morari (2009), Linear offset-free model predictive control.

    Args:
        neck: The neck as it is known.
        command_rad: Where the command stands, the joints at rest there, shape (2,), radians.
        time_s: Present time, seconds.
    """

    def __init__(self, neck: NeckSpec, command_rad: FloatArray, time_s: float) -> None:
        self._servos = [
            DelayedServo(axis, float(start), time_s) for axis, start in zip(neck.axes, command_rad, strict=True)
        ]
        self._gains = np.stack([observer_gain(axis, neck.servo_period_s) for axis in neck.axes])
        self._offset_rad = np.zeros(2)
        self._past: deque[tuple[float, FloatArray, FloatArray]] = deque()
        self._measured_s: float | None = None
        self._refused_in_a_row = 0
        self._refused = False

    @property
    def refused(self) -> bool:
        """True if the last update was given a measurement that could not be believed: NaN, too old, or far off."""
        return self._refused

    def sent(self, command_rad: FloatArray) -> None:
        """Take note of a command that was sent at the time of the last update, shape (2,), radians."""
        for servo, command in zip(self._servos, command_rad, strict=True):
            servo.send(float(command))

    def update(self, time_s: float, measured: JointState | None) -> JointEstimate:
        """Move on in time and take in a measurement.

        Args:
            time_s: Present time, seconds; one before that of the last update is taken for that.
            measured: Newest measured state, perhaps of a moment ago; None if there is none. One that was taken in
                before is not used; one that cannot be believed is `refused`.

        Returns:
            The estimate for `time_s`.
        """
        time_s = max(time_s, self._past[-1][0]) if self._past else time_s
        for servo in self._servos:
            servo.advance_to(time_s)
        states = np.array([servo.state for servo in self._servos])
        self._past.append((time_s, states[:, 0] + self._offset_rad, states[:, 1]))
        while self._past[0][0] < time_s - _MEMORY_S:
            self._past.popleft()
        self._refused = False
        # Written so that a NaN is refused. A driver that gives the same reading for ever has none.
        if measured is not None and not measured.time_s >= time_s - _MEMORY_S:
            self._refused = True
        elif measured is not None and (self._measured_s is None or measured.time_s > self._measured_s):
            self._take_in(measured, time_s)
            states = np.array([servo.state for servo in self._servos])
        return JointEstimate(states[:, 0] + self._offset_rad, states[:, 1], self._offset_rad.copy())

    def _take_in(self, measured: JointState, time_s: float) -> None:
        measured_s = min(measured.time_s, time_s)
        # Written so that a NaN is outside.
        in_memory = self._past[0][0] <= measured_s and measured.time_s <= time_s + _CLOCK_TOLERANCE_S
        if not (in_memory and np.all(np.abs(measured.position_rad) < _ANY_TURN_RAD)):
            self._refused = True
            return
        at = max(k for k, past in enumerate(self._past) if past[0] <= measured_s)
        at_s, position_rad, velocity_rad_s = self._past[at]
        # What was expected at the time of measurement; the error is then taken to be the same now.
        error_rad = measured.position_rad - (position_rad + (measured_s - at_s) * velocity_rad_s)
        first = self._measured_s is None
        far = not first and bool(np.any(np.abs(error_rad) > _GATE_RAD))
        self._refused_in_a_row = self._refused_in_a_row + 1 if far else 0
        if far and self._refused_in_a_row < _READINGS_TO_BELIEVE:
            self._refused = True
            return
        self._measured_s = measured.time_s
        self._refused_in_a_row = 0
        before = np.array([servo.state for servo in self._servos]), self._offset_rad.copy()
        for i, servo in enumerate(self._servos):
            if first or far:
                # It stands where it was never sent: a start elsewhere, or a push; no load.
                servo.correct(float(error_rad[i]), 0.0)
                if first:
                    servo.stand(servo.state[0])
                continue
            position, velocity, offset = self._gains[i] * error_rad[i]
            learned = float(np.clip(self._offset_rad[i] + offset, -_OFFSET_MAX_RAD, _OFFSET_MAX_RAD))
            offset, self._offset_rad[i] = learned - self._offset_rad[i], learned
            # The servo's own position is counted without the offset.
            servo.correct(float(position - offset), float(velocity))
        # What is now known was so then: an error that has been corrected must not be corrected again by the next
        # measurement that is as old.
        after = np.array([servo.state for servo in self._servos])
        moved_rad = after[:, 0] - before[0][:, 0] + self._offset_rad - before[1]
        faster_rad_s = after[:, 1] - before[0][:, 1]
        for k in range(at, len(self._past)):
            past_s, past_rad, past_rad_s = self._past[k]
            self._past[k] = (past_s, past_rad + moved_rad, past_rad_s + faster_rad_s)


def observer_gain(axis: Axis, period_s: float) -> FloatArray:
    """Steady-state Kalman gain for [joint angle, velocity, offset] from a measured angle at every period.

    Only ratios of noises matter; they are chosen by the times within which state and offset are to be corrected.

    Args:
        axis: The joint.
        period_s: Time between measurements, seconds.

    Returns:
        Gain, shape (3,): dimensionless, 1/s, dimensionless.
    """
    import control  # noqa: PLC0415  (slow to import; only needed when something moves)

    step = zero_order_hold(axis, period_s)
    A = np.vstack([np.hstack([step[:, :2], step[:, 2:]]), [0.0, 0.0, 1.0]])
    load_time_s = _LOAD_RESPONSES * (axis.dead_time_s + axis.servo_lag_s)
    noise = [period_s / _STATE_TIME_S, period_s / _STATE_TIME_S**2, period_s / load_time_s]
    gain, *_ = control.dlqe(A, np.eye(3), np.array([[1.0, 0.0, 0.0]]), np.diag(np.square(noise)), np.eye(1))
    return np.asarray(gain, dtype=np.float64).ravel()
