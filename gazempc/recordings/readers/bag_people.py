"""Candidate frames and topics for a person's head in a ROS 2 bag, most likely first.

Names and axes of people's frames follow ROS4HRI (REP 155): ``face_<id>`` between the eyes and ``head_<id>``, both
with x out of the face and z up; ``person_<id>`` at the face or the head; ``body_<id>`` between the hips.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gazempc.recordings.readers.bag_frames import FrameTree, Poses, poses_of, usable
from gazempc.recordings.readers.bag_messages import FACES, POSE_TYPES, TF, BagMessage, person_of_topic, stamp_ns

# In the order of preference: a face is measured, a person is derived from faces and bodies.
PREFIXES = ("face_", "head_", "person_", "body_")
# Robots' frames have such names, too: head_1_link, head_tilt, body_base, face_camera.
_PERSON = re.compile(r"(?:(?:face|person)_\w+|(?:head|body)_[A-Za-z0-9]+)")
_ROBOT_WORDS = {"link", "frame", "joint", "camera", "optical", "base", "pan", "tilt", "yaw", "pitch", "roll", "center"}
# Topics of poses with such names rank before others, such as a robot's goal.
_PERSON_TOPIC = re.compile(r"head|face|person|people|human|user|pedestrian")


@dataclass(frozen=True)
class Sighted:
    """Candidate track of a person's head.

    Attributes:
        name: Name of its frame, or its topic.
        topic: Topic of its messages.
        person: ROS4HRI's id of the person, else the frame's id, or the topic.
        frame: Frame of the poses: the nearest ancestor that is not a person's.
        poses: In the order of their stamps, each stamp once.
        left_out: Messages that repeat a stamp, have no finite pose, or came while the tracker did not list the face.
    """

    name: str
    topic: str
    person: str
    frame: str
    poses: Poses
    left_out: int = 0

    @property
    def rank(self) -> tuple[int, int]:
        """Sort key: preference of the frame's kind, then negative length."""
        if self.topic == TF:
            kind = next(k for k, prefix in enumerate(PREFIXES) if self.name.startswith(prefix))
        else:
            kind = len(PREFIXES) + (not _PERSON_TOPIC.search(self.topic.lower()))
        return kind, -self.poses.times_s.size

    def answers_to(self, name: str) -> bool:
        """Whether a name matches its frame, id, person or topic."""
        return name in (self.name, self.person, self.name.partition("_")[2])


def is_person(frame: str) -> bool:
    """Whether a frame's name is a person's."""
    return bool(_PERSON.fullmatch(frame)) and frame.lower().rpartition("_")[2] not in _ROBOT_WORDS


def people_in(frames: FrameTree, topics: Mapping[str, str], messages: Sequence[BagMessage]) -> list[Sighted]:
    """All candidates for a person's head, most likely and longest first.

    Args:
        frames: The frames of the bag.
        topics: Type of each topic.
        messages: Messages of the bag.

    Returns:
        Frames and topics with at least one usable pose. Faces of one person are merged.
    """
    persons = _persons(messages)
    found = [
        _listed(seen, messages)
        for name in frames.names
        if is_person(name) and (seen := _of_frame(frames, name, persons.get(name.partition("_")[2])))
    ]
    found = [*_joined(found), *(_of_topic(topic, messages) for topic, kind in topics.items() if kind in POSE_TYPES)]
    return sorted((seen for seen in found if seen.poses.times_s.size), key=lambda seen: seen.rank)


def _listed(seen: Sighted, messages: Iterable[BagMessage]) -> Sighted:
    """Remove the poses of a face that is in neither the previous nor the next list of tracked faces.

    Some trackers repeat the last pose of a lost face.
    """
    face = seen.name.removeprefix("face_")
    lists = [message for message in messages if message.topic == FACES]
    has = np.array([face in message.content.ids for message in lists], dtype=np.bool_)
    if not (seen.name.startswith("face_") and has.any()):
        return seen
    received_s = np.array([1e-9 * message.received_ns for message in lists])
    after = np.searchsorted(received_s, seen.poses.times_s + seen.poses.delays_s)
    listed = has[np.clip(after - 1, 0, has.size - 1)] | has[np.clip(after, 0, has.size - 1)]
    return replace(seen, poses=seen.poses.chosen(listed), left_out=seen.left_out + int((~listed).sum()))


