"""The node `gaze`: people in, joint commands out.

It is a lifecycle node, as the controllers of ros2_control are: parameters are set while it is unconfigured, `configure`
checks them, `activate` connects the robot and begins to send commands, and `deactivate` brakes the neck within its
limits. With the parameter `autostart` (the default) it does both by itself, and retries until the robot replies. The
command `ros2 param describe /gaze NAME` explains each parameter.

Subscribed topics:

- that of `source`: `PoseStamped`, `PoseWithCovarianceStamped`, `PointStamped`, `PoseArray` of geometry_msgs or
  `vision_msgs/Detection3DArray`, in any tf frame, at their stamps; or the topics of ROS4HRI
- `/joint_states`, `/tf`, `/tf_static`; with `use_sim_time` also `/clock`, the clock of all stamps. The loop runs in
  real time, so the simulation must run at factor 1.
- `~/attend` (`std_msgs/String`): id of the person to look at; empty for the policy of `attend` again
- `~/look_away` (`std_msgs/String`): `thinking` at once, or the rhythm `listening`, `speaking` or `told`

Published topics:

- `options.ros2.command_topic` as `JointTrajectory`: the command half a servo period ahead with its derivatives, then a
  stop within the limits. A controller with `allow_nonzero_velocity_at_trajectory_end: false` accepts it, and brakes
  when commands end. `time_from_start_s` acts as further dead time: identify the neck with the same value. Or as
  `Float64MultiArray`: positions, or velocities with `command_values: velocity`.
- `~/markers`: gaze ray, attended head, forecast with 2-sigma ellipsoids; `/diagnostics`: the status line's facts

Actions: `~/point_head` (`control_msgs/PointHead`: frame and axis that point, `min_duration`, `max_velocity`, feedback)
and `~/look_at` (`hri_actions_msgs/LookAt`). A goal outranks people until it ends; a newer one aborts it.
"""

from __future__ import annotations

import gc
import threading
from collections.abc import Sequence
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import Node, State, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from scipy.spatial.transform import Rotation
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from gazempc.errors import GazempcError
from gazempc.live.gaze import Gaze
from gazempc.live.process import before_other_programs, stopped_by_signals
from gazempc.live.sources.ros2 import TfListener
from gazempc.ros2.node import Ros2Node
from gazempc.types import FloatArray
from gazempc_ros import parameters
from gazempc_ros.actions import HeadActions
from gazempc_ros.markers import Moments

_RETRY_S = 2.0
_RHYTHMS = ("listening", "speaking", "told")
_OWN = {
    "autostart": (True, "Configure and activate without a lifecycle manager, and retry until the robot replies"),
    "goal_tolerance_rad": (0.03, "Angle within which a goal of point_head or look_at is reached"),
    "log": ("", "File .npz for the log of the last minutes, written when the node is deactivated; empty for none"),
    "neck_frame": ("gaze_neck", "Name of the neck's base frame in tf, for the markers"),
}


