"""The actions PointHead and LookAt: a goal outranks attention until it ends or a newer one replaces it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from control_msgs.action import PointHead
from geometry_msgs.msg import PointStamped
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from gazempc.live.gaze import Gaze
from gazempc.live.sources.ros2 import TfListener
from gazempc.neck.kinematics import gaze_error_rad, gaze_ray, head_angles_rad, look_at_rad
from gazempc.neck.spec import Geometry
from gazempc.ros2.messages import Ros2Error, stamp_s
from gazempc.types import FloatArray

_PERIOD_S = 0.05
# Timeout of the transforms of a goal.
_TF_TIMEOUT_S = 1.0
# Joint speed that counts as rest, and time at rest off the target after which it is unreachable.
_STILL_RAD_S, _SETTLING_S = 0.05, 1.0


def tilt_frame(geometry: Geometry, joints_rad: FloatArray) -> FloatArray:
    """Pose of the frame that turns with the tilt axis in the base frame, shape (4, 4)."""
    pan, tilt = head_angles_rad(joints_rad)
    turned = Rotation.from_euler("z", pan)
    pose = np.eye(4)
    pose[:3, :3] = (turned * Rotation.from_euler("y", -tilt)).as_matrix()
    pose[:3, 3] = turned.apply(geometry.tilt_axis_in_pan_m)
    return pose


def place_for_gaze(geometry: Geometry, target_m: FloatArray, origin_m: FloatArray, axis: FloatArray) -> FloatArray:
    """The gaze target that makes another axis of the head point at a target.

    Args:
        geometry: The neck's geometry.
        target_m: The target in the base frame, shape (3,), metres.
        origin_m: Origin of the axis in the frame of the tilt axis, shape (3,), metres.
        axis: The axis there, shape (3,), unit.

    Returns:
        The place, shape (3,), metres, base frame.
    """

    def miss(angles_rad: FloatArray) -> FloatArray:
        pose = tilt_frame(geometry, angles_rad)
        to = target_m - (pose[:3, :3] @ origin_m + pose[:3, 3])
        return np.asarray(np.cross(pose[:3, :3] @ axis, to) / max(float(np.linalg.norm(to)), 1e-6))

    start_rad = look_at_rad(geometry, target_m) - [math.atan2(axis[1], axis[0]), math.asin(np.clip(axis[2], -1, 1))]
    eye_m, direction = gaze_ray(geometry, least_squares(miss, start_rad).x)
    return np.asarray(eye_m + max(float(np.linalg.norm(target_m)), 1.0) * direction)


@dataclass
class _Active:
    """The active goal."""

    handle: Any
    server: ActionServer
    target: PointStamped
    began_s: float
    frame: str = ""
    axis: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    min_duration_s: float = 0.0
    max_velocity_rad_s: float = math.inf
    sent_m: FloatArray | None = None
    moves_until_s: float = 0.0
    still_since_s: float | None = None


class _GoalServer(ActionServer):  # type: ignore[misc]
    """An action server whose goals are executed elsewhere: `execute` of a goal only marks it as executing.

    An execution callback that awaits the end makes the executor of rclpy spin.
    """

    def notify_execute(self, goal_handle: Any, execute_callback: Callable[[Any], Any] | None) -> None:
        """Run a callback that ends the goal; nothing without one."""
        if execute_callback is not None:
            super().notify_execute(goal_handle, execute_callback)


class HeadActions:
    """Action servers of a node.

    Args:
        node: The node.
        gaze: Returns the running `Gaze`; None while the node is inactive.
        tf: The tree of frames.
        base_frame: tf frame of the positions on the robot.
        to_base: From that frame to the neck's base frame, shape (3,), metres.
        tolerance_rad: Angle within which a goal is reached, radians.
    """

    def __init__(
        self,
        node: Node,
        gaze: Callable[[], Gaze | None],
        tf: TfListener,
        base_frame: str,
        to_base: Callable[[FloatArray], FloatArray],
        tolerance_rad: float,
    ) -> None:
        self._node, self._gaze, self._tf = node, gaze, tf
        self._base_frame, self._to_base, self._tolerance_rad = base_frame, to_base, tolerance_rad
        self._active: _Active | None = None
        self._servers = [self._serve(PointHead, "~/point_head")]
        try:
            from hri_actions_msgs.action import LookAt  # noqa: PLC0415
        except ImportError:
            node.get_logger().info("no action look_at: hri_actions_msgs is not installed")
        else:
            self._servers.append(self._serve(LookAt, "~/look_at"))
        self._timer = node.create_timer(_PERIOD_S, self._step)

    def _serve(self, kind: Any, name: str) -> ActionServer:
        server = _GoalServer(
            self._node,
            kind,
            name,
            lambda handle: kind.Result(),
            goal_callback=self._judge,
            handle_accepted_callback=lambda handle: self._begin(handle, server),
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )
        return server

    def close(self) -> None:
        """End the goal and the servers."""
        self._end("abort", "the node is no longer active")
        self._node.destroy_timer(self._timer)
        for server in self._servers:
            server.destroy()

    def _judge(self, request: Any) -> GoalResponse:
        target = _target(request)
        numbers = [target.point.x, target.point.y, target.point.z]
        if isinstance(request, PointHead.Goal):
            axis = request.pointing_axis
            numbers += [axis.x, axis.y, axis.z, request.max_velocity]
        why = ""
        if not all(map(math.isfinite, numbers)):
            why = "a number of the goal is not finite"
        elif not target.header.frame_id:
            why = "the target has no frame"
        elif self._gaze() is None:
            why = "the node is not active"
        if why:
            self._node.get_logger().warning(f"goal rejected: {why}")
        return GoalResponse.REJECT if why else GoalResponse.ACCEPT

    def _begin(self, handle: Any, server: ActionServer) -> None:
        """The timer executes a goal, which replaces the previous one."""
        self._end("abort", "a newer goal replaces it")
        handle.execute()
        request = handle.request
        active = _Active(handle, server, _target(request), self._now_s())
        if isinstance(request, PointHead.Goal):
            axis = np.array([request.pointing_axis.x, request.pointing_axis.y, request.pointing_axis.z])
            active.frame = request.pointing_frame.lstrip("/")
            active.axis = axis / np.linalg.norm(axis) if axis.any() else active.axis
            active.min_duration_s = request.min_duration.sec + 1e-9 * request.min_duration.nanosec
            active.max_velocity_rad_s = request.max_velocity if request.max_velocity > 0.0 else math.inf
        # Executed by the timer: at a hundred goals a second the queue of the service must not overflow.
        self._active = active
        self._timer.reset()

    def _now_s(self) -> float:
        return 1e-9 * self._node.get_clock().now().nanoseconds

    def _end(self, how: str, why: str = "") -> None:
        active, self._active = self._active, None
        if active is None:
            return
        if (gaze := self._gaze()) is not None:
            gaze.point(None)
        if why:
            self._node.get_logger().warning(f"goal {how}ed: {why}")

        def finish(handle: Any) -> Any:
            getattr(handle, how)()
            return active.server.action_type.Result()

        active.server.notify_execute(active.handle, finish)

    def _step(self) -> None:
        active, gaze = self._active, self._gaze()
        if active is None or gaze is None:
            self._timer.cancel()
            return
        if active.handle.is_cancel_requested:
            self._end("canceled")
            return
        problems: list[str] = []
        self._tf.listen(problems)
        now_s = self._now_s()
        try:
            target_m = self._in_base(active)
            pointing = self._pointing(active)
        except Ros2Error as error:
            if abs(now_s - active.began_s) > _TF_TIMEOUT_S:
                self._end("abort", str(error))
            return
        joints = gaze.joints
        if joints is None:
            return
        geometry = gaze.neck.geometry
        place_m = target_m
        error_rad = float(gaze_error_rad(geometry, joints.position_rad, target_m))
        if pointing is not None:
            head = np.linalg.inv(tilt_frame(geometry, joints.position_rad)) @ pointing
            place_m = place_for_gaze(geometry, target_m, head[:3, 3], head[:3, :3] @ active.axis)
            axis, to = pointing[:3, :3] @ active.axis, target_m - pointing[:3, 3]
            error_rad = math.atan2(float(np.linalg.norm(np.cross(axis, to))), float(axis @ to))
        still = bool(np.all(np.abs(joints.velocity_rad_s) < _STILL_RAD_S))
        self._send(gaze, active, place_m, pointing is None or still)
        if isinstance(active.handle.request, PointHead.Goal):
            active.handle.publish_feedback(PointHead.Feedback(pointing_angle_error=error_rad))
        if still and error_rad <= self._tolerance_rad and now_s - active.began_s >= active.min_duration_s:
            self._end("succeed")
            return
        active.still_since_s = (active.still_since_s or now_s) if still and now_s > active.moves_until_s else None
        stands_s = 0.0 if active.still_since_s is None else now_s - active.still_since_s
        if stands_s > _SETTLING_S:
            self._end("abort", f"{math.degrees(error_rad):.1f} deg off and at rest: the neck cannot reach the target")

    def _send(self, gaze: Gaze, active: _Active, place_m: FloatArray, is_exact: bool) -> None:
        """Send the position to the loop: at first with its limits, later at changes of the target."""
        lasts_s = active.min_duration_s if active.sent_m is None else 0.0
        if active.sent_m is not None and (not is_exact or float(np.linalg.norm(place_m - active.sent_m)) < 1e-3):
            return
        active.moves_until_s = self._now_s() + gaze.point(place_m, lasts_s, active.max_velocity_rad_s)
        active.sent_m = place_m

    def _in_base(self, active: _Active) -> FloatArray:
        """The target in the base frame, at its stamp or, without one, now."""
        header, point = active.target.header, active.target.point
        stamped = header.stamp.sec or header.stamp.nanosec
        pose = self._tf.transforms.pose(
            header.frame_id.lstrip("/"), self._base_frame, stamp_s(header.stamp) if stamped else None
        )
        placed_m = self._to_base((pose @ [point.x, point.y, point.z, 1.0])[:3])
        if stamped:
            active.target = PointStamped()
            active.target.header.frame_id = self._base_frame
            back_m = (pose @ [point.x, point.y, point.z, 1.0])[:3]
            active.target.point.x, active.target.point.y, active.target.point.z = map(float, back_m)
        return placed_m

    def _pointing(self, active: _Active) -> FloatArray | None:
        """Pose of the pointing frame in the neck's base frame now, shape (4, 4); None for the gaze itself."""
        if not active.frame:
            return None
        pose = self._tf.transforms.pose(active.frame, self._base_frame)
        origin_m = self._to_base(pose[:3, 3])
        axes = [self._to_base(pose[:3, 3] + pose[:3, k]) - origin_m for k in range(3)]
        placed = np.eye(4)
        placed[:3, :3], placed[:3, 3] = np.array(axes).T, origin_m
        return placed


def _target(request: Any) -> PointStamped:
    """The target of either action."""
    found: PointStamped = request.target if hasattr(request, "target") else request.look_goal
    return found
