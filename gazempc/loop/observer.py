"""Where the joints are now: model and measurement together, so that noise, silence and constant loads do no harm."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import solve_discrete_are

from gazempc.neck.servo import DelayedServo, zero_order_hold
from gazempc.neck.spec import Axis, NeckSpec
from gazempc.types import FloatArray, JointState

# An error of the model's joint is corrected with this time constant; noise of encoders is averaged over it.
_STATE_TIME_S = 0.05
# Noise that lets the offset change, in response times (dead time and lag). As the servo pulls the joint back to the
# command meanwhile, a load is estimated in about three response times (1.6 s for the neck `reference`). A faster
# estimate attributes an error of the dead time to the load, and may oscillate with it.
_LOAD_RESPONSES = 0.7
# A measurement older than this is not used.
_MEMORY_S = 0.25
# A robot reads its joints a moment after the tick began; synchronised clocks differ by up to this.
_CLOCK_TOLERANCE_S = 0.01
# Gate of the innovation: a farther reading is an outlier; after so many in a row the joint has been moved by hand.
_GATE_RAD = math.radians(15.0)
_READINGS_TO_BELIEVE = 20
# Largest plausible steady error; beyond it a joint is blocked, or an encoder is stuck.
_OFFSET_MAX_RAD = math.radians(10.0)
# Plausibility bounds: a larger reading is a wrong unit or a broken message.
_ANY_TURN_RAD = _ANY_SPEED_RAD_S = 100.0

_Each = tuple[float, ...]  # one number a joint
_Past = tuple[float, _Each, _Each]  # time, angles, velocities


@dataclass(frozen=True)
class JointEstimate:
    """Estimate of the joints at one instant; arrays of shape (N,), one number a joint.

    Attributes:
        position_rad: Joint angles, radians.
        velocity_rad_s: Joint velocities, rad/s.
        offset_rad: How far from a command that stands still the joint settles, radians: a constant load (gravity,
            friction) or an encoder that is off. Of a joint that takes speeds: how far it is from their integral.
    """

    position_rad: FloatArray
    velocity_rad_s: FloatArray
    offset_rad: FloatArray


class JointObserver:
    """Steady-state Kalman filter for each joint, with the offset from the command as a state of its own.

    Between measurements the joints follow the commands that were sent, through servo and dead time, exactly; without
    measurements the estimate is an open-loop prediction. The offset makes the control free of steady errors: Maeder,
    Borrelli & Morari (2009), Linear offset-free model predictive control.

    Args:
        neck: The neck as modelled.
        command_rad: Where the command stands, the joints at rest there, shape (N,), radians.
        time_s: Present time, seconds.

    Attributes:
        refused: Whether the last update refused its measurement: NaN, too old, too fast, or outside the gate.
    """

    def __init__(self, neck: NeckSpec, command_rad: FloatArray, time_s: float) -> None:
        self._servos = [
            DelayedServo(axis, float(start), time_s) for axis, start in zip(neck.axes, command_rad, strict=True)
        ]
        self._gains = [observer_gain(axis, neck.servo_period_s) for axis in neck.axes]
        self._takes_speed = [axis.takes_speed for axis in neck.axes]
        # Plain numbers: on a few of them numpy takes several times as long, and this is done at every tick.
        self._offset_rad = [0.0] * neck.joints
        self._past: deque[_Past] = deque()
        self._estimate: tuple[_Each, _Each, _Each]
        self._note_estimate()
        self._measured_s: float | None = None
        self._refused_in_a_row = 0
        self.refused = False

    @property
    def off_command(self) -> tuple[int, ...]:
        """Joints whose offset has reached the largest plausible one, ascending."""
        pairs = zip(self._offset_rad, self._takes_speed, strict=True)
        return tuple(
            [k for k, (off, takes_speed) in enumerate(pairs) if not (takes_speed or abs(off) < _OFFSET_MAX_RAD)]
        )

    @property
    def estimate(self) -> JointEstimate:
        """The estimate at the time of the last update; its arrays are made on request."""
        return JointEstimate(*np.array(self._estimate))

    def sent(self, command: FloatArray) -> None:
        """Take in the command sent at the time of the last update: angles or speeds, shape (N,), rad or rad/s."""
        for servo, to in zip(self._servos, command.tolist(), strict=True):
            servo.send(to)

    def update(self, time_s: float, measured: JointState | None, held: tuple[int, ...] = ()) -> None:
        """Move on in time and take in a measurement.

        Args:
            time_s: Present time, seconds; one before that of the last update is taken for that.
            measured: Newest measured state, perhaps of a moment ago; None if there is none. One that was taken in
                before is not used; an implausible one is `refused`.
            held: Joints that do not follow their commands: the measurement is taken as it is.
        """
        past = self._past
        if past and past[-1][0] > time_s:
            time_s = past[-1][0]
        for servo in self._servos:
            servo.advance_to(time_s)
        past.append((time_s, *self._joints()))
        oldest_s = time_s - _MEMORY_S
        while past[0][0] < oldest_s:
            past.popleft()
        self.refused = False
        # Written so that a NaN is refused. A driver that gives the same reading for ever has none.
        if measured is not None and not measured.time_s >= oldest_s:
            self.refused = True
        elif measured is not None and (self._measured_s is None or measured.time_s > self._measured_s):
            self._take_in(measured, time_s, held)
        self._note_estimate()

    def _note_estimate(self) -> None:
        # In one piece, as another thread may read it.
        self._estimate = (*self._joints(), tuple(self._offset_rad))

    def _joints(self) -> tuple[_Each, _Each]:
        # Angles with their offsets, and velocities, as estimated now.
        states = [servo.state for servo in self._servos]
        angles = [state[0] + offset_rad for state, offset_rad in zip(states, self._offset_rad, strict=True)]
        return tuple(angles), tuple([state[1] for state in states])

    def _take_in(self, measured: JointState, time_s: float, held: tuple[int, ...]) -> None:
        measured_s = min(measured.time_s, time_s)
        angles = measured.position_rad.tolist()
        # Written so that a NaN is outside.
        in_memory = self._past[0][0] <= measured_s and measured.time_s <= time_s + _CLOCK_TOLERANCE_S
        # A velocity that the robot does not measure is NaN.
        too_fast = any(abs(speed) > _ANY_SPEED_RAD_S for speed in measured.velocity_rad_s.tolist())
        if too_fast or not (in_memory and all(abs(angle_rad) < _ANY_TURN_RAD for angle_rad in angles)):
            self.refused = True
            return
        at = len(self._past) - 1
        while self._past[at][0] > measured_s:
            at -= 1
        at_s, then_rad, speeds = self._past[at]
        since_s = measured_s - at_s
        # What was expected at the time of measurement; the error is then taken to be the same now.
        errors_rad = [now - (then + since_s * speed) for now, then, speed in zip(angles, then_rad, speeds, strict=True)]
        first = self._measured_s is None
        far = not first and any(abs(e) > _GATE_RAD for axis, e in enumerate(errors_rad) if axis not in held)
        self._refused_in_a_row = self._refused_in_a_row + 1 if far else 0
        if far and self._refused_in_a_row < _READINGS_TO_BELIEVE:
            self.refused = True
            return
        self._measured_s = measured.time_s
        self._refused_in_a_row = 0
        corrections = [
            self._believe(axis, error_rad, first, far or axis in held) for axis, error_rad in enumerate(errors_rad)
        ]
        # The stored past is corrected, too: a later measurement of the same age must not correct the error twice.
        for k in range(at, len(self._past)):
            past_s, past_rad, past_rad_s = self._past[k]
            self._past[k] = (
                past_s,
                tuple([was + moved for was, (moved, _) in zip(past_rad, corrections, strict=True)]),
                tuple([was + faster for was, (_, faster) in zip(past_rad_s, corrections, strict=True)]),
            )

    def _believe(self, axis: int, error_rad: float, first: bool, far: bool) -> tuple[float, float]:
        # Correct one joint; returns by how much its angle and its velocity change.
        servo, offset_rad = self._servos[axis], self._offset_rad[axis]
        before_rad, before_rad_s = servo.state
        if (first or far) and self._takes_speed[axis]:
            # A joint that takes speeds is an integrator: the error becomes its offset.
            self._offset_rad[axis] += error_rad
        elif first or far:
            # Another initial position, or an external displacement: the state is corrected, not the load.
            servo.correct(error_rad, 0.0)
            if first:
                servo.stand(servo.state[0])
        else:
            position_gain, velocity_gain, offset_gain = self._gains[axis]
            learned_rad = offset_rad + offset_gain * error_rad
            if not (self._takes_speed[axis] or -_OFFSET_MAX_RAD <= learned_rad <= _OFFSET_MAX_RAD):
                learned_rad = min(max(learned_rad, -_OFFSET_MAX_RAD), _OFFSET_MAX_RAD)
            self._offset_rad[axis] = learned_rad
            # The servo's own position is counted without the offset.
            servo.correct(position_gain * error_rad - (learned_rad - offset_rad), velocity_gain * error_rad)
        after_rad, after_rad_s = servo.state
        return after_rad - before_rad + self._offset_rad[axis] - offset_rad, after_rad_s - before_rad_s


# Safe: a frozen joint and a number in, numbers out. The equation takes milliseconds to solve.
@lru_cache(maxsize=64)
def observer_gain(axis: Axis, period_s: float) -> tuple[float, float, float]:
    """Steady-state Kalman gain for [joint angle, velocity, offset] from a measured angle at every period.

    Only ratios of noises matter; they are chosen by the times within which state and offset are to be corrected.

    Args:
        axis: The joint.
        period_s: Time between measurements, seconds.

    Returns:
        Gain: dimensionless, 1/s, dimensionless.
    """
    step = zero_order_hold(axis, period_s)
    A = np.vstack([np.hstack([step[:, :2], step[:, 2:]]), [0.0, 0.0, 1.0]])
    load_time_s = _LOAD_RESPONSES * (axis.dead_time_s + axis.servo_lag_s)
    noise = [period_s / _STATE_TIME_S, period_s / _STATE_TIME_S**2, period_s / load_time_s]
    # The gain of `control.dlqe`, without its import: that takes a second, in every process in which something moves.
    P = solve_discrete_are(A.T, np.eye(3, 1), np.diag(np.square(noise)), np.eye(1))
    position, velocity, offset = (A @ P[:, 0] / (P[0, 0] + 1.0)).tolist()
    return position, velocity, offset
