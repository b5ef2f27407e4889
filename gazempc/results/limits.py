"""Violations of the neck's limits in a log; there must be none."""

from __future__ import annotations

import numpy as np

from gazempc.neck.spec import NeckSpec
from gazempc.results.log import Log

# A robot rounds its commands to steps of its own; the coarsest one known has 0.0015 rad (Dynamixel: 4096 a turn).
_ROBOT_STEP_RAD = 0.004
# Third differences of double-precision angles at 200 Hz carry about 1e-8 of rounding.
_TOLERANCE = 1e-6


def limit_violations(log: Log, neck: NeckSpec) -> int:
    """Count ticks and joints at which command or joint is outside the neck's limits.

    Position, velocity, acceleration and jerk are those of the positions in the log, by differences; both the
    command's and the joint's count. In a live run the position that was sent counts, and the motion of the command.

    Args:
        log: The run.
        neck: The limits.

    Returns:
        The number of violations.
    """
    dt_s = neck.servo_period_s
    count = 0
    if log.run.joints == "measured":
        # Readings of a robot come when they come, and it may round commands to steps of its own: what was meant counts.
        return _violations_of_motion(log, neck)
    for position in (log.command_position_rad, log.joint_position_rad):
        count += int(np.sum(position > neck.position_max_rad + _TOLERANCE))
        count += int(np.sum(position < neck.position_min_rad - _TOLERANCE))
        limits = (neck.velocity_max_rad_s, neck.acceleration_max_rad_s2, neck.jerk_max_rad_s3)
        for order, limit in enumerate(limits, start=1):
            motion = np.abs(np.diff(position, order, axis=0)) / dt_s**order
            count += int(np.sum(motion > limit * (1.0 + _TOLERANCE)))
    return count


def _violations_of_motion(log: Log, neck: NeckSpec) -> int:
    position = log.command_position_rad
    count = int(np.sum(position > neck.position_max_rad + _TOLERANCE))
    count += int(np.sum(position < neck.position_min_rad - _TOLERANCE))
    # A robot may round to steps of its own, and reach its first command at a speed of its own; a jump it must not get.
    step_rad = neck.velocity_max_rad_s * neck.servo_period_s + _ROBOT_STEP_RAD
    count += int(np.sum(np.abs(np.diff(position, axis=0)) > step_rad))
    jerk = np.diff(log.command_acceleration_rad_s2, axis=0) / neck.servo_period_s
    for motion, limit in (
        (log.command_velocity_rad_s, neck.velocity_max_rad_s),
        (log.command_acceleration_rad_s2, neck.acceleration_max_rad_s2),
        (jerk, neck.jerk_max_rad_s3),
    ):
        count += int(np.sum(np.abs(motion) > limit * (1.0 + _TOLERANCE)))
    return count
