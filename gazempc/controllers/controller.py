"""The one interface that all controllers have, and the values that pass through it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from gazempc.neck.ahead import SettledJoints
from gazempc.types import FloatArray
from predictors import Forecast


class ControllerError(RuntimeError):
    """A controller has no plan this time, and the loop goes on with the last one; or a fault of a plan.

    Args:
        text: What went wrong.
        event: Name of the event in the log; default: that of the class.
    """

    event = "controller_failed"

    def __init__(self, text: str = "", event: str = "") -> None:
        super().__init__(text)
        self.event = event or self.event


class SolverFailed(ControllerError):  # noqa: N818  (named as its event)
    """The problem has no solution, for example because a number in it is not finite."""

    event = "solver_failed"


_FEWEST_JOINTS = 2  # pan and tilt
# One joint's command at one instant: position, velocity and acceleration, in radians and seconds.
AxisMotion = tuple[float, float, float]


@dataclass(frozen=True)
class CommandState:
    """Motion of the command at one instant; arrays of shape (N,), one number a joint of the neck.

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
        settled: Rolls the joints over their dead times.
        start_s: Time at which the first command of the plan will be sent, seconds.
        forecast: Forecast for the times that the controller asked for.
        command: The last command before the plan starts, sent one servo period before `start_s`.
        joint_position_rad: Joint angles now, as the observer estimates them, shape (N,), radians.
        joint_velocity_rad_s: Joint velocities now, shape (N,), rad/s.
        joint_offset_rad: How far from a command that stands still the joints settle, shape (N,), radians.
        sent_rad: Commands sent before now, one a servo period, oldest first, shape (M, N), radians.
        committed_rad: Commands that will be sent from now until the plan starts, shape (n, N), radians.
        held: Joints that do not follow their commands, by their place in `NeckSpec.joint_names`. Their angle now
            is what was measured. Only necks with more than two joints name any.
    """

    settled: SettledJoints
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
    def _settled(self) -> FloatArray:
        # The model has no offset.
        known = self.joint_position_rad - self.joint_offset_rad, self.joint_velocity_rad_s
        return self.settled(*known, self.sent_rad, self.committed_rad)

    @property
    def settled_position_rad(self) -> FloatArray:
        """Joint angles one dead time after the last command that is sent or committed, shape (N,), radians.

        Until then no plan changes the motion.
        """
        return np.asarray(self._settled[0] + self.joint_offset_rad)

    @property
    def settled_velocity_rad_s(self) -> FloatArray:
        """Joint velocities then, shape (N,), rad/s."""
        return np.asarray(self._settled[1])


class JointPlan(NamedTuple):
    """The plan of one joint at the knots: arrays of shape (K,), radians, rad/s and rad/s^2."""

    position_rad: FloatArray
    velocity_rad_s: FloatArray
    acceleration_rad_s2: FloatArray


@dataclass(frozen=True)
class Plan:
    """The commands to send over time: knots at equal steps, constant jerk between them.

    Attributes:
        start_s: Time of the first knot, seconds.
        step_s: Time between knots, seconds.
        position_rad: Commanded angles at the knots, shape (K, N), radians.
        velocity_rad_s: Shape (K, N), rad/s.
        acceleration_rad_s2: Shape (K, N), rad/s^2.
        events: Unusual events of its making, for the log.
        faults: The same, with a text for the log that is more than the event's meaning.

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

    @staticmethod
    def of_joints(
        start_s: float,
        step_s: float,
        joints: Sequence[JointPlan],
        events: tuple[str, ...] = (),
        faults: Sequence[ControllerError] = (),
    ) -> Plan:
        """Join the plans of all joints, in the order of `NeckSpec.joint_names`."""
        position, velocity, acceleration = np.array(joints).transpose(1, 2, 0)
        return Plan(start_s, step_s, position, velocity, acceleration, events, tuple(faults))

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

    def is_finite(self) -> bool:
        """True if no number is NaN or infinite."""
        return self._finite

    @cached_property
    def _finite(self) -> bool:
        # Asked at every tick, and a plan never changes.
        parts = (self.position_rad, self.velocity_rad_s, self.acceleration_rad_s2)
        return all(bool(np.isfinite(part).all()) for part in parts)

    def at(self, time_s: float) -> CommandState:
        """The command at a time.

        Args:
            time_s: Time, seconds; before the start it is the first knot, past the last knot the motion goes on
                at constant velocity.

        Returns:
            The command's motion.
        """
        position_rad, velocity_rad_s, acceleration_rad_s2 = zip(*self.motions_at(time_s), strict=True)
        return CommandState(np.array(position_rad), np.array(velocity_rad_s), np.array(acceleration_rad_s2))

    def motions_at(self, time_s: float) -> tuple[AxisMotion, ...]:
        """The same in plain numbers, which are quicker at every tick.

        Args:
            time_s: See `at`.

        Returns:
            The motions of the N joints.
        """
        last = len(self.position_rad) - 1
        # A nanosecond early is on the knot; floor would put it in the interval before.
        since_s = max(time_s - self.start_s, 0.0)
        step_s = self.step_s
        k = min(int(since_s / step_s + 1e-6), last)
        tau = since_s - k * step_s if k else since_s  # a single knot may last for ever
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
    """Plans commands. Its state is what one plan hands to the next."""

    def reset(self) -> None:
        """Forget all earlier plans."""

    def forecast_times_s(self, start_s: float, newest_capture_s: float) -> FloatArray:
        """Times for which the controller needs the forecast.

        Args:
            start_s: Time at which the first command of the plan will be sent, seconds.
            newest_capture_s: Capture time of the newest observation, seconds.

        Returns:
            Times, shape (H,), seconds.
        """

    def plan(self, situation: Situation) -> Plan:
        """Plan the commands from now on.

        Args:
            situation: Joints, commands, and the forecast for `forecast_times_s`.

        Returns:
            The plan.

        Raises:
            ControllerError: If there is none.
        """
