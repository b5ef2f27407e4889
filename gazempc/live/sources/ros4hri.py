"""People of ROS4HRI trackers (REP 155): frames in tf, lists of who is tracked, and whose face it is."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.live.sources.ros2 import WAITS_S, Ros2Source, TfListener, used
from gazempc.people.company import Cue
from gazempc.recordings.readers.bag_frames import Poses, forward
from gazempc.recordings.readers.bag_people import is_person
from gazempc.robots.options import Ros2Options
from gazempc.ros2.messages import Ros2Error, on_loop_clock
from gazempc.ros2.node import MakeNode, Ros2Node, Subscription
from gazempc.ros2.transforms import Moved, Transforms
from gazempc.types import FloatArray, Sighting
from predictors import HeadObservation

Kind = Literal["face", "head", "body"]
KINDS: tuple[Kind, ...] = ("face", "head", "body")
_LISTS = {"face": "/humans/faces/tracked", "body": "/humans/bodies/tracked", "person": "/humans/persons/tracked"}
# The part that a person's topic names.
_MATCHES = {"face": "face_id", "body": "body_id"}
# Ids of the tracker become names of topics.
_ID = re.compile(r"\w+")
# Heads of skeletons are named by the body.
_PART = {"face": "face", "head": "body", "body": "body"}


class HriIds:
    """Keeps the lists and matches of a ROS4HRI person manager and its trackers.

    Args:
        node: Listens.
    """

    def __init__(self, node: Ros2Node) -> None:
        self._lists = {
            part: node.subscription(topic, "hri_msgs/msg/IdsList", latched=True) for part, topic in _LISTS.items()
        }
        self._node = node
        # By part and person.
        self._matches: dict[tuple[str, str], Subscription] = {}
        self._listed: dict[str, frozenset[str]] = {}
        self._part_of: dict[tuple[str, str], str] = {}

    def listen(self) -> None:
        """Take in what has come.

        Raises:
            Ros2Error: If the node is closed.
        """
        for part, listed in self._lists.items():
            for message in listed.take():
                self._list(part, frozenset(message.ids))
        for key, match in self._matches.items():
            for message in match.take():
                # An empty name withdraws the match.
                self._part_of[key] = message.data

    def is_tracked(self, kind: Kind, part_id: str) -> bool:
        """Whether a face or body is tracked. Some trackers go on sending the last pose of a face that they lost.

        Args:
            kind: What is seen of them.
            part_id: The tracker's name of that.

        Returns:
            Whether they are in the list. A face counts before the first list, too; a robot has heads and bodies itself.
        """
        part = _PART[kind]
        return (kind == "face" or part in self._listed) and self._is_listed(part, part_id)

    def person(self, kind: Kind, part_id: str) -> str | None:
        """Whose face or body something is.

        Args:
            kind: What is seen of them.
            part_id: The tracker's name of that.

        Returns:
            Name of the person; None before a match, or when the person is no longer tracked.
        """
        part = _PART[kind]
        found = (who for (of, who), its_id in self._part_of.items() if (of, its_id) == (part, part_id))
        return next((who for who in found if self._is_listed("person", who)), None)

    def _list(self, part: str, ids: frozenset[str]) -> None:
        if part == "person":
            for key in [key for key in self._matches if key[1] not in ids]:
                self._node.forget(self._matches.pop(key))
                self._part_of.pop(key, None)
            for person in filter(_ID.fullmatch, ids):
                for of, topic in _MATCHES.items():
                    if (of, person) not in self._matches:
                        full = f"/humans/persons/{person}/{topic}"
                        self._matches[of, person] = self._node.subscription(full, "std_msgs/msg/String", latched=True)
        self._listed[part] = ids

    def _is_listed(self, part: str, its_id: str) -> bool:
        return part not in self._listed or its_id in self._listed[part]


_KIND = re.compile(rf"({'|'.join(KINDS)})_(\w+)")
# From the middle of the hips to between the eyes, along the back, of a person 1.7 m tall: 0.936 and 0.530 of the height
# (Drillis & Contini, Body segment parameters, 1966).
_HEAD_OVER_HIPS_M = 0.69
# More wait only if frames on their way are missing.
_WAITING_MAX = 256


@dataclass(frozen=True)
class HeadInFrame:
    """The head of a person.

    Attributes:
        kind: The frame that shows it.
        part_id: The tracker's name of face or body.
        captured_s: When it was there, on the loop's clock, seconds.
        position_m: Where, shape (3,), metres.
        quat_wxyz: Orientation of the frame, shape (4,); a body's is that of the pelvis.
    """

    kind: Kind
    part_id: str
    captured_s: float
    position_m: FloatArray
    quat_wxyz: FloatArray


class _Waiting(NamedTuple):
    """A head whose place may not be known yet: its frame, when it was there, and until when that is waited for."""

    name: str
    time_s: float
    captured_s: float
    until_s: float


class HeadFrames:
    """Finds heads.

    Args:
        transforms: The tree.
        is_tracked: Whether a face or body, by the tracker's name, is tracked.
        to_loop_s: Converts Unix time in seconds to the loop's clock.
        base_frame: Frame that heads are given in. Without it that of the sensor, with optical axes turned to x forward;
            then all heads must be in one frame.
    """

    def __init__(
        self,
        transforms: Transforms,
        is_tracked: Callable[[Kind, str], bool],
        to_loop_s: Callable[[float], float],
        base_frame: str | None,
    ) -> None:
        self._transforms, self._is_tracked = transforms, is_tracked
        self._to_loop_s, self._base_frame = to_loop_s, base_frame
        self._sensor_frame: str | None = None
        self._waiting: deque[_Waiting] = deque(maxlen=_WAITING_MAX)

    def heads(self, moved: Iterable[Moved], now_s: float) -> tuple[list[HeadInFrame], list[str]]:
        """Where heads are.

        Args:
            moved: Frames that have moved.
            now_s: The time, on the loop's clock, seconds.

        Returns:
            Each head whose place is known by now, in the order of news; and for those whose place did not become known
            in time, why not.
        """
        problems: list[str] = []
        for frame, time_s in moved:
            for name in filter(self._is_head, self._transforms.moved_with(frame)):
                try:
                    captured_s = on_loop_clock(time_s, self._to_loop_s, now_s)
                except Ros2Error as error:
                    problems.append(f"{name}: {error}")
                else:
                    self._waiting.append(_Waiting(name, time_s, captured_s, now_s + WAITS_S))
        found: list[tuple[_Waiting, FloatArray]] = []
        for _ in range(len(self._waiting)):
            head = self._waiting.popleft()
            try:
                found.append((head, self._transforms.pose(head.name, self._seen_from(head.name), head.time_s)))
            except Ros2Error as error:
                if now_s < head.until_s:
                    self._waiting.append(head)
                else:
                    problems.append(f"{head.name}: {error}")
        return self._in_frame(found) if found else [], problems

    def _is_head(self, name: str) -> bool:
        if not _KIND.fullmatch(name) or not is_person(name):
            return False
        kind, part_id = _kind_and_id(name)
        # Of a skeleton with a head the hips are of no use.
        counts = kind != "body" or not self._transforms.has(f"head_{part_id}")
        return counts and self._is_tracked(kind, part_id)

    def _seen_from(self, name: str) -> str:
        if self._base_frame is not None:
            return self._base_frame
        own = f"_{name.partition('_')[2]}"
        above = (up for up in self._transforms.ancestors(name) if not (is_person(up) or up.endswith(own)))
        sensor = next(above, None)
        if sensor is None:
            raise Ros2Error("no transform to the frame of a sensor")
        if self._sensor_frame not in (None, sensor):
            raise Ros2Error(
                f"it is seen from {sensor!r}, others from {self._sensor_frame!r}: set --options.ros2.base-frame, a "
                "frame of the robot that tf connects with both"
            )
        self._sensor_frame = sensor
        return sensor

    def _in_frame(self, found: Sequence[tuple[_Waiting, FloatArray]]) -> list[HeadInFrame]:
        """Heads of poses, all at once: one at a time takes scipy far longer."""
        poses = np.array([pose for _, pose in found])
        position_m, quats = poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3]).as_quat(scalar_first=True)
        kinds_and_ids = [_kind_and_id(head.name) for head, _ in found]
        hips = np.array([kind == "body" for kind, _ in kinds_and_ids])
        position_m[hips] += _HEAD_OVER_HIPS_M * poses[hips, :3, 2]
        if self._base_frame is None and self._sensor_frame is not None:
            times_s = np.array([head.time_s for head, _ in found])
            turned, _ = forward(self._sensor_frame, Poses(times_s, np.zeros(times_s.size), position_m, quats))
            position_m, quats = turned.position_m, turned.quat_wxyz
        return [
            HeadInFrame(kind, part_id, head.captured_s, at_m, quat_wxyz)
            for (head, _), (kind, part_id), at_m, quat_wxyz in zip(found, kinds_and_ids, position_m, quats, strict=True)
        ]


def _kind_and_id(name: str) -> tuple[Kind, str]:
    kind_name, _, part_id = name.partition("_")
    return next(kind for kind in KINDS if kind == kind_name), part_id


# While a face is seen, the head of a skeleton is less accurate. No two heads are so near to each other.
_FACE_COUNTS_S, _ONE_HEAD_M = 0.5, 0.4


class Ros4HriPeople(Ros2Source):
    """The head of each person from tf, with the person's id, or the tracker's.

    A head is where ``face_<id>`` is, else ``head_<id>`` of a skeleton, else over the hips of ``body_<id>``. Ids that
    are not in the tracker's list are left out.

    Args:
        clock_s: The loop's clock, seconds.
        to_loop_s: Converts Unix time in seconds to the loop's clock.
        options: Clock, and the tf frame of the positions, on the robot. Without it the frame of the tracker's sensor,
            with optical axes converted to x forward. The mount gives the pose of this frame.
        make_node: Makes the node.
    """

    def __init__(
        self,
        clock_s: Callable[[], float],
        to_loop_s: Callable[[float], float],
        options: Ros2Options | None = None,
        make_node: MakeNode = Ros2Node,
    ) -> None:
        super().__init__("ROS4HRI", "gazempc_people", clock_s, to_loop_s, options or Ros2Options(), make_node)
        # By the tracker's name: capture time and place.
        self._faces: dict[str, tuple[float, FloatArray]] = {}

    def _subscribe(self, node: Ros2Node) -> Mapping[str, Subscription]:
        self._tf, self._ids = TfListener(node), HriIds(node)
        self._heads = HeadFrames(self._tf.transforms, self._ids.is_tracked, self._to_loop_s, self._options.base_frame)
        self._faces = {}
        return self._tf.topics

    def _take_in(self, now_s: float, problems: list[str]) -> tuple[Iterable[Sighting], Iterable[Cue]]:
        assert self._tf is not None
        self._ids.listen()
        heads, unplaced = self._heads.heads(self._tf.listen(problems), now_s)
        problems += [f"/tf, {problem}" for problem in unplaced]
        sightings: list[Sighting] = []
        for head in heads:
            seen = used([head], self._observation, f"/tf, {head.kind}_{head.part_id}", problems)
            sightings += [Sighting(now_s, each) for each in seen]
        return sightings, ()

    def _observation(self, head: HeadInFrame) -> HeadObservation | None:
        """A head that counts; None for one whose face is seen."""
        captured_s = head.captured_s
        self._faces = {name: face for name, face in self._faces.items() if captured_s - face[0] <= _FACE_COUNTS_S}
        if head.kind == "face":
            self._faces[head.part_id] = captured_s, head.position_m
        elif any(math.dist(head.position_m, place_m) < _ONE_HEAD_M for _, place_m in self._faces.values()):
            return None
        is_body = head.kind == "body"
        return HeadObservation(
            captured_s,
            head.position_m,
            head_quat_wxyz=None if is_body else head.quat_wxyz,
            pelvis_quat_wxyz=head.quat_wxyz if is_body else None,
            person_id=self._ids.person(head.kind, head.part_id) or head.part_id,
        )
