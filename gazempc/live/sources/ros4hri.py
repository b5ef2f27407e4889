"""People of ROS4HRI trackers (REP 155): frames in tf, lists of tracked people, and matches of faces to people."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.live.sources.ros2 import Ros2Input, Ros2Source
from gazempc.people.company import Cue
from gazempc.recordings.readers.bag import is_person
from gazempc.recordings.readers.bag_frames import Poses, forward
from gazempc.ros2.messages import FrameError, Ros2Error
from gazempc.ros2.node import Ros2Node, Subscription
from gazempc.types import FloatArray, Sighting
from predictors import HeadObservation

_LISTS = {"face": "/humans/faces/tracked", "body": "/humans/bodies/tracked", "person": "/humans/persons/tracked"}
# Part named by a person's topic.
_MATCHES = {"face": "face_id", "body": "body_id"}
# Ids of the tracker are part of topic names.
_ID = re.compile(r"\w+")
# Kinds of frames, and their lists: heads of skeletons have the id of the body.
_PART = {"face": "face", "head": "body", "body": "body"}
_HEAD = re.compile(rf"({'|'.join(_PART)})_(\w+)")
# From the middle of the hips to between the eyes, along the back, of a person 1.7 m tall: 0.936 and 0.530 of the height
# (Drillis & Contini, Body segment parameters, 1966).
_HEAD_OVER_HIPS_M = 0.69
# Time and distance within which a face replaces the less accurate head of a skeleton; two heads are farther apart.
_FACE_COUNTS_S, _ONE_HEAD_M = 0.5, 0.4


class _Head(NamedTuple):
    """A head with its frame, whose transform may be pending, and its time in ROS time and on the loop's clock."""

    name: str
    time_s: float
    captured_s: float


class Ros4HriPeople(Ros2Source):
    """The head of each person from tf, with the person's id, or the tracker's.

    The head is at ``face_<id>``, else at ``head_<id>`` of a skeleton, else above the hips of ``body_<id>``. Ids outside
    of the tracker's list are ignored.

    Args:
        given: Clocks, node, and options with the tf frame of the positions, on the robot. Without it the frame of the
            tracker's sensor, with optical axes converted to x forward. The mount gives the pose of this frame.
    """

    def __init__(self, given: Ros2Input) -> None:
        super().__init__(given, "ROS4HRI", "gazempc_people", uses_tf=True)

    def _subscribe(self, node: Ros2Node) -> Mapping[str, Subscription]:
        self._lists = {
            part: node.subscription(topic, "hri_msgs/msg/IdsList", latched=True) for part, topic in _LISTS.items()
        }
        self._listed: dict[str, frozenset[str]] = {}
        # By part and person.
        self._matches: dict[tuple[str, str], Subscription] = {}
        self._part_of: dict[tuple[str, str], str] = {}
        # Recent faces by the tracker's name: capture time and position.
        self._faces: dict[str, tuple[float, FloatArray]] = {}
        self._sensor_frame: str | None = None
        return {}

    def _process(self) -> tuple[Iterable[Sighting], Iterable[Cue]]:
        assert self._tf is not None
        self._listen()
        heads: list[_Head] = []
        for frame, time_s in self._tf.moved:
            for name in filter(self._is_head, self._transforms.moved_with(frame)):
                try:
                    heads.append(_Head(name, time_s, self._loop_s(time_s)))
                except Ros2Error as error:
                    self._problems.append(f"/tf, {name}: {error}")
        seen = self._placed(heads, self._seen, lambda head: f"/tf, {head.name}")
        return [Sighting(self._now_s, each) for each in seen], ()

    def _listen(self) -> None:
        """Process lists and matches."""
        for part, listed in self._lists.items():
            for message in listed.take():
                self._listed[part] = frozenset(message.ids)
                if part == "person":
                    self._follow(self._listed[part])
        for key, match in self._matches.items():
            for message in match.take():
                # An empty name withdraws the match.
                self._part_of[key] = message.data

    def _follow(self, persons: frozenset[str]) -> None:
        """Subscribe to the matches of these persons only."""
        assert self._node is not None
        for key in [key for key in self._matches if key[1] not in persons]:
            self._node.forget(self._matches.pop(key))
            self._part_of.pop(key, None)
        for person in filter(_ID.fullmatch, persons):
            for part, topic in _MATCHES.items():
                if (part, person) not in self._matches:
                    full = f"/humans/persons/{person}/{topic}"
                    self._matches[part, person] = self._node.subscription(full, "std_msgs/msg/String", latched=True)

    def _is_listed(self, part: str, its_id: str) -> bool:
        return part not in self._listed or its_id in self._listed[part]

    def _is_head(self, name: str) -> bool:
        """Whether a frame is a tracked head: some trackers repeat the last pose of a lost face."""
        found = _HEAD.fullmatch(name)
        if found is None or not is_person(name):
            return False
        kind, its_id = found.groups()
        # The hips of a skeleton with a head are ignored.
        if kind == "body" and self._transforms.has(f"head_{its_id}"):
            return False
        # Faces are accepted before the first list; heads and bodies may be the robot's own.
        return (kind == "face" or _PART[kind] in self._listed) and self._is_listed(_PART[kind], its_id)

    def _person(self, part: str, its_id: str) -> str | None:
        """Name of the person with a face or body; None before a match, and after the end of the track."""
        found = (who for (of, who), matched in self._part_of.items() if (of, matched) == (part, its_id))
        return next((who for who in found if self._is_listed("person", who)), None)

    def _seen_from(self, name: str) -> str:
        """The reference frame of a head."""
        if self._options.base_frame is not None:
            return self._options.base_frame
        own = f"_{name.partition('_')[2]}"
        above = (up for up in self._transforms.ancestors(name) if not (is_person(up) or up.endswith(own)))
        sensor = next(above, None)
        if sensor is None:
            raise FrameError("no transform to the frame of a sensor")
        if self._sensor_frame not in (None, sensor):
            raise FrameError(
                f"it is seen from {sensor!r}, others from {self._sensor_frame!r}: set --options.ros2.base-frame, a "
                "frame of the robot that tf connects with both"
            )
        self._sensor_frame = sensor
        return sensor

    def _seen(self, head: _Head) -> HeadObservation | None:
        """Observation of a head; None for the head of a skeleton with a detected face."""
        frame = self._seen_from(head.name)
        pose = self._transforms.pose(head.name, frame, head.time_s)
        kind, _, its_id = head.name.partition("_")
        is_body, captured_s = kind == "body", head.captured_s
        position_m = pose[:3, 3] + (_HEAD_OVER_HIPS_M * pose[:3, 2] if is_body else 0.0)
        quat_wxyz = Rotation.from_matrix(pose[:3, :3]).as_quat(scalar_first=True)
        if self._options.base_frame is None:
            turned, _ = forward(frame, Poses(np.zeros(1), np.zeros(1), position_m[None], quat_wxyz[None]))
            position_m, quat_wxyz = turned.position_m[0], turned.quat_wxyz[0]
        self._faces = {name: face for name, face in self._faces.items() if captured_s - face[0] <= _FACE_COUNTS_S}
        if kind == "face":
            self._faces[its_id] = captured_s, position_m
        elif any(math.dist(position_m, face_m) < _ONE_HEAD_M for _, face_m in self._faces.values()):
            return None
        return HeadObservation(
            captured_s,
            position_m,
            head_quat_wxyz=None if is_body else quat_wxyz,
            pelvis_quat_wxyz=quat_wxyz if is_body else None,
            person_id=self._person(_PART[kind], its_id) or its_id,
        )
