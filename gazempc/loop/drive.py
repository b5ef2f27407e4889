"""Actuation: converts the command's motion to angles, or to speeds for velocity-controlled joints."""

from __future__ import annotations

import math

import numpy as np

from gazempc.controllers.controller import AxisMotion
from gazempc.neck.spec import Axis, NeckSpec
from gazempc.types import FloatArray

# Bound of the position loop's output, as a share of top speed: slow return after an external displacement.
_CORRECTION_SHARE = 0.1


def speed_loop_gain(axis: Axis, period_s: float) -> float:
    """Gain of the position loop of a velocity-controlled joint, 1/s.

    Its time constant equals the response time of the joint, which bounds the bandwidth of the observer's offset.

    Args:
        axis: The joint.
        period_s: Servo period, seconds.
    """
    return 1.0 / (axis.dead_time_s + axis.servo_lag_s + period_s)


class _SpeedAxis:
    """Velocity-controlled joint: feedforward of the command's derivative, and a low-gain position loop.

    Through dead time and servo, the joint follows the integral of the speeds, as a position-controlled joint follows
    the angles. With zero-order hold, the mean angle over a period is the integral at its middle.
    """

    def __init__(self, axis: Axis, position_rad: float, period_s: float, reports: bool) -> None:
        self._period_s = period_s
        self._gain = speed_loop_gain(axis, period_s)
        self._fastest_rad_s = axis.velocity_max_rad_s
        # Without encoders: an unattended joint stops at its limit. With encoders the offset has the difference.
        self._range_rad = (-math.inf, math.inf)
        if not reports:
            self._range_rad = math.radians(axis.position_min_deg), math.radians(axis.position_max_deg)
        self._integral_rad = self._commanded_rad = position_rad
        self._speed_rad_s = 0.0

    def outgoing(self, motion: AxisMotion, offset_rad: float, limit_rad_s: float) -> float:
        self._speed_rad_s = motion[1]
        # The motion itself may still be braking to the limit.
        most = min(_CORRECTION_SHARE * self._fastest_rad_s, max(limit_rad_s - abs(motion[1]), 0.0))
        missing_rad = self._commanded_rad - self._integral_rad - offset_rad
        speed = motion[1] + min(max(self._gain * missing_rad, -most), most)
        return min(max(speed, -self._fastest_rad_s), self._fastest_rad_s)

    def sent(self, speed_rad_s: float, got_through: bool) -> float:
        middle_rad = self._integral_rad + 0.5 * self._period_s * speed_rad_s
        self._integral_rad += self._period_s * speed_rad_s
        if got_through:
            self._commanded_rad += self._period_s * self._speed_rad_s
        else:
            self.skip(0, speed_rad_s)
        return middle_rad

    def skip(self, periods: int, speed_rad_s: float) -> None:
        low_rad, high_rad = self._range_rad
        self._integral_rad = min(max(self._integral_rad + periods * self._period_s * speed_rad_s, low_rad), high_rad)


class Drive:
    """Converts motions of the command to the robot's inputs, and the inputs sent to the resulting angles.

    Args:
        neck: The neck; for an axis with ``command = "position"`` the input is the angle.
        position_rad: Initial command, at rest, shape (N,), radians.
    """

    def __init__(self, neck: NeckSpec, position_rad: FloatArray) -> None:
        self._axes = [
            _SpeedAxis(axis, start, neck.servo_period_s, neck.reports_joints) if axis.takes_speed else None
            for axis, start in zip(neck.axes, position_rad.tolist(), strict=True)
        ]
        self._speeds = neck.takes_speeds
        self._takes_angle = np.array([axis is None for axis in self._axes])

    def outgoing(self, motions: tuple[AxisMotion, ...], offset_rad: FloatArray, limit_rad_s: float) -> FloatArray:
        """The input of the robot.

        Args:
            motions: The command's motions, one a joint.
            offset_rad: Steady-state errors of the joints, see `JointEstimate`, shape (N,), radians.
            limit_rad_s: Limit of the speeds in addition to the joints' own, rad/s.

        Returns:
            Angles or speeds, shape (N,), radians or rad/s.
        """
        pairs = zip(self._axes, motions, offset_rad.tolist(), strict=True)
        return np.array(
            [motion[0] if axis is None else axis.outgoing(motion, off, limit_rad_s) for axis, motion, off in pairs]
        )

    def sent(self, command: FloatArray, got_through: bool = True) -> FloatArray:
        """Account for one servo period of the accepted command.

        Args:
            command: As accepted by the robot, shape (N,), radians or rad/s.
            got_through: False for a period without a command, in which the previous one still acts.

        Returns:
            The resulting angles, without the offset, shape (N,), radians: the command of an equivalent
            position-controlled joint.
        """
        if not self._speeds:
            return command
        pairs = zip(self._axes, command.tolist(), strict=True)
        return np.array([value if axis is None else axis.sent(value, got_through) for axis, value in pairs])

    def skip(self, periods: int, command: FloatArray) -> None:
        """Account for servo periods in which the last command still acts, in closed form.

        Args:
            periods: Number of servo periods.
            command: As accepted by the robot, shape (N,), radians or rad/s.
        """
        for axis, value in zip(self._axes, command.tolist(), strict=True):
            if axis is not None:
                axis.skip(periods, value)

    def for_controllers(self, sent_rad: FloatArray, offset_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Commands sent and offsets in the coordinates of the controllers.

        For a velocity-controlled joint the offset is compensated here: zero for controllers, and added to the commands.

        Args:
            sent_rad: Commands sent, as `sent` returns them, shape (M, N), radians.
            offset_rad: As in `outgoing`.

        Returns:
            Both, shapes (M, N) and (N,), radians; the commands are a copy.
        """
        return sent_rad + np.where(self._takes_angle, 0.0, offset_rad), np.where(self._takes_angle, offset_rad, 0.0)
