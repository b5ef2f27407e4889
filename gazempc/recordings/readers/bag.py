"""Recordings of people from a ROS 2 bag: candidate frames and topics for a head, most likely first, and their tracks.

Names and axes of people's frames follow ROS4HRI (REP 155): ``face_<id>`` between the eyes and ``head_<id>``, both
with x out of the face and z up; ``person_<id>`` at the face or the head; ``body_<id>`` between the hips.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gazempc.errors import RecordingError, SettingsError, suggest
from gazempc.recordings.readers.bag_frames import (
    FIXED_FRAMES,
    Axes,
    FrameTree,
    Poses,
    forward,
    person_axes,
    poses_of,
    usable,
)
from gazempc.recordings.readers.bag_messages import (
    FACES,
    POSE_TYPES,
    TF,
    BagMessage,
    person_of_topic,
    read_messages,
    stamp_ns,
)
from gazempc.recordings.readers.checks import MIN_SEEN_FRAMES, recording_of
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.recording import Recording, Track, composed
from gazempc.types import FloatArray

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
        of_topic = len(PREFIXES) + (not _PERSON_TOPIC.search(self.topic.lower()))
        kinds = (k for k, prefix in enumerate(PREFIXES) if self.topic == TF and self.name.startswith(prefix))
        return next(kinds, of_topic), -self.poses.times_s.size


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
    named = ((message.content, person_of_topic(message.topic)) for message in messages)
    persons = {content.data: person for content, person in named if person is not None and content.data}
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
    joined = []
    for (person, _, kind), group in groups.items():
        every = Poses(*map(np.concatenate, zip(*(vars(seen.poses).values() for seen in group), strict=True)))
        poses = usable(every)
        left_out = sum(seen.left_out for seen in group) + every.times_s.size - poses.times_s.size
        name = group[0].name if len(group) == 1 else f"{kind}_{person}"
        joined.append(replace(group[0], name=name, poses=poses, left_out=left_out))
    return joined


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


def read_bag(path: Path, options: ReadOptions) -> Recording:
    """Read one person from a bag: the longest track, or the one selected by the options.

    The recording's frame is the sensor's, x forward, y left, z up, and the robot stands there. A frame such as ``map``
    has no sensor at its origin; the robot then stands beside the walk. The truth is estimated: the track, smoothed
    without lag.

    Args:
        path: Folder of the bag, or a file of it.
        options: Topic, person, frame and axes, to override the inferred ones.

    Returns:
        The recording, with notes on the other people in the bag.

    Raises:
        RecordingError: If this is not a bag, it contains no person, or the track is too short.
        SettingsError: If the bag has no such topic, person or frame.
        MissingOptionalDependencyError: If rosbags is not installed.
    """
    frames, found = _open(path)
    return _recording(path, frames, found, _chosen(path, found, options), options)


def read_bag_people(path: Path, options: ReadOptions) -> tuple[Recording, ...]:
    """Read all people of a bag, from its most likely kind of frame: faces, heads, persons or topics.

    Args:
        path: As for `read_bag`.
        options: As for `read_bag`, except the person.

    Returns:
        One recording per person, on one clock; people in too few frames for a recording are left out.

    Raises:
        GazempcError: As for `read_bag`.
    """
    frames, found = _open(path)
    kind = _chosen(path, found, options).rank[0]
    alike = [seen for seen in found if seen.rank[0] == kind and seen.poses.times_s.size >= MIN_SEEN_FRAMES]
    if not alike:
        return (read_bag(path, options),)  # refused, too, with the reason
    start_s = min(float(seen.poses.times_s[0]) for seen in alike)
    recordings = []
    for seen in alike:
        recording = _recording(path, frames, found, seen, options.model_copy(update={"person": seen.name}))
        recordings.append(replace(recording, times_s=recording.times_s + seen.poses.times_s[0] - start_s))
    return tuple(recordings)


def _open(path: Path) -> tuple[FrameTree, list[Sighted]]:
    """Frame tree of a bag, and candidate tracks of heads, most likely and longest first; at least one."""
    topics, messages = read_messages(path)
    frames = FrameTree(messages)
    if found := people_in(frames, topics, messages):
        return frames, found
    problem = f"no frame of a person; the bag's topics are {', '.join(topics) or 'none'}"
    names = ", ".join(f"{prefix}<id>" for prefix in PREFIXES)
    expected = f"frames named {names} in {TF}, as in ROS4HRI, or a topic of poses or points"
    raise RecordingError(path, f"topic {TF}", problem, expected)


def _recording(path: Path, frames: FrameTree, people: list[Sighted], seen: Sighted, options: ReadOptions) -> Recording:
    """The track in the requested frame with x forward, z up, and the person's x out of the face."""
    goal = options.bag_frame or seen.frame
    moved, lost = (seen.poses, 0) if goal == seen.frame else _moved(path, frames, seen.poses, seen.frame, goal)
    # The person's axes are inferred in the sensor's frame, because people face the sensor.
    own, _ = forward(seen.frame, seen.poses, options.bag_axes if goal == seen.frame else None)
    is_sensor, is_face = seen.frame not in FIXED_FRAMES, seen.name.startswith("face_")
    turn, note = person_axes(own.position_m, own.quat_wxyz, is_sensor, is_face)
    poses, was_optical = forward(goal, moved, options.bag_axes)
    if not poses.times_s.size:
        raise RecordingError(f"{path}: {seen.name} in {goal}", "", "no pose", "at least one pose in that frame")
    about = f"{seen.name}, {poses.times_s.size} frames in {goal}"
    about += ", optical axes rotated to x forward, y left, z up" if was_optical else ", x forward, y left, z up"
    notes = [f"{about} (the options bag_frame and bag_axes change it)", *([note] if note else [])]
    if left_out := seen.left_out + lost:
        notes.append(
            f"{left_out} messages repeat a stamp, have no finite pose, or came while {FACES} did not list the face or "
            f"{goal} was unknown: left out"
        )
    notes.append(f"messages arrived {1e3 * np.median(poses.delays_s):.0f} ms after their stamp (median)")
    pelvis = _pelvis(frames, seen, goal, "optical" if was_optical else "forward", poses.times_s)
    track = Track(poses.position_m, turn(poses.quat_wxyz), *pelvis)
    others = [f"{other.name} ({other.poses.times_s.size} in {other.frame})" for other in people if other is not seen]
    if others:
        notes.append(f"also in the bag: {', '.join(others)}; select by the options person and bag_topic")
    times_s = poses.times_s - poses.times_s[0]
    found = recording_of(path, times_s, track, "tracked", goal not in FIXED_FRAMES, notes=notes)
    name = path.stem if options.person is None else f"{path.stem}_{seen.person.strip('/').replace('/', '_')}"
    # ROS4HRI's person ids are common to all bags of a robot; an index beside the bag has priority.
    labels, is_person_id = found.labels, seen.topic == TF and seen.person != seen.name.partition("_")[2]
    if is_person_id and labels.subject == path.stem.partition("_")[0]:
        labels = replace(labels, subject=seen.person)
    return replace(found, name=name, labels=labels, delays_s=np.maximum(poses.delays_s, 0.0))


