"""State observer of the joints: Kalman filter with disturbance model, for noise, missing readings, constant loads."""

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

# Time constant of the state correction, over which encoder noise is averaged.
_STATE_TIME_S = 0.05
# Process noise of the offset, in response times (dead time and lag). As the servo meanwhile returns the joint to the
# command, a load is estimated in about three response times (1.6 s for the neck `reference`). A faster estimate
# attributes an error of the dead time to the load, and may oscillate with it.
_LOAD_RESPONSES = 0.7
# A measurement older than this is not used.
_MEMORY_S = 0.25
# Tolerance of time stamps in the future: readings follow the start of the tick, and clocks are synchronised to this.
_CLOCK_TOLERANCE_S = 0.01
# Gate of the innovation, and the number of consecutive outliers after which the joint has been displaced.
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
        offset_rad: Steady-state error at constant command, radians: from a constant load (gravity, friction) or an
            encoder offset. For a velocity-controlled joint: difference to the integral of the speeds.
    """

    position_rad: FloatArray
    velocity_rad_s: FloatArray
    offset_rad: FloatArray


class JointObserver:
    """Steady-state Kalman filter for each joint, with the offset from the command as disturbance state.

    The prediction is the exact response of servo and dead time to the commands sent; without measurements it is
    open-loop. The disturbance state gives offset-free control: Maeder, Borrelli & Morari (2009), Linear offset-free
    model predictive control.

    Args:
        neck: Model of the neck.
        command_rad: Initial command and joint angles, at rest, shape (N,), radians.
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
        # Python floats: small NumPy arrays take several times as long, at every tick.
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
        far = [abs(off) >= _OFFSET_MAX_RAD for off in self._offset_rad]
        return tuple([k for k, takes_speed in enumerate(self._takes_speed) if far[k] and not takes_speed])

    @property
    def estimate(self) -> JointEstimate:
        """The estimate at the time of the last update."""
        return JointEstimate(*np.array(self._estimate))

    def sent(self, command: FloatArray) -> None:
        """Apply the command sent at the time of the last update: angles or speeds, shape (N,), rad or rad/s."""
        for servo, to in zip(self._servos, command.tolist(), strict=True):
            servo.send(to)

    def update(self, time_s: float, measured: JointState | None, held: tuple[int, ...] = ()) -> None:
        """Predict to the present time, then correct by a measurement.

        Args:
            time_s: Present time, seconds; clamped to the time of the last update.
            measured: Newest measured state, with its own time; None if there is none. A repeated one is ignored, an
                implausible one is `refused`.
            held: Joints that do not follow their commands: the estimate is set to the measurement.
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
        # Negated to refuse NaN. A driver that repeats the same reading counts as silent.
        if measured is not None and not measured.time_s >= oldest_s:
            self.refused = True
        elif measured is not None and (self._measured_s is None or measured.time_s > self._measured_s):
            self._assimilate(measured, time_s, held)
        self._note_estimate()

    def _note_estimate(self) -> None:
        # Atomic assignment: another thread may read it.
        self._estimate = (*self._joints(), tuple(self._offset_rad))

    def _joints(self) -> tuple[_Each, _Each]:
        # Estimated angles, offsets included, and velocities.
        states = [servo.state for servo in self._servos]
        angles = [state[0] + offset_rad for state, offset_rad in zip(states, self._offset_rad, strict=True)]
        return tuple(angles), tuple([state[1] for state in states])

    def _assimilate(self, measured: JointState, time_s: float, held: tuple[int, ...]) -> None:
        measured_s = min(measured.time_s, time_s)
        angles = measured.position_rad.tolist()
        # False for NaN.
        in_memory = self._past[0][0] <= measured_s and measured.time_s <= time_s + _CLOCK_TOLERANCE_S
        # NaN is valid: a velocity that is not measured.
        too_fast = any(abs(speed) > _ANY_SPEED_RAD_S for speed in measured.velocity_rad_s.tolist())
        if too_fast or not (in_memory and all(abs(angle_rad) < _ANY_TURN_RAD for angle_rad in angles)):
            self.refused = True
            return
        at = len(self._past) - 1
        while self._past[at][0] > measured_s:
            at -= 1
        at_s, then_rad, speeds = self._past[at]
        since_s = measured_s - at_s
        # Innovation at the time of the measurement, applied to the present state.
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
            self._correct(axis, error_rad, first, far or axis in held) for axis, error_rad in enumerate(errors_rad)
        ]
        # Correct the history: a later measurement from the same interval must not correct the error twice.
        for k in range(at, len(self._past)):
            past_s, past_rad, past_rad_s = self._past[k]
            self._past[k] = (
                past_s,
                tuple([was + moved for was, (moved, _) in zip(past_rad, corrections, strict=True)]),
                tuple([was + faster for was, (_, faster) in zip(past_rad_s, corrections, strict=True)]),
            )

    def _correct(self, axis: int, error_rad: float, first: bool, far: bool) -> tuple[float, float]:
        # Correct one joint; returns the increments of its angle and velocity.
        servo, offset_rad = self._servos[axis], self._offset_rad[axis]
        before_rad, before_rad_s = servo.state
        if (first or far) and self._takes_speed[axis]:
            # A velocity-controlled joint is an integrator: the error becomes its offset.
            self._offset_rad[axis] += error_rad
        elif first or far:
            # Initial error or external displacement: correct the state, not the load.
            servo.correct(error_rad, 0.0)
            if first:
                servo.stand(servo.state[0])
        else:
            position_gain, velocity_gain, offset_gain = self._gains[axis]
            learned_rad = offset_rad + offset_gain * error_rad
            if not (self._takes_speed[axis] or -_OFFSET_MAX_RAD <= learned_rad <= _OFFSET_MAX_RAD):
                learned_rad = min(max(learned_rad, -_OFFSET_MAX_RAD), _OFFSET_MAX_RAD)
            self._offset_rad[axis] = learned_rad
            # The state of the servo model excludes the offset.
            servo.correct(position_gain * error_rad - (learned_rad - offset_rad), velocity_gain * error_rad)
        after_rad, after_rad_s = servo.state
        return after_rad - before_rad + self._offset_rad[axis] - offset_rad, after_rad_s - before_rad_s


# Cached: the Riccati equation takes milliseconds. Safe: arguments and result are immutable.
@lru_cache(maxsize=64)
def observer_gain(axis: Axis, period_s: float) -> tuple[float, float, float]:
    """Steady-state Kalman gain for [joint angle, velocity, offset], with a measured angle at every period.

    The gain depends on ratios of noises only; these follow from the time constants of state and offset.

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
    # As `control.dlqe`, whose import takes a second.
    P = solve_discrete_are(A.T, np.eye(3, 1), np.diag(np.square(noise)), np.eye(1))
    position, velocity, offset = (A @ P[:, 0] / (P[0, 0] + 1.0)).tolist()
    return position, velocity, offset
