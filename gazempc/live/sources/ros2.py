"""Sources on ROS 2 topics: the common part, and a person's head from poses."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.live.mount import moved
from gazempc.live.sources.source import Arrived, Notice, SourceError
from gazempc.loop.events import Event
from gazempc.people.company import Cue
from gazempc.robots.options import Ros2Options
from gazempc.ros2.messages import FrameError, Ros2Error, Transforms, on_loop_clock, stamp_s, topic_name
from gazempc.ros2.node import MakeNode, Ros2Node, Subscription
from gazempc.types import FloatArray, Sighting
from predictors import HeadObservation

_T = TypeVar("_T")
_COVARIANCE_SHAPE = (6, 6)  # x, y, z, and turns about x, y, z
_YAW = 5
# Length of the queue; it grows only while frames of tf are missing.
_WAITING_MAX = 256
_TF = "/tf"
# Timeout for transforms between tracker and robot, sent by other nodes.
_WAITS_S = 0.2
# Name of a node that is not discovered completely, in rmw_dds_common.
_UNNAMED = "_NODE_NAME_UNKNOWN_"
# Nodes discover each other within less.
_DISCOVERY_S = 3.0


@dataclass(frozen=True)
class Ros2Input:
    """Clocks, options and node of a source on ROS 2 topics.

    Attributes:
        clock_s: The loop's clock, seconds.
        to_loop_s: Converts Unix time in seconds to the loop's clock.
        options: Topics, types, frames and clock.
        make_node: Makes the node.
    """

    clock_s: Callable[[], float]
    to_loop_s: Callable[[float], float]
    options: Ros2Options
    make_node: MakeNode = Ros2Node


class Ros2Source(ABC):
    """Common part of the sources on ROS 2 topics.

    Args:
        given: Clocks, options and node.
        name: Name of the source in messages.
        node_name: Name of this program in the graph of ROS 2.
        uses_tf: Whether it listens to the frames of tf; default: if the options name a base frame.
    """

    def __init__(self, given: Ros2Input, name: str, node_name: str, uses_tf: bool = False) -> None:
        self._given, self._options, self._name, self._node_name = given, given.options, name, node_name
        self._uses_tf = uses_tf or given.options.base_frame is not None
        self._node: Ros2Node | None = None
        self._tf: TfListener | None = None
        self._transforms = Transforms()
        # Time and unusable messages of the present poll.
        self._now_s, self._problems = 0.0, list[str]()
        # Messages with frames that may be unknown yet, each with its timeout.
        self._waiting: list[tuple[Any, float]] = []

    def _placed(self, new: Iterable[Any], take: Callable[[Any], _T | None], named: Callable[[Any], str]) -> list[_T]:
        """As `_used`, for new and pending messages; a message in a frame unknown to tf remains pending."""
        waiting = [*self._waiting, *((message, self._now_s + _WAITS_S) for message in new)][-_WAITING_MAX:]
        self._waiting = []
        return [found for message, until_s in waiting for found in self._used([message], take, named(message), until_s)]

    def _used(
        self, messages: Iterable[Any], take: Callable[[Any], _T | None], topic: str, until_s: float = -math.inf
    ) -> list[_T]:
        """Results of messages that can be used; the others are problems, or wait until a time for a frame of tf."""
        found: list[_T] = []
        for message in messages:
            try:
                result = take(message)
            except ValueError as error:
                if isinstance(error, FrameError) and self._now_s < until_s:
                    self._waiting.append((message, until_s))
                else:
                    self._problems.append(f"{topic}: {error}")
            else:
                found += [] if result is None else [result]
        return found

    def _loop_s(self, ros_s: float) -> float:
        """A stamp on the loop's clock, seconds. Raises Ros2Error if the clocks cannot agree."""
        unix_s = ros_s if self._node is None else self._node.unix_s(ros_s)
        return on_loop_clock(unix_s, self._given.to_loop_s, self._now_s)

    @abstractmethod
    def _subscribe(self, node: Ros2Node) -> Mapping[str, Subscription]:
        """Subscribe; returns the topics with monitored publishers."""

    @abstractmethod
    def _process(self) -> tuple[Iterable[Sighting], Iterable[Cue]]:
        """Process messages, after those of tf. Raises Ros2Error if the node is closed."""

    def open(self) -> None:
        """See `gazempc.live.sources.source.Source.open`; does not wait for a sender."""
        try:
            self._node = self._given.make_node(self._node_name, self._options.use_sim_time)
            self._watched = dict(self._subscribe(self._node))
            if self._uses_tf:
                self._tf = TfListener(self._node)
                self._transforms = self._tf.transforms
                self._watched |= self._tf.topics
        except Ros2Error as error:
            self.close()
            raise SourceError(f"{self._name}: {error}") from None
        self._waiting.clear()
        self._silent, self._several = set[str](), set[str]()
        self._watch_due_s = self._given.clock_s() + _DISCOVERY_S

    def poll(self) -> Arrived:
        """See `gazempc.live.sources.source.Source.poll`."""
        if self._node is None:
            return Arrived()
        self._now_s, self._problems = self._given.clock_s(), []
        try:
            if self._tf is not None:
                self._tf.listen(self._problems)
            sightings, cues = self._process()
        except Ros2Error as error:
            sightings, cues = (), ()
            self._problems.append(f"{self._name}: {error}")
        return Arrived(tuple(sightings), tuple(self._problems), self._watch_senders(), tuple(cues))

    @property
    def finished(self) -> bool:
        """False: a topic has no end."""
        return False

    def close(self) -> None:
        """See `gazempc.live.sources.source.Source.close`."""
        if self._node is not None:
            self._node.close()
        self._node = None

    def _watch_senders(self) -> tuple[Notice, ...]:
        """Notices of topics that newly have no publisher, or newly have several (allowed for tf)."""
        if self._now_s < self._watch_due_s:
            return ()
        self._watch_due_s = self._now_s + _DISCOVERY_S
        senders = {name: topic.senders for name, topic in self._watched.items()}
        silent = {name for name, nodes in senders.items() if not nodes}
        # A new end is in the graph before the name of its node: the notice waits until every name is known.
        unnamed = {name for name, nodes in senders.items() if any(_UNNAMED in node for node in nodes)}
        several = {name for name, nodes in senders.items() if len(nodes) > 1 and name != _TF}
        several = several - unnamed | self._several & unnamed
        newly, twice = sorted(silent - self._silent), sorted(several - self._several)
        self._silent, self._several = silent, several
        notices: list[Notice] = []
        if newly:
            text = ", ".join(self._watched[name].described for name in newly)
            notices.append(Notice(Event.NO_SENDER, f"no node sends on {text}: is it active, in this domain?", 0))
        if twice:
            text = ", ".join(f"{name} ({' and '.join(sorted(senders[name]))})" for name in twice)
            notices.append(Notice(Event.SEVERAL_SENDERS, f"several nodes send on {text}: stop all but one", 0))
        return tuple(notices)


