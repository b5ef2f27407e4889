"""Cues on ROS 2 topics: sounds, directions of speech and points to glance at."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from gazempc.errors import SettingsError
from gazempc.live.clock import Clock
from gazempc.live.mount import Mount, placed
from gazempc.live.settings import MountedSettings
from gazempc.live.sources.ros2 import Ros2Input, Ros2Source
from gazempc.neck.spec import NeckSpec
from gazempc.people.company import Cue, Glance, Sound
from gazempc.ros2.messages import Ros2Error, stamp_s, topic_name
from gazempc.ros2.node import Ros2Node, Subscription
from gazempc.types import FloatArray, Sighting

# Message of a direction of sound: whole degrees, as published by respeaker_ros.
_POINT, _SOUND = "geometry_msgs/msg/PointStamped", "std_msgs/msg/Int32"
# Deduplication of points: time and distance within which a repeated point causes no new glance.
_SAME_S, _SAME_M = 2.0, 0.3
# Maximum direction, a whole turn; larger values are in another unit.
_TURN_DEG = 360
# Minimum distance of a gaze target: outside of the neck itself.
_NEAREST_M = 0.05


class Ros2Cues(Ros2Source):
    """Subscribes to the topics of cues in the options.

    Args:
        given: Clocks, node, and options with topics and frames. A point needs a base frame.
        to_base: From the base frame of the options to the neck's, both shape (3,), metres.

    Raises:
        SettingsError: If ROS 2 allows no such topic.
    """

    def __init__(self, given: Ros2Input, to_base: Callable[[FloatArray], FloatArray]) -> None:
        self._to_base, options = to_base, given.options
        self._point_topic = "" if options.point_topic is None else topic_name(options.point_topic)
        self._sound_topic = "" if options.sound_topic is None else topic_name(options.sound_topic)
        super().__init__(given, self._point_topic or self._sound_topic, "gazempc_cues")
        self._pointed_s, self._pointed_m = -math.inf, np.full(3, np.inf)

    def _subscribe(self, node: Ros2Node) -> Mapping[str, Subscription]:
        kinds = {self._point_topic: _POINT, self._sound_topic: _SOUND}
        return {topic: node.subscription(topic, kind) for topic, kind in kinds.items() if topic}

    def _process(self) -> tuple[Iterable[Sighting], Iterable[Cue]]:
        topics = self._point_topic, self._sound_topic
        points, sounds = (self._watched[topic].take() if topic else [] for topic in topics)
        heard = self._used(sounds, self._sound, self._sound_topic)
        return (), [*heard, *self._placed(points, self._glance, lambda _: self._point_topic)]

    def _sound(self, message: Any) -> Sound:
        if abs(message.data) > _TURN_DEG:
            raise Ros2Error(f"a direction of sound is {message.data}: expected degrees to the left, at most 360")
        azimuth_rad = math.radians(message.data)
        if self._options.sound_frame is None or self._options.base_frame is None:
            return Sound(self._now_s, azimuth_rad)
        pose = self._transforms.pose(self._options.sound_frame, self._options.base_frame)
        ahead = pose[:3, :3] @ np.array([math.cos(azimuth_rad), math.sin(azimuth_rad), 0.0])
        x, y, _ = self._to_base(ahead) - self._to_base(np.zeros(3))
        return Sound(self._now_s, math.atan2(y, x))

    def _glance(self, message: Any) -> Glance | None:
        header, point, base_frame = message.header, message.point, self._options.base_frame
        frame, place_m = header.frame_id.lstrip("/"), np.array([point.x, point.y, point.z, 1.0])
        if base_frame is None:
            raise Ros2Error("a point needs options.ros2.base_frame")
        if not frame:
            raise Ros2Error("a point's header names no frame")
        if not np.isfinite(place_m).all():
            raise Ros2Error(f"a point is at {place_m[:3].tolist()}: expected finite metres")
        # Without a stamp: now, as is usual in tf.
        time_s = stamp_s(header.stamp) if header.stamp.sec or header.stamp.nanosec else None
        if time_s is not None:
            self._loop_s(time_s)
        pose = self._transforms.pose(frame, base_frame, time_s)
        target_m = self._to_base((pose @ place_m)[:3])
        if np.linalg.norm(target_m) < _NEAREST_M:
            raise Ros2Error(f"a point is in the neck itself, at {target_m.round(3).tolist()} m of its base")
        again = self._now_s - self._pointed_s < _SAME_S and math.dist(target_m, self._pointed_m) < _SAME_M
        self._pointed_s = self._now_s
        if again:
            return None
        self._pointed_m = target_m
        return Glance(target_m, self._options.point_lasts_s)


def make_cue_source(settings: MountedSettings, neck: NeckSpec, clock: Clock, mounted: bool) -> tuple[Ros2Cues, ...]:
    """The source of cues; empty without a topic in the options.

    Args:
        settings: The settings.
        neck: The neck.
        clock: The loop's clock.
        mounted: Whether the base frame of tf is the mount's; else it is the neck's base frame.

    Raises:
        SettingsError: If settings are incompatible.
    """
    ros2 = settings.options.ros2
    if ros2.point_topic is None and ros2.sound_topic is None:
        return ()
    named = "options.ros2.point_topic" if ros2.point_topic is not None else "options.ros2.sound_topic"
    points, framed = ros2.point_topic is not None, ros2.base_frame is not None
    wrong = {
        f"{named}: ROS 2 needs real time; accepted without --simulated-clock": not clock.is_real,
        f"{named}: accepted with attend, or with look_away.rhythm told": points and not settings.several,
        "options.ros2.sound_topic: accepted with attend, such as speaker": (
            ros2.sound_topic is not None and settings.attend is None
        ),
        f"{named}: needs options.ros2.base_frame, the frame of tf that is the neck's base frame": (
            not framed and (points or ros2.sound_frame is not None)
        ),
        f"mount.on {settings.mount.on}: {named} needs a base_frame that does not move with the neck; accepted: base": (
            mounted and settings.mount.moves and framed
        ),
    }
    for message, applies in wrong.items():
        if applies:
            raise SettingsError(message)
    mount = settings.mount if mounted else Mount()
    return (Ros2Cues(Ros2Input(clock.now_s, clock.from_unix_s, ros2), lambda place_m: placed(mount, neck, place_m)),)