class GazeNode(Node):
    """The node."""

    def __init__(self) -> None:
        super().__init__("gaze")
        for name, (default, text) in _OWN.items():
            self.declare_parameter(name, default, ParameterDescriptor(description=text))
        parameters.declare(self)
        self.add_on_set_parameters_callback(self._may_set)
        self.gaze: Gaze | None = None
        self._prepared: Gaze | None = None
        self._moments = Moments()
        self._io: Ros2Node | None = None
        self._actions: HeadActions | None = None
        self._made: list[Any] = []
        self._latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._retry = self.create_timer(_RETRY_S, self._start) if self.get_parameter("autostart").value else None
        self._state = "unconfigured"

    def _may_set(self, changed: Sequence[Parameter]) -> SetParametersResult:
        if self._state == "unconfigured" or all(each.name == "use_sim_time" for each in changed):
            return SetParametersResult(successful=True)
        return SetParametersResult(
            successful=False, reason="set while the node is unconfigured: deactivate and cleanup first, then configure"
        )

    def start(self) -> None:
        """Configure and activate, according to the parameter ``autostart``."""
        if self._retry is not None:
            self._start()

    def _start(self) -> None:
        if self._state == "unconfigured":
            self.trigger_configure()
        if self._state == "inactive":
            self.trigger_activate()
        if self._state == "active" and self._retry is not None:
            self._retry.cancel()

    def _make(self) -> Gaze:
        arguments, settings = parameters.read(self)
        neck, robot = arguments.pop("neck"), arguments.pop("robot")
        return Gaze(neck, robot, listener=self._moments.take, **arguments, **settings)

    def on_configure(self, _: State) -> TransitionCallbackReturn:
        """Check the parameters."""
        try:
            self._prepared = self._make()
        except GazempcError as error:
            self.get_logger().error(str(error))
            if self._retry is not None:
                self._retry.cancel()  # a retry needs other parameters
            return TransitionCallbackReturn.FAILURE
        self._state = "inactive"
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: State) -> TransitionCallbackReturn:
        """Connect the robot and begin to send commands."""
        try:
            gaze = self._prepared or self._make()
            self._prepared = None
            gaze.__enter__()
        except (GazempcError, OSError) as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        self.gaze = gaze
        self._open(gaze)
        self._state = "active"
        gc.freeze()  # exclude permanent objects from collections, which stop all threads
        self.get_logger().info(f"active: neck {gaze.neck.name}, robot {self.get_parameter('robot').value}")
        return super().on_activate(state)

    def on_deactivate(self, state: State) -> TransitionCallbackReturn:
        """Brake the neck within its limits and disconnect the robot."""
        self._close()
        self._state = "inactive"
        return super().on_deactivate(state)

    def on_cleanup(self, _: State) -> TransitionCallbackReturn:
        """Discard the settings."""
        self._prepared, self._state = None, "unconfigured"
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, _: State) -> TransitionCallbackReturn:
        """Brake the neck within its limits."""
        self._close()
        return TransitionCallbackReturn.SUCCESS

    def _open(self, gaze: Gaze) -> None:
        """Topics, actions and timers of an active node."""
        neck_frame, base_frame = self.get_parameter("neck_frame").value, gaze.settings.options.ros2.base_frame
        make = self._made.append
        make((self.destroy_subscription, self.create_subscription(String, "~/attend", self._attend, 10)))
        make((self.destroy_subscription, self.create_subscription(String, "~/look_away", self._look_away, 10)))
        markers = self.create_publisher(MarkerArray, "~/markers", 1)
        diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 1)
        make((self.destroy_publisher, markers))
        make((self.destroy_publisher, diagnostics))

        def show() -> None:
            if markers.get_subscription_count():
                stamp = self.get_clock().now().to_msg()
                markers.publish(self._moments.markers(gaze.neck, neck_frame, stamp))

        def diagnose() -> None:
            stamp = self.get_clock().now().to_msg()
            name = self.get_fully_qualified_name()
            diagnostics.publish(self._moments.diagnostics(name, stamp, gaze.observations, gaze.warnings))

        make((self.destroy_timer, self.create_timer(0.1, show)))
        make((self.destroy_timer, self.create_timer(1.0, diagnose)))
        if base_frame is not None:
            static = self.create_publisher(TFMessage, "/tf_static", self._latched)
            make((self.destroy_publisher, static))
            static.publish(TFMessage(transforms=[self._neck_in(gaze, base_frame, neck_frame)]))
        self._io = Ros2Node("gaze_tf")
        tolerance_rad = float(self.get_parameter("goal_tolerance_rad").value)
        tf = TfListener(self._io)
        self._actions = HeadActions(self, lambda: self.gaze, tf, base_frame or neck_frame, gaze.to_base, tolerance_rad)

    def _close(self) -> None:
        if self._actions is not None:
            self._actions.close()
            self._actions = None
        for destroy, made in self._made:
            destroy(made)
        self._made.clear()
        if self._io is not None:
            self._io.close()
            self._io = None
        gaze, self.gaze = self.gaze, None
        if gaze is not None:
            try:
                gaze.__exit__(None, None, None)
            except Exception as error:
                self.get_logger().error(f"the run ended with {type(error).__name__}: {error}")
            if path := self.get_parameter("log").value:
                try:
                    gaze.log().save(path)
                except (OSError, RuntimeError) as error:
                    self.get_logger().error(f"log: {path} is not written: {error}")

    def _neck_in(self, gaze: Gaze, base_frame: str, neck_frame: str) -> TransformStamped:
        """The neck's base frame in tf: the inverse of the mount."""
        origin_m = gaze.to_base(np.zeros(3))
        axes: FloatArray = np.array([gaze.to_base(row) - origin_m for row in np.eye(3)])
        made = TransformStamped(child_frame_id=neck_frame)
        made.header.frame_id, made.header.stamp = base_frame, self.get_clock().now().to_msg()
        moved, turn = made.transform.translation, made.transform.rotation
        moved.x, moved.y, moved.z = map(float, -axes @ origin_m)
        turn.x, turn.y, turn.z, turn.w = map(float, Rotation.from_matrix(axes).as_quat())
        return made

    def _attend(self, message: String) -> None:
        if self.gaze is not None:
            self.gaze.attend_to(message.data or None)

    def _look_away(self, message: String) -> None:
        if message.data not in _RHYTHMS and message.data != "thinking":
            self.get_logger().warning(f"look_away {message.data!r}: accepted: thinking, {', '.join(_RHYTHMS)}")
        elif self.gaze is not None:
            self.gaze.think() if message.data == "thinking" else self.gaze.look_away(message.data)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; then brake the neck."""
    before_other_programs()
    # Handlers of rclpy would end the middleware before the neck is braked.
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    stop = threading.Event()
    with stopped_by_signals(stop):
        node, executor = GazeNode(), SingleThreadedExecutor()
        executor.add_node(node)
        try:
            node.start()
            while not stop.is_set():
                executor.spin_once(timeout_sec=0.2)
        finally:
            node._close()
            executor.shutdown()
            node.destroy_node()
            rclpy.shutdown()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
