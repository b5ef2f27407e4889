"""The interface of all controllers, with its input and output types."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from gazempc.neck.ahead import JointsAfterDeadTime
from gazempc.types import FloatArray
from predictors import Forecast


class ControllerError(RuntimeError):
    """No plan at this control tick: the loop continues with the previous one. Also a fault of a plan.

    Args:
        text: Description of the fault.
        event: Name of the event in the log, such as ``solver_failed``.
    """

    def __init__(self, text: str = "", event: str = "controller_failed") -> None:
        super().__init__(text)
        self.event = event


_FEWEST_JOINTS = 2  # pan and tilt
# One joint's command at one instant: position, velocity and acceleration, in radians and seconds.
AxisMotion = tuple[float, float, float]


@dataclass(frozen=True)
class CommandState:
    """Motion of the command at one instant; arrays of shape (N,), N joints.

    Attributes:
        position_rad: Commanded angles, radians.
        velocity_rad_s: Their velocity, rad/s.
        acceleration_rad_s2: Their acceleration, rad/s^2.
    """

    position_rad: FloatArray
    velocity_rad_s: FloatArray
    acceleration_rad_s2: FloatArray


@dataclass(frozen=True)
class Situation:
    """The input of a controller for one plan.

    Attributes:
        after_dead_time: Predicts the joint state at the end of the dead times.
        start_s: Time at which the first command of the plan will be sent, seconds.
        forecast: Forecast for the times that the controller asked for.
        command: The last command before the plan starts, sent one servo period before `start_s`.
        joint_position_rad: Joint angles now, estimated by the observer, shape (N,), radians.
        joint_velocity_rad_s: Joint velocities now, shape (N,), rad/s.
        joint_offset_rad: Steady-state error of the joints, shape (N,), radians.
        sent_rad: Commands sent before now, one a servo period, oldest first, shape (M, N), radians.
        committed_rad: Commands that will be sent from now until the plan starts, shape (n, N), radians.
        held: Indices in `NeckSpec.joint_names` of joints that do not follow their commands; their angles are
            measurements. Empty for necks of two joints.
    """

    after_dead_time: JointsAfterDeadTime
    start_s: float
    forecast: Forecast
    command: CommandState
    joint_position_rad: FloatArray
    joint_velocity_rad_s: FloatArray
    joint_offset_rad: FloatArray
    sent_rad: FloatArray
    committed_rad: FloatArray
    held: tuple[int, ...] = ()

    @cached_property
    def _joints_then(self) -> FloatArray:
        # The model has no offset.
        initial = self.joint_position_rad - self.joint_offset_rad, self.joint_velocity_rad_s
        return self.after_dead_time(*initial, self.sent_rad, self.committed_rad)

    @property
    def position_after_dead_time_rad(self) -> FloatArray:
        """Joint angles one dead time after `start_s`, shape (N,), radians.

        The motion until then is independent of the plan.
        """
        return np.asarray(self._joints_then[0] + self.joint_offset_rad)

    @property
    def velocity_after_dead_time_rad_s(self) -> FloatArray:
        """Joint velocities then, shape (N,), rad/s."""
        return np.asarray(self._joints_then[1])


class JointPlan(NamedTuple):
    """The plan of one joint at the knots: arrays of shape (K,), radians, rad/s and rad/s^2."""

    position_rad: FloatArray
    velocity_rad_s: FloatArray
    acceleration_rad_s2: FloatArray


@dataclass(frozen=True)
class Plan:
    """A plan: command trajectory with knots at equal steps and constant jerk between them.

    Attributes:
        start_s: Time of the first knot, seconds.
        step_s: Time between knots, seconds.
        position_rad: Commanded angles at the knots, shape (K, N), radians.
        velocity_rad_s: Shape (K, N), rad/s.
        acceleration_rad_s2: Shape (K, N), rad/s^2.
        events: Unusual events of the computation, for the log.
        faults: Events that come with a text for the log.

    Raises:
        ValueError: If shapes or times are not as stated here.
    """

    start_s: float
    step_s: float
    position_rad: FloatArray
    velocity_rad_s: FloatArray
    acceleration_rad_s2: FloatArray
    events: tuple[str, ...] = ()
    faults: tuple[ControllerError, ...] = ()

    def __post_init__(self) -> None:
        shape = np.shape(self.position_rad)
        if len(shape) != 2 or shape[1] < _FEWEST_JOINTS or not shape[0]:
            raise ValueError(f"a plan needs positions of shape (K, N) with N joints, 2 or more, got {shape}")
        if {np.shape(self.velocity_rad_s), np.shape(self.acceleration_rad_s2)} != {shape}:
            raise ValueError("positions, velocities and accelerations of a plan differ in shape")
        if not (math.isfinite(self.start_s) and self.step_s > 0):
            raise ValueError(f"a plan needs a finite start and a positive step, got {self.start_s} and {self.step_s}")

    @property
    def end_s(self) -> float:
        """End of the plan: one step after the last knot, seconds."""
        return self.start_s + len(self.position_rad) * self.step_s

    @cached_property
    def is_finite(self) -> bool:
        """True if no number is NaN or infinite."""
        # Cached: read at every tick, and a plan is immutable.
        parts = (self.position_rad, self.velocity_rad_s, self.acceleration_rad_s2)
        return all(bool(np.isfinite(part).all()) for part in parts)

    def at(self, time_s: float) -> CommandState:
        """The command at a time.

        Args:
            time_s: Time, seconds; the first knot before the start, extrapolation at constant velocity past the end.

        Returns:
            The command's motion.
        """
        return CommandState(*np.array(self.motions_at(time_s)).T.copy())

    def motions_at(self, time_s: float) -> tuple[AxisMotion, ...]:
        """`at` as tuples of floats, which are faster than arrays at every tick.

        Args:
            time_s: See `at`.

        Returns:
            The motions of the N joints.
        """
        last = len(self.position_rad) - 1
        # Tolerance of a nanosecond: rounding must not select the interval before the knot.
        since_s = max(time_s - self.start_s, 0.0)
        step_s = self.step_s
        k = min(int(since_s / step_s + 1e-6), last)
        tau = since_s - k * step_s if k else since_s  # a single knot has no end
        rows = zip(self.position_rad[k].tolist(), self.velocity_rad_s[k].tolist(), strict=True)
        if k == last:
            return tuple([(p + tau * v, v, 0.0) for p, v in rows])
        now, later = self.acceleration_rad_s2[k].tolist(), self.acceleration_rad_s2[k + 1].tolist()
        each = zip(rows, now, later, strict=True)
        return tuple([_moved_on(tau, p, v, a, (a_next - a) / step_s) for (p, v), a, a_next in each])


def _moved_on(tau: float, p: float, v: float, a: float, jerk: float) -> AxisMotion:
    return (
        p + tau * (v + tau * (a / 2.0 + tau * jerk / 6.0)),
        v + tau * (a + tau * jerk / 2.0),
        a + tau * jerk,
    )


class Controller(Protocol):
    """Computes plans of commands; may hold state from one plan to the next."""

    def reset(self) -> None:
        """Discard all state."""

    def forecast_times_s(self, start_s: float, newest_capture_s: float) -> FloatArray:
        """Times for which the controller needs the forecast.

        Args:
            start_s: Time at which the first command of the plan will be sent, seconds.
            newest_capture_s: Capture time of the newest observation, seconds.

        Returns:
            Times, shape (H,), seconds.
        """

    def plan(self, situation: Situation) -> Plan:
        """Compute a plan.

        Args:
            situation: Joints, commands, and the forecast for `forecast_times_s`.

        Returns:
            The plan.

        Raises:
            ControllerError: If the computation fails.
        """