class TfListener:
    """The tree of frames, kept by ``/tf`` and ``/tf_static``.

    Args:
        node: Listens.

    Attributes:
        transforms: The tree.
        topics: The topic of frames that move.
        moved: Frames that have moved lately, each with its stamp, seconds of ROS time, in the order of the messages.
    """

    def __init__(self, node: Ros2Node) -> None:
        kind = "tf2_msgs/msg/TFMessage"
        self.transforms = Transforms()
        self.topics = {_TF: node.subscription(_TF, kind)}
        self._fixed = node.subscription("/tf_static", kind, latched=True)

    def listen(self, problems: list[str]) -> None:
        """Process new messages.

        Args:
            problems: Receives invalid transforms with the reason.

        Raises:
            Ros2Error: If the node is closed.
        """
        self.moved: list[tuple[str, float]] = []
        for topic, subscription, fixed in (("/tf_static", self._fixed, True), (_TF, self.topics[_TF], False)):
            for message in subscription.take():
                newly, unusable = self.transforms.take(message.transforms, fixed)
                self.moved += newly
                problems += [f"{topic}, {problem}" for problem in unusable]


class _Head(NamedTuple):
    """A head in the frame of its message."""

    position_m: FloatArray
    quat_wxyz: FloatArray | None = None
    covariance: FloatArray | None = None
    person_id: str | None = None
    confidence: float | None = None


