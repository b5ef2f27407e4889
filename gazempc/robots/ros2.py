"""A neck driven by ros2_control, or by any other receiver of joint commands on a ROS 2 topic."""

from __future__ import annotations

import contextlib
import math
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
import ruckig

from gazempc.errors import RobotError, SettingsError
from gazempc.neck.spec import NeckSpec
from gazempc.robots.options import Ros2Options
from gazempc.robots.robot import check_command, stop_trajectory
from gazempc.ros2.messages import Ros2Error, on_loop_clock, stamp_s, topic_name
from gazempc.ros2.node import Publication, Ros2Node, Subscription, message_type
from gazempc.types import FloatArray, JointState

_STATE_TYPE = "sensor_msgs/msg/JointState"
_WAKE_S = 0.01


# Number of intervals of a stop: enough for the controller's quintic spline to approximate phases of constant jerk.
_STOP_POINTS = 5


class Ros2Neck:
    """Publishes joint commands on one topic and subscribes to joint states on another.

    A trajectory begins with the command, half a servo period ahead, with its velocity and acceleration: the mean of the
    interpolated motion over a servo period equals the command, as with zero-order hold. The following points brake the
    joints to rest within the neck's limits. So without a further command the controller stops the neck; and a
    controller that requires a last point at rest accepts the trajectory.

    `read_state` raises `RobotError` without a valid joint state for `silent_after_s`, and `send_command` without a
    subscriber of the commands; both recover at the next call. After a loss of the controller for longer than
    `silent_after_s` a motion from the measured joints to the command is sent first, within the limits; meanwhile
    `send_command` raises `RobotError`. Only `connect` blocks.

    Args:
        neck: The joints' limits; without `reports_joints` no joint states are expected.
        clock_s: The loop's clock, seconds.
        to_loop_s: Converts Unix time in seconds to the loop's clock.
        options: Topics, joints and clock.
        connect_timeout_s: How long `connect` waits for controller and joint states, seconds.

    Raises:
        SettingsError: If an option is invalid.

    Attributes:
        ignored: Number of received messages that were not used.
        ignored_because: Reason for the last of them, or "".
    """

    def __init__(
        self,
        neck: NeckSpec,
        clock_s: Callable[[], float],
        to_loop_s: Callable[[float], float],
        options: Ros2Options,
        connect_timeout_s: float = 5.0,
    ) -> None:
        joint_names, joint_signs = options.joint_names, options.joint_signs
        joints = ", ".join(neck.joint_names)
        if not len(joint_names) == len(set(joint_names)) == neck.joints or not all(joint_names):
            raise SettingsError(f"joint_names {joint_names!r}: expected the names of {neck.joints} joints, {joints}")
        if tuple(map(abs, joint_signs)) != (1,) * neck.joints:
            raise SettingsError(f"joint_signs {joint_signs!r}: accepted are 1 and -1 for each of {joints}")
        from_start_s = 0.5 * neck.servo_period_s if options.time_from_start_s is None else options.time_from_start_s
        self._neck, self._clock_s, self._to_loop_s, self._options = neck, clock_s, to_loop_s, options
        self._command_topic, self._state_topic = topic_name(options.command_topic), topic_name(options.state_topic)
        self._sends_speeds = options.command_values == "velocity"
        if self._sends_speeds and "MultiArray" not in options.command_type:
            raise SettingsError("command_values velocity: accepted with command_type std_msgs/msg/Float64MultiArray")
        self._signs = np.array(joint_signs, dtype=np.float64)
        self._from_start_ns = round(from_start_s * 1e9)
        self._connect_timeout_s = connect_timeout_s
        self._return_steps = ruckig.Ruckig(neck.joints, neck.servo_period_s)
        # Commands sent, newest last: the history over the delay of the joints.
        ahead_s = float(np.max(neck.dead_time_s + neck.servo_lag_s)) + neck.servo_period_s
        self._sent: deque[FloatArray] = deque(maxlen=max(3, round(ahead_s * neck.servo_rate_hz)))
        self._measured_rad: FloatArray | None = None
        self._trajectory: Any = None
        self.ignored, self.ignored_because = 0, ""
        self._forget()

    def _forget(self) -> None:
        self._node: Ros2Node | None = None
        self._commands: Publication | None = None
        self._states: Subscription | None = None
        self._latest: JointState | None = None
        self._returning: tuple[ruckig.InputParameter, ruckig.OutputParameter] | None = None
        self._lost_s, self._newest_s, self._heard_s = math.inf, -math.inf, -math.inf
        self._sent.clear()

    def connect(self) -> None:
        """Create the node, and wait for the controller and joint states.

        Raises:
            RobotError: After a timeout; names the topic and what to check.
            RosNotSourcedError: If rclpy cannot be imported.
        """
        if self._node is not None:
            return
        try:
            self._node = Ros2Node("gazempc", self._options.use_sim_time)
            self._commands = self._node.publication(self._command_topic, self._options.command_type)
            if self._neck.reports_joints:
                self._states = self._node.subscription(self._state_topic, _STATE_TYPE)
            self._wait_for_robot(self._commands)
        except BaseException as error:
            self.close()
            if isinstance(error, Ros2Error):
                raise RobotError(str(error)) from None
            raise

    def read_state(self) -> JointState | None:
        """See `gazempc.robots.robot.Robot.read_state`; unreported velocities are NaN."""
        self._connected()
        if self._states is None:
            return None
        self._process()
        latest, self._latest = self._latest, None
        if latest is None and self._clock_s() - self._heard_s > self._options.silent_after_s:
            # The robot's clock may be set back after a restart.
            self._newest_s = -math.inf
            why = f"; the last one was refused: {self.ignored_because}" if self.ignored_because else ""
            raise RobotError(
                f"no joint state on {self._state_topic} for more than {self._options.silent_after_s:g} s{why}"
            )
        return latest

    def send_command(self, position_rad: FloatArray) -> FloatArray:
        """See `gazempc.robots.robot.Robot.send_command`; without a further one the controller brakes the neck."""
        check_command(position_rad, self._signs.size)
        commands = self._connected()
        now_s = self._clock_s()
        if not commands.has_listeners:
            self._sent.clear()
            self._lost_s, self._returning = min(self._lost_s, now_s), None
            raise RobotError(f"no subscriber of the commands on {self._command_topic}: has the controller stopped?")
        sent_rad: FloatArray = np.clip(position_rad, self._neck.position_min_rad, self._neck.position_max_rad)
        if now_s - self._lost_s > self._options.silent_after_s and self._states is not None and not self._sends_speeds:
            on_way_rad = self._return(sent_rad, now_s)
            if np.max(np.abs(on_way_rad - sent_rad)) > 1e-9:
                self._publish(commands, on_way_rad)
                raise RobotError(f"{self._command_topic} has a subscriber again: the joints return to the command")
        self._lost_s, self._returning = math.inf, None
        self._publish(commands, sent_rad)
        return sent_rad

    def _publish(self, commands: Publication, position_rad: FloatArray) -> None:
        try:
            commands.publish(self._command(position_rad))
        except Ros2Error as error:
            raise RobotError(f"cannot send commands on {self._command_topic}: {error}") from None
        self._sent.append(position_rad)

    def _return(self, command_rad: FloatArray, now_s: float) -> FloatArray:
        """The next position on the way from the measured joints to the command."""
        neck = self._neck
        if self._returning is None:
            if self._measured_rad is None or now_s - self._heard_s > self._options.silent_after_s:
                raise RobotError(f"{self._command_topic} has a subscriber again, {self._state_topic} no joint state")
            motion, limits = ruckig.InputParameter(neck.joints), neck.command_limits
            motion.current_position = limits.clip_position(self._measured_rad).tolist()
            # Slowly, as the neck may have been displaced.
            motion.max_velocity = np.minimum(limits.velocity_max_rad_s, 0.5).tolist()
            motion.max_acceleration = limits.acceleration_max_rad_s2.tolist()
            motion.max_jerk = limits.jerk_max_rad_s3.tolist()
            self._returning = motion, ruckig.OutputParameter(neck.joints)
        motion, following = self._returning
        motion.target_position = command_rad.tolist()
        self._return_steps.update(motion, following)
        following.pass_to_input(motion)
        return np.array(following.new_position)

    def close(self) -> None:
        """Destroy the node; the controller brakes a moving neck."""
        if self._sends_speeds and self._commands is not None:
            # A speed controller holds the last speed.
            with contextlib.suppress(Ros2Error):
                self._commands.publish(message_type(self._options.command_type)(data=[0.0] * self._signs.size))
        if self._node is not None:
            self._node.close()
        self._forget()

    def _wait_for_robot(self, commands: Publication) -> None:
        until_s = time.monotonic() + self._connect_timeout_s
        while time.monotonic() < until_s:
            self._process()
            if commands.has_listeners and (self._states is None or self._latest is not None):
                return
            time.sleep(_WAKE_S)
        found = commands.has_listeners
        if found and self.ignored_because:
            raise Ros2Error(f"no valid joint state on {self._state_topic}: {self.ignored_because}")
        missing = f"sends on {self._states.described}" if found and self._states else f"listens to {commands.described}"
        raise Ros2Error(f"no node {missing}: is it active, in this domain (ROS_DOMAIN_ID)?")

    def _connected(self) -> Publication:
        if self._node is None or self._commands is None:
            raise RobotError("the ROS 2 neck is not connected: call connect() first")
        return self._commands

    def _process(self) -> None:
        now_s = self._clock_s()
        try:
            messages = [] if self._states is None else self._states.take()
        except Ros2Error as error:
            raise RobotError(f"cannot read {self._state_topic}: {error}") from None
        for message in messages:
            try:
                state = self._joints(message, now_s)
            except Ros2Error as error:
                self.ignored, self.ignored_because = self.ignored + 1, str(error)
                continue
            self._heard_s, self._newest_s, self._latest = now_s, state.time_s, state
            self._measured_rad = state.position_rad

    def _joints(self, message: Any, now_s: float) -> JointState:
        """The neck's joints of a message, which may contain others, in any order."""
        missing = next((name for name in self._options.joint_names if name not in message.name), None)
        if missing is not None:
            raise Ros2Error(f"it has no joint {missing!r}, only {', '.join(message.name) or 'none'}")
        at = [message.name.index(name) for name in self._options.joint_names]
        n_joints = len(message.name)
        if len(message.position) != n_joints:
            raise Ros2Error(f"it has {n_joints} names and {len(message.position)} positions")
        ros_s = stamp_s(message.header.stamp)
        time_s = on_loop_clock(ros_s if self._node is None else self._node.unix_s(ros_s), self._to_loop_s, now_s)
        if time_s <= self._newest_s:
            raise Ros2Error("it is not newer than the previous one")
        position_rad = self._signs * np.asarray(message.position)[at]
        if not np.all(np.isfinite(position_rad)):
            raise Ros2Error(f"its positions are not finite: {position_rad}")
        # Many drivers omit the velocities.
        known = len(message.velocity) == n_joints
        velocity_rad_s = self._signs * np.asarray(message.velocity)[at] if known else np.full_like(self._signs, np.nan)
        return JointState(time_s, position_rad, velocity_rad_s)

    def _command(self, position_rad: FloatArray) -> Any:
        """The message of a command; the commands before it give its velocity and acceleration."""
        first, before = [position_rad, position_rad, *self._sent][-2:]
        rate_hz = self._neck.servo_rate_hz
        velocity_rad_s = (position_rad - before) * rate_hz
        acceleration_rad_s2 = (position_rad - 2.0 * before + first) * rate_hz**2 * (len(self._sent) > 1)
        if "MultiArray" in self._options.command_type:
            values = position_rad
            if self._sends_speeds:
                drift_rad = 0.0 if self._measured_rad is None or not self._sent else self._sent[0] - self._measured_rad
                most_rad_s = self._neck.velocity_max_rad_s
                # A position loop with a time constant of 1 s acts against the drift of a velocity-controlled joint.
                values = np.clip(velocity_rad_s + drift_rad / 1.0, -most_rad_s, most_rad_s)
            return message_type(self._options.command_type)(data=(self._signs * values).tolist())
        stop = stop_trajectory(position_rad, velocity_rad_s, acceleration_rad_s2, self._neck, self._neck.servo_period_s)
        later_s = [stop.duration * k / _STOP_POINTS for k in range(_STOP_POINTS + 1)]
        states = np.array([stop.at_time(each_s) for each_s in later_s])  # point, derivative, joint
        states[0] = position_rad, velocity_rad_s, acceleration_rad_s2
        np.clip(states[:, 0], self._neck.position_min_rad, self._neck.position_max_rad, out=states[:, 0])
        states *= self._signs
        if self._trajectory is None:
            # Reused message: construction takes longer. A stamp of zero means the time of arrival, independent of the
            # clocks of the two computers.
            point = message_type("trajectory_msgs/msg/JointTrajectoryPoint")
            points = [point() for _ in range(_STOP_POINTS + 1)]
            kind, names = message_type(self._options.command_type), list(self._options.joint_names)
            self._trajectory = kind(joint_names=names, points=points)
        for point, each_s, state in zip(self._trajectory.points, later_s, states.tolist(), strict=True):
            point.positions, point.velocities, point.accelerations = state
            from_start = point.time_from_start
            from_start.sec, from_start.nanosec = divmod(self._from_start_ns + round(1e9 * each_s), 10**9)
        return self._trajectory