def _persons(messages: Iterable[BagMessage]) -> dict[str, str]:
    """Person's id by face id."""
    named = ((message, person_of_topic(message.topic)) for message in messages)
    return {message.content.data: person for message, person in named if person is not None and message.content.data}


def _of_frame(frames: FrameTree, name: str, person: str | None) -> Sighted | None:
    """Track of a person's frame in its nearest ancestor of no person; None if it is static or has none."""
    own_id = name.partition("_")[2]
    way: list[tuple[tuple[str, str], bool]] = []
    here, been = name, {name}
    while here == name or is_person(here) or here.endswith(f"_{own_id}"):
        edges = [edge for edge in (*frames.moving, *frames.fixed) if edge[1] == here and edge[0] not in been]
        if not edges:
            return None
        # A frame has one parent; of two, the more frequent one.
        edge = max(edges, key=lambda edge: len(frames.moving[edge].times_s) if edge in frames.moving else 0)
        way.append((edge, True))
        here = edge[0]
        been.add(here)
    moving = [edge for edge, _ in way if edge in frames.moving]
    if not moving:
        return None
    given = frames.moving[moving[0]]
    poses = usable(given)
    # A single transform needs no composition.
    if len(way) > 1:
        position_m, turn, known = frames.along(way, poses.times_s)
        quats = turn.as_quat(scalar_first=True)
        poses = Poses(poses.times_s, poses.delays_s, position_m, quats).chosen(known)
    return Sighted(name, TF, person or own_id, here, poses, given.times_s.size - poses.times_s.size)


def _joined(found: Sequence[Sighted]) -> list[Sighted]:
    """Merge the faces of one person in one frame: a tracker assigns a new id after losing a face."""
    groups: dict[tuple[str, str, str], list[Sighted]] = defaultdict(list)
    for seen in found:
        groups[seen.person, seen.frame, seen.name.partition("_")[0]].append(seen)
    return [_join(group) if len(group) > 1 else group[0] for group in groups.values()]


def _join(group: Sequence[Sighted]) -> Sighted:
    fields = zip(*(vars(seen.poses).values() for seen in group), strict=True)
    every = Poses(*(np.concatenate(field) for field in fields))
    poses, first = usable(every), group[0]
    left_out = sum(seen.left_out for seen in group) + every.times_s.size - poses.times_s.size
    return replace(first, name=f"{first.name.partition('_')[0]}_{first.person}", poses=poses, left_out=left_out)


def _of_topic(topic: str, messages: Iterable[BagMessage]) -> Sighted:
    rows: list[tuple[float, ...]] = []
    frames: list[str] = []
    for message in messages:
        if message.topic != topic:
            continue
        content = message.content
        point, quat = getattr(content, "point", None), (np.nan,) * 4
        if point is None:
            pose = getattr(content.pose, "pose", content.pose)
            point, q = pose.position, pose.orientation
            # In ROS all zeros mean no orientation.
            quat = (q.w, q.x, q.y, q.z) if any((q.w, q.x, q.y, q.z)) else quat
        at_ns = stamp_ns(content.header)
        rows.append((1e-9 * at_ns, 1e-9 * (message.received_ns - at_ns), point.x, point.y, point.z, *quat))
        frames.append(content.header.frame_id.lstrip("/"))
    frame = max(dict.fromkeys(frames), key=frames.count) if frames else ""
    poses = usable(poses_of(rows).chosen(np.array([name == frame for name in frames], dtype=np.bool_)))
    # The identity in every message means no orientation.
    if (poses.quat_wxyz == (1.0, 0.0, 0.0, 0.0)).all():
        poses = replace(poses, quat_wxyz=np.full_like(poses.quat_wxyz, np.nan))
    return Sighted(topic, topic, topic, frame, poses, len(rows) - poses.times_s.size)
