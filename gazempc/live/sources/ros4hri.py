"""People as ROS4HRI trackers tell them: frames ``face_<id>`` and ``head_<id>`` in ``/tf``, lists of who is tracked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from gazempc.live.sources.source import Arrived, SourceError
from gazempc.recordings.readers.bag_axes import forward
from gazempc.recordings.readers.bag_frames import Poses
from gazempc.ros2.node import Ros2Node, Subscription
from gazempc.ros2.wire import Ros2Network, WireError, stamp_to_loop_s
from gazempc.types import Sighting
from predictors import HeadObservation

_NODE_NAME = "gazempc_people"
_TF, _TRACKED = ("/tf", "tf2_msgs/msg/TFMessage"), ("/humans/faces/tracked", "hri_msgs/msg/IdsList")
# Between the eyes, x out of the face, z up (REP 155).
_PREFIXES = ("face_", "head_")


class Ros4HriPeople:
    """Takes everybody's head from ``/tf``, over Zenoh as rmw_zenoh does; each with the tracker's id.

    Positions are in the frame that the transforms are stated in, which is the sensor's: optical axes are turned to x
    forward, and the mount says where it is. Static transforms are not followed. A face that the tracker's list does not
    name is left out: some trackers go on sending the last pose of a face that they lost.

    Args:
        clock_s: The loop's clock, seconds.
        to_loop_s: Converts Unix time in seconds to the loop's clock.
        network: Router, domain and release of ROS 2.
    """

    def __init__(
        self,
        clock_s: Callable[[], float],
        to_loop_s: Callable[[float], float],
        network: Ros2Network | None = None,
    ) -> None:
        self._clock_s, self._to_loop_s = clock_s, to_loop_s
        self._network = network or Ros2Network()
        self._node: Ros2Node | None = None
        self._transforms: Subscription | None = None
        self._lists: Subscription | None = None
        self._tracked: frozenset[str] | None = None

    def open(self) -> None:
        """See `gazempc.live.sources.source.Source.open`; does not wait until somebody sends."""
        if self._node is not None:
            return
        try:
            self._node = Ros2Node(_NODE_NAME, self._network)
            self._transforms = self._node.subscription(*_TF)
            self._lists = self._node.subscription(*_TRACKED)
        except WireError as error:
            self.close()
            raise SourceError(f"ROS4HRI: {error}") from None

    def poll(self) -> Arrived:
        """See `gazempc.live.sources.source.Source.poll`."""
        if self._transforms is None or self._lists is None:
            return Arrived()
        sightings: list[Sighting] = []
        problems: list[str] = []
        now_s = self._clock_s()
        try:
            for message in self._lists.take():
                if isinstance(message, WireError):
                    problems.append(f"{_TRACKED[0]}: {message}")
                else:
                    self._tracked = frozenset(message.ids)
            for message in self._transforms.take():
                if isinstance(message, WireError):
                    problems.append(f"{_TF[0]}: {message}")
                    continue
                for transform in message.transforms:
                    try:
                        seen = self._observation(transform, now_s)
                    except ValueError as error:
                        problems.append(f"{_TF[0]}, {transform.child_frame_id}: {error}")
                    else:
                        sightings += [] if seen is None else [Sighting(now_s, seen)]
        except WireError as error:
            problems.append(str(error))
        return Arrived(tuple(sightings), tuple(problems))

    @property
    def finished(self) -> bool:
        """False: nobody can know that nothing more will be sent."""
        return False

    def close(self) -> None:
        """See `gazempc.live.sources.source.Source.close`."""
        if self._node is not None:
            self._node.close()
        self._node = self._transforms = self._lists = None

    def _observation(self, transform: Any, now_s: float) -> HeadObservation | None:
        """The head that a transform shows; None where it shows none, or one that is not tracked any more."""
        child, parent = transform.child_frame_id, transform.header.frame_id
        prefix = next((prefix for prefix in _PREFIXES if child.startswith(prefix)), None)
        # A robot has heads, too, as links of a chain: `head_1_link`. Ids of people have no underscore.
        person_id = "" if prefix is None else child.removeprefix(prefix)
        if prefix is None or not person_id.isalnum():
            return None
        if prefix == "face_" and self._tracked is not None and person_id not in self._tracked:
            return None
        place, turn = transform.transform.translation, transform.transform.rotation
        position_m, quat_wxyz = np.array([[place.x, place.y, place.z]]), np.array([[turn.w, turn.x, turn.y, turn.z]])
        captured_s = stamp_to_loop_s(transform.header.stamp, self._to_loop_s, now_s)
        poses, _ = forward(parent, Poses(np.array([captured_s]), np.zeros(1), position_m, quat_wxyz))
        return HeadObservation(captured_s, poses.position_m[0], poses.quat_wxyz[0], person_id=person_id)
