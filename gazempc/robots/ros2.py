"""A neck that is driven by ros2_control, or by anything else that takes joint commands on a ROS 2 topic."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from gazempc.errors import RobotError, SettingsError
from gazempc.neck.spec import NeckSpec
from gazempc.robots.options import Ros2Options
from gazempc.ros2.node import Publication, Ros2Node, Subscription
from gazempc.ros2.wire import WireError, make_message, stamp_to_loop_s, topic_name
from gazempc.types import FloatArray, JointState

_STATE_TYPE = "sensor_msgs/msg/JointState"
_WAKE_S = 0.01


class Ros2Neck:
    """Sends joint positions on one topic and takes joint states from another, over Zenoh as rmw_zenoh does.

    Every method but `close` raises `RobotError` while the router cannot be reached. `read_state` does so too if no
    joint state that can be used has come for `silent_after_s`, and `send_command` if no node listens to the commands.
    Nothing has to be done about it: Zenoh connects again in the background and the next call finds it so; no call but
    `connect` ever waits.

    Args:
        neck: The joints' limits; without `reports_joints` no joint states are expected.
        clock_s: The loop's clock, seconds.
        to_loop_s: Converts Unix time in seconds to the loop's clock.
        options: Network, topics and joints.
        connect_timeout_s: How long `connect` waits for controller and joint states, seconds.
        node_name: Name of this program in the graph of ROS 2.

    Raises:
        SettingsError: If an option cannot be right.

    Attributes:
        ignored: Messages that were received and not used.
        ignored_because: Why the last of them was not, or "".
    """

    def __init__(
        self,
        neck: NeckSpec,
        clock_s: Callable[[], float],
        to_loop_s: Callable[[float], float],
        options: Ros2Options,
        connect_timeout_s: float = 5.0,
        node_name: str = "gazempc",
    ) -> None:
        joint_names, joint_signs, command_type = options.joint_names, options.joint_signs, options.command_type
        joints = ", ".join(neck.joint_names)
        if not len(joint_names) == len(set(joint_names)) == neck.joints or not all(joint_names):
            raise SettingsError(f"joint_names {joint_names!r}: expected the names of {neck.joints} joints, {joints}")
        if tuple(map(abs, joint_signs)) != (1,) * neck.joints:
            raise SettingsError(f"joint_signs {joint_signs!r}: accepted are 1 and -1 for each of {joints}")
        from_start_s = neck.servo_period_s if options.time_from_start_s is None else options.time_from_start_s
        self._neck = neck
        self._clock_s = clock_s
        self._to_loop_s = to_loop_s
        self._names = list(joint_names)
        self._command_topic = topic_name(options.command_topic)
        self._command_type = command_type
        self._state_topic = topic_name(options.state_topic)
        self._network = options.network
        self._signs = np.array(joint_signs, dtype=np.float64)
        self._from_start_ns = round(from_start_s * 1e9)
        self._silent_after_s = options.silent_after_s
        self._connect_timeout_s = connect_timeout_s
        self._node_name = node_name
        self._node: Ros2Node | None = None
        self._commands: Publication | None = None
        self._states: Subscription | None = None
        self._latest: JointState | None = None
        self._newest_s = -math.inf
        self._heard_s = -math.inf
        self.ignored = 0
        self.ignored_because = ""

    def connect(self) -> None:
        """Join the graph, and wait until the controller and the joint states are there.

        Raises:
            RobotError: If they are not; names the topic and what to check.
            MissingOptionalDependencyError: If the extra `ros2` is not installed.
        """
        if self._node is not None:
            return
        try:
            self._node = Ros2Node(self._node_name, self._network)
            self._commands = self._node.publication(self._command_topic, self._command_type)
            if self._neck.reports_joints:
                self._states = self._node.subscription(self._state_topic, _STATE_TYPE)
            self._wait_for_robot(self._node, self._commands)
        except WireError as error:
            self.close()
            raise RobotError(str(error)) from None
        except BaseException:
            self.close()
            raise

    def read_state(self) -> JointState | None:
        """See `gazempc.robots.robot.Robot.read_state`; a velocity that the robot does not report is NaN."""
        self._connected()
        if self._states is None:
            return None
        self._take_in(self._states)
        latest, self._latest = self._latest, None
        if latest is None and self._clock_s() - self._heard_s > self._silent_after_s:
            # The robot may come back with its clock set to an earlier time.
            self._newest_s = -math.inf
            why = f"; the last one was not used: {self.ignored_because}" if self.ignored_because else ""
            raise RobotError(f"no joint state on {self._state_topic} for more than {self._silent_after_s:g} s{why}")
        return latest

    def send_command(self, position_rad: FloatArray) -> FloatArray:
        """See `gazempc.robots.robot.Robot.send_command`; the controller holds the last position that it got."""
        if np.shape(position_rad) != self._signs.shape or not np.all(np.isfinite(position_rad)):
            raise RobotError(f"refused a command that is not {self._signs.size} finite angles: {position_rad}")
        commands = self._connected()
        if not commands.has_listeners:
            raise RobotError(f"no node listens to the commands on {self._command_topic}: has the controller stopped?")
        sent_rad: FloatArray = np.clip(position_rad, self._neck.position_min_rad, self._neck.position_max_rad)
        try:
            commands.publish(self._command(self._signs * sent_rad))
        except WireError as error:
            raise RobotError(f"cannot send commands on {self._command_topic}: {error}") from None
        return sent_rad

    def close(self) -> None:
        """Leave the graph; the controller holds the last position that it got."""
        if self._node is not None:
            self._node.close()
        self._node = self._commands = self._states = self._latest = None
        self._newest_s = self._heard_s = -math.inf

    def _wait_for_robot(self, node: Ros2Node, commands: Publication) -> None:
        until_s = time.monotonic() + self._connect_timeout_s
        while True:
            if self._states is not None:
                self._take_in(self._states)
            heard = self._states is None or self._latest is not None
            if heard and commands.has_listeners:
                return
            if time.monotonic() >= until_s:
                break
            time.sleep(_WAKE_S)
        if not commands.has_listeners:
            raise WireError(node.why_no_match("MS", self._command_topic, self._command_type))
        if self.ignored_because:
            raise WireError(f"no joint state on {self._state_topic} can be used: {self.ignored_because}")
        raise WireError(node.why_no_match("MP", self._state_topic, _STATE_TYPE))

    def _connected(self) -> Publication:
        if self._node is None or self._commands is None:
            raise RobotError("the ROS 2 neck is not connected: call connect() first")
        if not self._node.connected:
            raise RobotError(f"the Zenoh router at {self._network.endpoint} has gone; trying to reach it again")
        return self._commands

    def _take_in(self, states: Subscription) -> None:
        now_s = self._clock_s()
        try:
            messages = states.take()
        except WireError as error:
            raise RobotError(f"cannot read {self._state_topic}: {error}") from None
        for message in messages:
            try:
                if isinstance(message, WireError):
                    raise message
                state = self._joints(message, now_s)
            except WireError as error:
                self.ignored += 1
                self.ignored_because = str(error)
                continue
            self._heard_s, self._newest_s, self._latest = now_s, state.time_s, state

    def _joints(self, message: Any, now_s: float) -> JointState:
        """The neck's joints of a message that may be about others too, in any order."""
        missing = [name for name in self._names if name not in message.name]
        if missing:
            raise WireError(f"it has no joint {missing[0]!r}, only {', '.join(message.name) or 'none'}")
        at = [message.name.index(name) for name in self._names]
        n_joints = len(message.name)
        if len(message.position) != n_joints:
            raise WireError(f"it has {n_joints} names and {len(message.position)} positions")
        time_s = stamp_to_loop_s(message.header.stamp, self._to_loop_s, now_s)
        if time_s <= self._newest_s:
            raise WireError("it is not newer than the one before")
        position_rad = self._signs * message.position[at]
        if not np.all(np.isfinite(position_rad)):
            raise WireError(f"its positions are not finite: {position_rad}")
        # Many drivers leave the velocities out.
        known = len(message.velocity) == n_joints
        velocity_rad_s = self._signs * message.velocity[at] if known else np.full_like(self._signs, np.nan)
        return JointState(time_s, position_rad, velocity_rad_s)

    def _command(self, position_rad: FloatArray) -> Any:
        if self._command_type == "std_msgs/msg/Float64MultiArray":
            layout = make_message("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
            return make_message(self._command_type, layout=layout, data=position_rad)
        seconds, nanoseconds = divmod(self._from_start_ns, 10**9)
        none = np.empty(0)
        point = make_message(
            "trajectory_msgs/msg/JointTrajectoryPoint",
            positions=position_rad,
            velocities=none,
            accelerations=none,
            effort=none,
            time_from_start=make_message("builtin_interfaces/msg/Duration", sec=seconds, nanosec=nanoseconds),
        )
        # A stamp of zero means: from now on. Then the two computers' clocks do not matter.
        stamp = make_message("builtin_interfaces/msg/Time", sec=0, nanosec=0)
        header = make_message("std_msgs/msg/Header", stamp=stamp, frame_id="")
        return make_message(self._command_type, header=header, joint_names=self._names, points=[point])
