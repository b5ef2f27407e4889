"""Cues from ROS 2 topics: points to glance at, in any frame of tf, and directions of speech."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from gazempc.live.sources.dead_topics import DeadTopics
from gazempc.live.sources.source import Arrived, SourceError
from gazempc.live.sources.tf import WAITS_S, TfListener
from gazempc.people.company import Sound
from gazempc.people.cues import Cue, Glance
from gazempc.robots.options import Ros2Options
from gazempc.ros2.node import Ros2Node
from gazempc.ros2.topics import Subscription
from gazempc.ros2.wire import WireError, on_loop_clock, stamp_s, topic_name
from gazempc.types import FloatArray

_NODE_NAME = "gazempc_cues"  # this program in the graph of ROS 2
_POINT = "geometry_msgs/msg/PointStamped"
# A point that is told again within so long, and is as near to the one before, is the same thing: no new glance.
_SAME_S, _SAME_M = 2.0, 0.3
# A direction is less than a whole turn; what is more is in another unit.
_TURN_RAD = 2.0 * math.pi
# Nothing can be looked at that is in the neck itself.
_NEAREST_M = 0.05
_WAITING_MAX = 64


class _Point(NamedTuple):
    """A point whose frame may not be known yet: when it was there (None for now), and until when that is waited for."""

    frame: str
    place_m: FloatArray
    time_s: float | None
    until_s: float


_Take = Callable[[Any, float], Cue | None]


class Ros2Cues:
    """Listens to the topics that the options name, over Zenoh as rmw_zenoh does.

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
        self._clock_s, self._to_loop_s, self._options, self._to_base = clock_s, to_loop_s, options, to_base
        self._point_topic = None if options.point_topic is None else topic_name(options.point_topic)
        self._sound_topic = None if options.sound_topic is None else topic_name(options.sound_topic)
        self._node: Ros2Node | None = None
        self._tf: TfListener | None = None
        self._points: Subscription | None = None
        self._sounds: Subscription | None = None
        self._waiting: deque[_Point] = deque(maxlen=_WAITING_MAX)
        self._pointed_s, self._pointed_m = -math.inf, np.full(3, np.inf)

    def open(self) -> None:
        """See `gazempc.live.sources.source.Source.open`; does not wait until somebody sends."""
        if self._node is not None:
            return
        listened: dict[str, Subscription] = {}
        try:
            self._node = node = Ros2Node(_NODE_NAME, self._options.network)
            if self._point_topic is not None:
                self._points = listened[self._point_topic] = node.subscription(self._point_topic, _POINT)
            if self._sound_topic is not None:
                kind = self._options.sound_type
                self._sounds = listened[self._sound_topic] = node.subscription(self._sound_topic, kind)
            if self._options.base_frame is not None:
                self._tf = TfListener(node)
                listened[self._tf.topic] = self._tf.moving
        except WireError as error:
            self.close()
            raise SourceError(f"{self._point_topic or self._sound_topic}: {error}") from None
        self._dead = DeadTopics(listened, self._clock_s())

    def poll(self) -> Arrived:
        """See `gazempc.live.sources.source.Source.poll`."""
        if self._node is None:
            return Arrived()
        cues: list[Cue] = []
        now_s, lost = self._clock_s(), self._node.lost_router()
        problems = [lost] if lost else []
        told: list[tuple[str | None, _Take, Any]] = []
        try:
            if self._tf is not None:
                problems += self._tf.listen()[1]
            if self._sounds is not None:
                told += [(self._sound_topic, self._sound, message) for message in self._sounds.take()]
            if self._points is not None:
                told += [(self._point_topic, self._point, message) for message in self._points.take()]
        except WireError as error:
            problems.append(str(error))
        told += [(self._point_topic, self._glance, self._waiting.popleft()) for _ in range(len(self._waiting))]
        for topic, take, message in told:
            try:
                if isinstance(message, WireError):
                    raise message
                cue = take(message, now_s)
            except WireError as error:
                problems.append(f"{topic}: {error}")
            else:
                cues += [] if cue is None else [cue]
        return Arrived((), tuple(problems), self._dead.notices(now_s), tuple(cues))

    @property
    def finished(self) -> bool:
        """False: nobody can know that nothing more will be sent."""
        return False

    def close(self) -> None:
        """See `gazempc.live.sources.source.Source.close`."""
        if self._node is not None:
            self._node.close()
        self._node = self._tf = self._points = self._sounds = None
        self._waiting.clear()

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