class Ros2Person(Ros2Source):
    """Heads from a topic of poses, points or detections; the stamp is the time of capture.

    Positions are in metres. Without a base frame in the options they are in the sensor's frame (x forward, y left, z
    up), whose pose the mount gives; with it, tf brings any frame into the base frame. Zeros of a covariance mean
    unknown, by convention of ROS.

    Args:
        topic: Topic of the heads.
        given: Clocks, options and node.
        optical: Whether frames with optical axes are accepted: the mount converts them.

    Raises:
        SettingsError: If ROS 2 allows no such topic.
    """

    def __init__(self, topic: str, given: Ros2Input, optical: bool = False) -> None:
        self._topic, self._optical = topic_name(topic), optical
        super().__init__(given, f"ROS 2 topic {self._topic}", "gazempc_person")

    def _subscribe(self, node: Ros2Node) -> Mapping[str, Subscription]:
        return {self._topic: node.subscription(self._topic, self._options.pose_type)}

    def _process(self) -> tuple[Iterable[Sighting], Iterable[Cue]]:
        found = self._placed(self._watched[self._topic].take(), self._seen, lambda _: self._topic)
        return [Sighting(self._now_s, observation) for seen in found for observation in seen], ()

    def _seen(self, message: Any) -> list[HeadObservation]:
        """Heads of a message."""
        header = message.header
        time_s = stamp_s(header.stamp)
        captured_s = self._loop_s(time_s)
        frame, base_frame, pose = header.frame_id.lstrip("/"), self._options.base_frame, None
        if base_frame is not None:
            pose = self._transforms.pose(frame, base_frame, time_s)
        elif not self._optical and frame.endswith("optical_frame"):
            raise Ros2Error(
                f"a pose is in the frame {frame!r}, whose z points forward: expected x forward, z up; for optical "
                "axes set --mount.axes optical, or options.ros2.base_frame"
            )
        # Heads of a message are validated individually.
        heads = _heads(message, self._options.pose_type)
        return self._used(heads, lambda head: _observation(head, captured_s, pose), self._topic)


def _heads(message: Any, pose_type: str) -> list[_Head]:
    """Heads of a message of a `PoseType`."""
    if pose_type.endswith("PointStamped"):
        return [_Head(_xyz(message.point))]
    if pose_type.endswith("PoseArray"):
        return [_Head(_xyz(pose.position), _quat_wxyz(pose)) for pose in message.poses]
    if pose_type.endswith("PoseStamped"):
        return [_Head(_xyz(message.pose.position), _quat_wxyz(message.pose))]
    if pose_type.endswith("PoseWithCovarianceStamped"):
        pose = message.pose.pose
        return [_Head(_xyz(pose.position), _quat_wxyz(pose), _covariance(message.pose))]
    heads: list[_Head] = []
    for detection in message.detections:
        best = max(detection.results, key=lambda result: result.hypothesis.score, default=None)
        stated = None if best is None else best.pose
        # Detectors omit either the poses of hypotheses or the box.
        use_box = stated is None or not any(_xyz(stated.pose.position))
        pose = detection.bbox.center if use_box or stated is None else stated.pose
        covariance = None if use_box or stated is None else _covariance(stated)
        score = None if best is None else min(max(float(best.hypothesis.score), 0.0), 1.0)
        heads.append(_Head(_xyz(pose.position), None, covariance, detection.id or None, score))
    return heads


def _xyz(point: Any) -> FloatArray:
    return np.array([point.x, point.y, point.z], dtype=np.float64)


def _quat_wxyz(pose: Any) -> FloatArray | None:
    """The orientation; None for zeros, by convention of ROS."""
    turn = pose.orientation
    quat_wxyz = np.array([turn.w, turn.x, turn.y, turn.z], dtype=np.float64)
    return quat_wxyz if quat_wxyz.any() else None


def _covariance(pose: Any) -> FloatArray:
    return np.asarray(pose.covariance, dtype=np.float64).reshape(_COVARIANCE_SHAPE)


def _observation(head: _Head, captured_s: float, pose: FloatArray | None) -> HeadObservation:
    """An observation of a head, brought into another frame by a pose, shape (4, 4)."""
    quat_wxyz = head.quat_wxyz
    place, yaw_variance_rad2 = None, 0.0
    if head.covariance is not None:
        place = head.covariance[:3, :3] if head.covariance[:3, :3].any() else None
        yaw_variance_rad2 = float(head.covariance[_YAW, _YAW])
        if quat_wxyz is not None and not 0.0 <= yaw_variance_rad2 < np.inf:
            raise Ros2Error(f"the variance of a pose's yaw is {yaw_variance_rad2}: expected 0 (unknown) or more")
    seen = HeadObservation(
        capture_time_s=captured_s,
        head_position_base_m=head.position_m,
        head_quat_wxyz=quat_wxyz,
        position_covariance_m2=place,
        head_yaw_sd_rad=math.sqrt(yaw_variance_rad2) if quat_wxyz is not None and yaw_variance_rad2 else None,
        person_id=head.person_id,
        confidence=head.confidence,
    )
    return seen if pose is None else moved(seen, Rotation.from_matrix(pose[:3, :3]), pose[:3, 3])
