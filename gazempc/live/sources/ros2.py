"""Sources on ROS 2 topics: a person's head from poses, and cues from points and directions of speech."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple, TypeVar

import numpy as np

from gazempc.live.sources.source import Arrived, Notice, SourceError
from gazempc.loop.events import Event
from gazempc.people.company import Cue, Glance, Sound
from gazempc.robots.options import Ros2Options
from gazempc.ros2.node import Ros2Node, Subscription
from gazempc.ros2.transforms import Moved, Transforms
from gazempc.ros2.wire import (
    PoseType,
    Ros2Network,
    WireError,
    on_loop_clock,
    stamp_s,
    stamp_to_loop_s,
    topic_name,
)
from gazempc.types import FloatArray, Sighting
from predictors import HeadObservation

_T = TypeVar("_T")
# Any frame, also an optical one: the axes of its positions are known.
ANY_FRAME = "*"
_COVARIANCE_SHAPE = (6, 6)  # x, y, z, and turns about x, y, z
_YAW = 5
_POINT = "geometry_msgs/msg/PointStamped"
# A point that is sent again within so long, and is as near to the one before, is the same thing: no new glance.
_SAME_S, _SAME_M = 2.0, 0.3
# A direction is less than a whole turn; what is more is in another unit.
_TURN_RAD = 2.0 * math.pi
# Nothing can be looked at that is in the neck itself.
_NEAREST_M = 0.05
_WAITING_MAX = 64
_TF = "/tf"
# Transforms between a tracker and the robot come from other nodes, which may be this much later.
WAITS_S = 0.2
# Nodes discover each other within less.
_DISCOVERY_S = 3.0


class Ros2Source(ABC):
    """Common part of the sources on ROS 2 topics, over Zenoh as rmw_zenoh does.

    If the router is lost, that is a problem in the next `poll`; Zenoh connects again in the background.

    Args:
        name: Name of the source in messages.
        node_name: Name of this program in the graph of ROS 2.
        clock_s: The loop's clock, seconds.
        to_loop_s: Converts Unix time in seconds to the loop's clock.
        network: Router, domain and release of ROS 2.
    """

    def __init__(
        self,
        name: str,
        node_name: str,
        clock_s: Callable[[], float],
        to_loop_s: Callable[[float], float],
        network: Ros2Network,
    ) -> None:
        self._name, self._node_name, self._network = name, node_name, network
        self._clock_s, self._to_loop_s = clock_s, to_loop_s
        self._node: Ros2Node | None = None

    @abstractmethod
    def _subscribe(self, node: Ros2Node) -> Mapping[str, Subscription]:
        """Subscribe; returns the topics whose senders are watched."""

    @abstractmethod
    def _take_in(self, now_s: float, problems: list[str]) -> tuple[Iterable[Sighting], Iterable[Cue]]:
        """Take in messages; problems are appended. Raises WireError if the session is closed."""

    def open(self) -> None:
        """See `gazempc.live.sources.source.Source.open`; does not wait for a sender."""
        if self._node is not None:
            return
        try:
            self._node = Ros2Node(self._node_name, self._network)
            self._watched = self._subscribe(self._node)
        except WireError as error:
            self.close()
            raise SourceError(f"{self._name}: {error}") from None
        self._silent: set[str] = set()
        self._watch_due_s = self._clock_s() + _DISCOVERY_S

    def poll(self) -> Arrived:
        """See `gazempc.live.sources.source.Source.poll`."""
        if self._node is None:
            return Arrived()
        now_s, lost = self._clock_s(), self._node.lost_router()
        problems = [lost] if lost else []
        sightings: Iterable[Sighting] = ()
        cues: Iterable[Cue] = ()
        try:
            sightings, cues = self._take_in(now_s, problems)
        except WireError as error:
            problems.append(f"{self._name}: {error}")
        return Arrived(tuple(sightings), tuple(problems), self._without_sender(now_s), tuple(cues))

    @property
    def finished(self) -> bool:
        """False: a topic has no end."""
        return False

    def close(self) -> None:
        """See `gazempc.live.sources.source.Source.close`."""
        if self._node is not None:
            self._node.close()
        self._node = None

    def _without_sender(self, now_s: float) -> tuple[Notice, ...]:
        """A notice of topics that have newly no sender; one with a sender that sends nothing is none of them."""
        if now_s < self._watch_due_s:
            return ()
        self._watch_due_s = now_s + _DISCOVERY_S
        silent = {name for name, topic in self._watched.items() if not topic.has_senders}
        newly, self._silent = sorted(silent - self._silent), silent
        if not newly:
            return ()
        text = ", ".join(f"{name} as {self._watched[name].described}" for name in newly)
        return (Notice(Event.NO_SENDER, f"no node sends on {text}: is it active, in this domain?", 0),)


def used(messages: Iterable[Any], take: Callable[[Any], _T | None], topic: str, problems: list[str]) -> list[_T]:
    """Results of messages that can be used; for others the problem is appended with the topic's name."""
    found: list[_T] = []
    for message in messages:
        try:
            if isinstance(message, WireError):
                raise message
            result = take(message)
        except ValueError as error:
            problems.append(f"{topic}: {error}")
        else:
            found += [] if result is None else [result]
    return found