def _chosen(path: Path, people: list[Sighted], options: ReadOptions) -> Sighted:
    found = people
    if options.bag_topic is not None:
        found = [seen for seen in people if seen.topic == options.bag_topic]
        if not found:
            near = suggest(options.bag_topic, {seen.topic for seen in people})
            raise SettingsError(f"bag_topic: no person on {options.bag_topic} in {path}; {near}")
    if options.person is not None:
        named = [s for s in found if options.person in (s.name, s.person, s.name.partition("_")[2])]
        if not named:
            near = suggest(options.person, {name for seen in found for name in (seen.name, seen.person)})
            raise SettingsError(f"person: no {options.person!r} in {path}; {near}")
        return named[0]
    # Frames of bodies are at the hips, not at the head.
    heads = [seen for seen in found if not seen.name.startswith("body_")]
    if not heads:
        problem = f"only bodies: {', '.join(s.name for s in found)}"
        raise RecordingError(path, f"topic {TF}", problem, "a head; or the option person")
    return heads[0]


def _moved(path: Path, frames: FrameTree, poses: Poses, start: str, goal: str) -> tuple[Poses, int]:
    """Poses in another frame of the bag, and the number of poses without a transform."""
    way = frames.way(start, goal)
    if way is None:
        joined = [name for name in frames.names if frames.way(start, name) is not None]
        others = [name for name in joined if not (is_person(name) or name.startswith("gaze_"))]
        raise SettingsError(f"bag_frame: no transform from {start} to {goal!r} in {path}; {suggest(goal, others)}")
    shift_m, turn, known = frames.along(way, poses.times_s)
    quats = composed(poses.quat_wxyz, first=turn)
    moved = replace(poses, position_m=shift_m + turn.apply(poses.position_m), quat_wxyz=quats)
    return moved.chosen(known), int((~known).sum())


def _pelvis(
    frames: FrameTree, seen: Sighted, frame: str, axes: Axes, times_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Positions, shape (N, 3), and quaternions, (N, 4), of the hips of the head's skeleton; NaN if unknown."""
    kind, _, own_id = seen.name.partition("_")
    way = frames.way(f"body_{own_id}", frame) if kind == "head" else None
    if way is None:
        return np.full((times_s.size, 3), np.nan), np.full((times_s.size, 4), np.nan)
    position_m, turn, known = frames.along(way, times_s)
    poses, _ = forward(frame, Poses(times_s, times_s, position_m, turn.as_quat(scalar_first=True)), axes)
    return np.where(known[:, None], poses.position_m, np.nan), np.where(known[:, None], poses.quat_wxyz, np.nan)
