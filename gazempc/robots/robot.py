"""The interface of all robots, and the approach from the initial angles to the command limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import ruckig

from gazempc.errors import RobotError
from gazempc.neck.spec import CommandLimits, NeckSpec
from gazempc.types import FloatArray, JointState


class Robot(Protocol):
    """Driver of a neck: accepts positions, or speeds for an axis with ``command = "velocity"`` in the neck file.

    Every method except `close` raises `gazempc.errors.RobotError` if the robot does not reply.

    A simulated robot also has the class attribute ``keeps_any_clock = True`` (it uses the loop's time, so a simulated
    clock is allowed), and the method ``true_state() -> JointState`` (the true joint state).
    """

    def connect(self) -> None:
        """Open the connection; idempotent."""

    def read_state(self) -> JointState | None:
        """Read the joints.

        Returns:
            The latest measured state; None without joint feedback, or without a new reading.
        """

    def send_command(self, position_rad: FloatArray) -> FloatArray:
        """Send the commands of the joints.

        Args:
            position_rad: Angles in the order of `NeckSpec.joint_names`, shape (N,), radians; for velocity-controlled
                joints speeds, rad/s.

        Returns:
            The values sent, shape (N,): angles are clamped to the joints' range.
        """

    def close(self) -> None:
        """Close the connection; never raises, and may be called at any time."""


def check_command(command: FloatArray, joints: int) -> None:
    """Validate the shape of a command, and that it is finite.

    Args:
        command: Angles, or speeds of velocity-controlled joints.
        joints: N.

    Raises:
        RobotError: If it is invalid.
    """
    if np.shape(command) != (joints,) or not np.all(np.isfinite(command)):
        raise RobotError(f"refused a command: expected {joints} finite numbers, not {command}")


# Tolerance of the joints' range; beyond it neck file and robot are inconsistent.
_OUTSIDE_RAD = np.deg2rad(1.0)
# Plausibility bound, as of logs.
_ANY_NUMBER = 1e10


def checked_reading(state: object, neck: NeckSpec, method: str = "read_state") -> JointState | None:
    """Validate a joint reading.

    Args:
        state: Return value of a method of a robot.
        neck: The neck, for its joints.
        method: Name of the method.

    Returns:
        A copy of the reading, as a driver may reuse its buffers; None for None (no new reading).

    Raises:
        RobotError: If it is invalid; names the requirement.
    """
    if state is None:
        return None
    if not isinstance(state, JointState):
        raise RobotError(f"{method}() returned {type(state).__name__}, expected a gazempc.JointState, or None")
    if not isinstance(state.time_s, float | int | np.floating | np.integer) or abs(state.time_s) > _ANY_NUMBER:
        raise RobotError(f"{method}() returned time_s {state.time_s!r}, expected seconds of the loop's clock")
    for name in ("position_rad", "velocity_rad_s"):
        value: object = getattr(state, name)
        if not isinstance(value, np.ndarray) or value.shape != (neck.joints,) or value.dtype.kind not in "fiu":
            needed = f"an array of shape ({neck.joints},): {', '.join(neck.joint_names)}"
            raise RobotError(f"{method}() returned {name} {value!r}, expected {needed}")
        if any(abs(number) > _ANY_NUMBER for number in value.tolist()):
            raise RobotError(f"{method}() returned {name} {value}, expected numbers of a joint")
    angles_rad, speeds_rad_s = (np.array(each, np.float64) for each in (state.position_rad, state.velocity_rad_s))
    return JointState(float(state.time_s), angles_rad, speeds_rad_s)


def way_in_rad(neck: NeckSpec, position_rad: FloatArray) -> FloatArray:
    """Slow motion of a neck into its command limits, which are narrower than the joints' range.

    Args:
        neck: The neck.
        position_rad: Present joint angles, shape (N,), radians.

    Returns:
        One command a servo period, the last one at rest inside `NeckSpec.command_limits`; shape (K, N), K = 0 if it is
        already inside.

    Raises:
        RobotError: If it is outside the joints' range.
    """
    low, high = neck.position_min_rad, neck.position_max_rad
    if np.any((position_rad < low - _OUTSIDE_RAD) | (position_rad > high + _OUTSIDE_RAD)):
        stands_deg, least, most = (np.rad2deg(each).round(1) for each in (position_rad, low, high))
        stands = ", ".join(f"{name} {deg:.1f}" for name, deg in zip(neck.joint_names, stands_deg, strict=True))
        hint = "move it inside by hand, or check loop.gaze_region_deg, and zero and direction of its axes"
        raise RobotError(f"the neck stands at {stands} deg, outside its range ({least} to {most}): {hint}")
    limits = neck.command_limits
    start, target = np.clip(position_rad, low, high), limits.clip_position(position_rad)
    if np.array_equal(start, target):
        return np.empty((0, neck.joints))
    slow_rad_s = np.minimum(limits.velocity_max_rad_s, 0.3)
    return move_rad(start, target, (slow_rad_s, limits.acceleration_max_rad_s2, limits.jerk_max_rad_s3), neck)


def move_rad(start_rad: FloatArray, target_rad: FloatArray, limits: Sequence[FloatArray], neck: NeckSpec) -> FloatArray:
    """Time-optimal motion from rest to rest.

    Args:
        start_rad: Start, shape (J,), radians.
        target_rad: End, shape (J,), radians.
        limits: Limits of velocity, acceleration and jerk, each of shape (J,).
        neck: The neck with its servo rate.

    Returns:
        Commands from one servo period after the start, shape (K, J), radians.
    """
    request = ruckig.InputParameter(start_rad.size)
    request.current_position, request.target_position = start_rad.tolist(), target_rad.tolist()
    request.max_velocity, request.max_acceleration, request.max_jerk = (limit.tolist() for limit in limits)
    trajectory = _planned(request)
    steps = int(np.ceil(trajectory.duration / neck.servo_period_s - 1e-9)) + 1
    return np.array([trajectory.at_time((k + 1) * neck.servo_period_s)[0] for k in range(steps)])


def stop_trajectory(
    position_rad: FloatArray,
    velocity_rad_s: FloatArray,
    acceleration_rad_s2: FloatArray,
    limits: NeckSpec | CommandLimits,
    least_s: float,
) -> ruckig.Trajectory:
    """Time-optimal stop within limits of acceleration and jerk.

    Args:
        position_rad: Present command, shape (N,), radians.
        velocity_rad_s: Its velocity, shape (N,).
        acceleration_rad_s2: Its acceleration, shape (N,).
        limits: Limits of the neck, or of its commands.
        least_s: Minimum duration, seconds.

    Returns:
        The motion.
    """
    request = ruckig.InputParameter(position_rad.size)
    request.control_interface = ruckig.ControlInterface.Velocity
    request.synchronization = ruckig.Synchronization.No  # each joint stops independently
    request.current_position, request.current_velocity = position_rad.tolist(), velocity_rad_s.tolist()
    request.current_acceleration = acceleration_rad_s2.tolist()
    request.max_acceleration = limits.acceleration_max_rad_s2.tolist()
    request.max_jerk = limits.jerk_max_rad_s3.tolist()
    request.minimum_duration = least_s
    return _planned(request)


def _planned(request: ruckig.InputParameter) -> ruckig.Trajectory:
    trajectory = ruckig.Trajectory(request.degrees_of_freedom)
    result = ruckig.Ruckig(request.degrees_of_freedom).calculate(request, trajectory)
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise RobotError(f"no motion within the neck's limits ({result})")
    return trajectory