class TfListener:
    """The tree of frames, kept by ``/tf`` and ``/tf_static``.

    Args:
        node: Listens.

    Attributes:
        transforms: The tree.
        topics: The topic of frames that move.
    """

    def __init__(self, node: Ros2Node) -> None:
        kind = "tf2_msgs/msg/TFMessage"
        self.transforms = Transforms()
        self.topics = {_TF: node.subscription(_TF, kind)}
        self._fixed = node.subscription("/tf_static", kind, latched=True)

    def listen(self, problems: list[str]) -> list[Moved]:
        """Take in what has come.

        Args:
            problems: Gets what cannot be used, and why.

        Returns:
            Frames that have moved, in the order of the messages.

        Raises:
            WireError: If the session is closed.
        """
        moved: list[Moved] = []
        for topic, subscription, fixed in (("/tf_static", self._fixed, True), (_TF, self.topics[_TF], False)):
            messages = used(subscription.take(), lambda message: message.transforms, topic, problems)
            for newly, unusable in (self.transforms.take(transforms, fixed) for transforms in messages):
                moved += newly
                problems += [f"{topic}, {problem}" for problem in unusable]
        return moved


class Ros2Person(Ros2Source):
    """A person's head from ``geometry_msgs/msg/PoseStamped``, or the type with covariance.

    Positions are metres in the sensor's frame, x forward, y left, z up; the stamp is the time of capture.

    Args:
        topic: Topic of the head's poses.
        clock_s: The loop's clock, seconds.
        to_loop_s: Converts Unix time in seconds to the loop's clock.
        network: Router, domain and release of ROS 2.
        pose_type: Type of the messages. Zeros of a covariance are taken for unknown, as is usual in ROS.
        frame_id: The frame that every pose must be in; None to take any but optical frames, whose axes are others;
            `ANY_FRAME` to take these, too.

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
    ) -> None:
        self._topic = topic_name(topic)
        name = f"ROS 2 topic {self._topic}"
        super().__init__(name, "gazempc_person", clock_s, to_loop_s, network or Ros2Network())
        self._pose_type, self._frame_id = pose_type, frame_id

    def _subscribe(self, node: Ros2Node) -> Mapping[str, Subscription]:
        self._poses = node.subscription(self._topic, self._pose_type)
        return {self._topic: self._poses}

    def _take_in(self, now_s: float, problems: list[str]) -> tuple[Iterable[Sighting], Iterable[Cue]]:
        def sighting(message: Any) -> Sighting:
            return Sighting(now_s, self._observation(message, now_s))

        return used(self._poses.take(), sighting, self._topic, problems), ()

    def _observation(self, message: Any, now_s: float) -> HeadObservation:
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
        # All zeros: none, by convention of ROS.
        oriented = bool(quat_wxyz.any())
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


class _Point(NamedTuple):
    """A point whose frame may not be known yet: its time (None for now), and until when that is waited for."""

    frame: str
    place_m: FloatArray
    time_s: float | None
    until_s: float


class Ros2Cues(Ros2Source):
    """Listens to the topics of cues that the options name.

    Args:
        clock_s: The loop's clock, seconds.
        to_loop_s: Converts Unix time in seconds to the loop's clock.
        options: Network, topics and frames. A point needs a base frame.
        to_base: From the base frame of the options to the neck's, both shape (3,), metres.

    Raises:
        SettingsError: If ROS 2 allows no such topic.
    """

    def __init__(
        self,
        clock_s: Callable[[], float],
        to_loop_s: Callable[[float], float],
        options: Ros2Options,
        to_base: Callable[[FloatArray], FloatArray],
    ) -> None:
        self._options, self._to_base = options, to_base
        self._point_topic = "" if options.point_topic is None else topic_name(options.point_topic)
        self._sound_topic = "" if options.sound_topic is None else topic_name(options.sound_topic)
        name = self._point_topic or self._sound_topic
        super().__init__(name, "gazempc_cues", clock_s, to_loop_s, options.network)
        self._tf: TfListener | None = None
        self._topics: dict[str, Subscription] = {}
        self._waiting: deque[_Point] = deque(maxlen=_WAITING_MAX)
        self._pointed_s, self._pointed_m = -math.inf, np.full(3, np.inf)

    def _subscribe(self, node: Ros2Node) -> Mapping[str, Subscription]:
        kinds = {self._point_topic: _POINT, self._sound_topic: self._options.sound_type}
        self._topics = {topic: node.subscription(topic, kind) for topic, kind in kinds.items() if topic}
        self._waiting.clear()
        if self._options.base_frame is None:
            return self._topics
        self._tf = TfListener(node)
        return {**self._topics, **self._tf.topics}

    def _take_in(self, now_s: float, problems: list[str]) -> tuple[Iterable[Sighting], Iterable[Cue]]:
        if self._tf is not None:
            self._tf.listen(problems)
        cues: list[Cue] = []
        if self._sound_topic:
            sounds = self._topics[self._sound_topic].take()
            cues += used(sounds, lambda message: self._sound(message, now_s), self._sound_topic, problems)
        if self._point_topic:
            points = self._topics[self._point_topic].take()
            waiting = [self._waiting.popleft() for _ in range(len(self._waiting))]
            cues += used(points, lambda message: self._point(message, now_s), self._point_topic, problems)
            cues += used(waiting, lambda point: self._glance(point, now_s), self._point_topic, problems)
        return (), cues

    def _sound(self, message: Any, now_s: float) -> Sound:
        in_degrees = self._options.sound_type == "std_msgs/msg/Int32"
        azimuth_rad = math.radians(message.data) if in_degrees else float(message.data)
        if not abs(azimuth_rad) <= _TURN_RAD:
            wanted = "degrees, at most 360" if in_degrees else "radians, at most a whole turn"
            raise WireError(f"a direction of sound is {message.data}: needed are {wanted}, positive to the left")
        if self._options.sound_frame is None or self._options.base_frame is None or self._tf is None:
            return Sound(now_s, azimuth_rad)
        pose = self._tf.transforms.pose(self._options.sound_frame, self._options.base_frame)
        ahead = pose[:3, :3] @ np.array([math.cos(azimuth_rad), math.sin(azimuth_rad), 0.0])
        x, y, _ = self._to_base(ahead) - self._to_base(np.zeros(3))
        return Sound(now_s, math.atan2(y, x))

    def _point(self, message: Any, now_s: float) -> Glance | None:
        frame, point, stamp = message.header.frame_id.lstrip("/"), message.point, message.header.stamp
        place_m = np.array([point.x, point.y, point.z])
        if not frame:
            raise WireError("a point's header names no frame")
        if not np.isfinite(place_m).all():
            raise WireError(f"a point is at {place_m.tolist()}: needed are finite metres")
        # Without a stamp: now, as is usual in tf.
        time_s = stamp_s(stamp) if stamp.sec or stamp.nanosec else None
        if time_s is not None:
            on_loop_clock(time_s, self._to_loop_s, now_s)
        return self._glance(_Point(frame, place_m, time_s, now_s + WAITS_S), now_s)

    def _glance(self, point: _Point, now_s: float) -> Glance | None:
        base_frame = self._options.base_frame
        if base_frame is None or self._tf is None:
            raise WireError("a point needs options.ros2.base_frame")
        try:
            pose = self._tf.transforms.pose(point.frame, base_frame, point.time_s)
        except WireError as error:
            if now_s >= point.until_s:
                raise WireError(f"a point is in the frame {point.frame!r}: {error}") from None
            self._waiting.append(point)
            return None
        target_m = self._to_base((pose @ np.append(point.place_m, 1.0))[:3])
        if np.linalg.norm(target_m) < _NEAREST_M:
            raise WireError(f"a point is in the neck itself, at {target_m.round(3).tolist()} m of its base")
        again = now_s - self._pointed_s < _SAME_S and math.dist(target_m, self._pointed_m) < _SAME_M
        self._pointed_s = now_s
        if again:
            return None
        self._pointed_m = target_m
        return Glance(target_m, self._options.point_lasts_s)
