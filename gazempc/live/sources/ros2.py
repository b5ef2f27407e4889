"""A person's head from a ROS 2 topic of poses."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from gazempc.live.sources.source import Arrived, SourceError
from gazempc.ros2.node import Ros2Node
from gazempc.ros2.topics import Subscription
from gazempc.ros2.wire import PoseType, Ros2Network, WireError, stamp_to_loop_s, topic_name
from gazempc.types import Sighting
from predictors import HeadObservation

# Any frame, also an optical one: the axes of its positions are known.
ANY_FRAME = "*"
_NODE_NAME = "gazempc_person"  # this program in the graph of ROS 2
_COVARIANCE_SHAPE = (6, 6)  # x, y, z, and turns about x, y, z
_YAW = 5


class Ros2Person:
    """Takes poses in, over Zenoh as rmw_zenoh does: ``geometry_msgs/msg/PoseStamped``, or the one with covariance.

    Positions are metres in the sensor's frame, x forward, y left, z up; the stamp is the time of capture. When the
    router goes, that is a problem in the next `poll`, and Zenoh connects again in the background.

    Args:
        topic: Where the head's poses are.
        clock_s: The loop's clock, seconds.
        to_loop_s: Converts Unix time in seconds to the loop's clock.
        network: Router, domain and release of ROS 2.
        pose_type: Type of the messages. What a covariance has of zeros is taken for not known, as is usual in ROS.
        frame_id: The frame that every pose must be in; None to take any but optical frames, whose axes are others;
            `ANY_FRAME` to take these, too.
        use_orientation: Whether the poses' orientation is the head's (x to where the face looks); else it is left out.

    Raises:
        SettingsError: If ROS 2 allows no such topic.
    """

    def __init__(
        self,
        topic: str,
        clock_s: Callable[[], float],
        to_loop_s: Callable[[float], float],
        network: Ros2Network | None = None,
        pose_type: PoseType = "geometry_msgs/msg/PoseStamped",
        frame_id: str | None = None,
        use_orientation: bool = True,
    ) -> None:
        self._topic = topic_name(topic)
        self._clock_s = clock_s
        self._to_loop_s = to_loop_s
        self._network = network or Ros2Network()
        self._pose_type = pose_type
        self._frame_id = frame_id
        self._use_orientation = use_orientation
        self._node: Ros2Node | None = None
        self._poses: Subscription | None = None

    def open(self) -> None:
        """See `gazempc.live.sources.source.Source.open`; does not wait until somebody sends."""
        if self._node is not None:
            return
        try:
            self._node = Ros2Node(_NODE_NAME, self._network)
            self._poses = self._node.subscription(self._topic, self._pose_type)
        except WireError as error:
            self.close()
            raise SourceError(f"ROS 2 topic {self._topic}: {error}") from None

    def poll(self) -> Arrived:
        """See `gazempc.live.sources.source.Source.poll`."""
        if self._node is None or self._poses is None:
            return Arrived()
        sightings: list[Sighting] = []
        problems: list[str] = []
        if lost := self._node.lost_router():
            problems.append(lost)
        now_s = self._clock_s()
        try:
            for message in self._poses.take():
                try:
                    sightings.append(Sighting(now_s, self._observation(message, now_s)))
                except ValueError as error:
                    problems.append(f"{self._topic}: {error}")
        except WireError as error:
            problems.append(f"{self._topic}: {error}")
        return Arrived(tuple(sightings), tuple(problems))

    @property
    def finished(self) -> bool:
        """False: nobody can know that nothing more will be sent on a topic."""
        return False

    def close(self) -> None:
        """See `gazempc.live.sources.source.Source.close`."""
        if self._node is not None:
            self._node.close()
        self._node = self._poses = None

    def _observation(self, message: Any, now_s: float) -> HeadObservation:
        if isinstance(message, WireError):
            raise message
        frame_id = message.header.frame_id
        if self._frame_id not in (None, ANY_FRAME, frame_id):
            raise WireError(f"a pose is in the frame {frame_id!r}, expected is {self._frame_id!r}")
        if self._frame_id is None and frame_id.endswith("optical_frame"):
            raise WireError(
                f"a pose is in the frame {frame_id!r}, whose z points forward: needed is x forward, z up; for "
                "optical axes say --mount.axes optical"
            )
        pose, covariance = message.pose, np.zeros(_COVARIANCE_SHAPE)
        if self._pose_type == "geometry_msgs/msg/PoseWithCovarianceStamped":
            pose, covariance = pose.pose, np.asarray(pose.covariance).reshape(_COVARIANCE_SHAPE)
        position, turn = pose.position, pose.orientation
        quat_wxyz = np.array([turn.w, turn.x, turn.y, turn.z])
        # All zeros is how ROS says that there is none.
        oriented = self._use_orientation and bool(quat_wxyz.any())
        yaw_variance_rad2 = float(covariance[_YAW, _YAW])
        if oriented and not 0.0 <= yaw_variance_rad2 < np.inf:
            raise WireError(f"the variance of a pose's yaw is {yaw_variance_rad2}: needed is 0 (not known) or more")
        return HeadObservation(
            capture_time_s=stamp_to_loop_s(message.header.stamp, self._to_loop_s, now_s),
            head_position_base_m=np.array([position.x, position.y, position.z]),
            head_quat_wxyz=quat_wxyz if oriented else None,
            position_covariance_m2=covariance[:3, :3] if covariance[:3, :3].any() else None,
            head_yaw_sd_rad=math.sqrt(yaw_variance_rad2) if oriented and yaw_variance_rad2 else None,
        )
