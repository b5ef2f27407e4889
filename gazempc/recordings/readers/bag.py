"""People in a ROS 2 bag, and a person in it as a recording.

Names and axes of people's frames are those of ROS4HRI (REP 155): ``face_<id>`` between the eyes and ``head_<id>``, both
with x out of the face and z up; ``person_<id>`` at the face or the head; ``body_<id>`` between the hips.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

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
from gazempc.recordings.readers.checks import (
    MIN_SEEN_FRAMES,
    check_frame_count,
    check_frame_interval,
    check_head_travel,
    smoothed,
)
from gazempc.recordings.readers.labels import labels_for
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.recording import Labels, Recording, Track
from gazempc.types import FloatArray

# In the order of preference: a face is measured, a person is derived from faces and bodies.
PREFIXES = ("face_", "head_", "person_", "body_")
# Robots have heads and bodies, too: head_1_link, head_tilt, body_base, face_camera.
_PERSON = re.compile(r"(?:(?:face|person)_\w+|(?:head|body)_[A-Za-z0-9]+)")
_ROBOT_WORDS = {"link", "frame", "joint", "camera", "optical", "base", "pan", "tilt", "yaw", "pitch", "roll", "center"}
# Topics of poses that are likely a person's come before others, such as a robot's goal.
_PERSON_TOPIC = re.compile(r"head|face|person|people|human|user|pedestrian")


@dataclass(frozen=True)
class Sighted:
    """One thing over time that may be a person's head.

    Attributes:
        name: Name of its frame, or its topic.
        topic: Where it is from.
        person: ROS4HRI's name of the person, the frame's id where there is none, or the topic.
        frame: Frame that the poses are in; the nearest one that is no person's.
        poses: In the order of their stamps, each stamp once.
        repeated: Messages that repeat a stamp; left out.
        unusable: Messages with a number that is not finite, or no orientation; left out.
        unlisted: Messages about a face while the tracker did not list it as tracked; left out.
    """

    name: str
    topic: str
    person: str
    frame: str
    poses: Poses
    repeated: int = 0
    unusable: int = 0
    unlisted: int = 0

    @property
    def rank(self) -> tuple[int, int]:
        """The likelier a head and the longer, the smaller."""
        if self.topic == TF:
            kind = next(k for k, prefix in enumerate(PREFIXES) if self.name.startswith(prefix))
        else:
            kind = len(PREFIXES) + (not _PERSON_TOPIC.search(self.topic.lower()))
        return kind, -self.poses.times_s.size

    def answers_to(self, name: str) -> bool:
        """Whether a name is that of its frame, id, person or topic."""
        return name in (self.name, self.person, self.name.partition("_")[2])


def is_person(frame: str) -> bool:
    """Whether a frame is a person's."""
    return bool(_PERSON.fullmatch(frame)) and frame.lower().rpartition("_")[2] not in _ROBOT_WORDS


def people(frames: FrameTree, topics: Mapping[str, str], messages: Sequence[BagMessage]) -> list[Sighted]:
    """All that may be a person's head, the likeliest and longest first.

    Args:
        frames: The frames of the bag.
        topics: Type of each topic.
        messages: Those of the bag.

    Returns:
        FrameTree and topics with at least one usable pose. Faces that a tracker gave to one person are joined.
    """
    persons, lists = _persons(messages), _Lists(messages)
    found = [
        lists.checked(seen)
        for name in frames.names
        if is_person(name) and (seen := _of_frame(frames, name, persons.get(name.partition("_")[2])))
    ]
    found = [*_joined(found), *(_of_topic(topic, messages) for topic, kind in topics.items() if kind in POSE_TYPES)]
    return sorted((seen for seen in found if seen.poses.times_s.size), key=lambda seen: seen.rank)


class _Lists:
    """When which faces were listed as tracked: some trackers go on sending the last pose of a face that they lost."""

    def __init__(self, messages: Iterable[BagMessage]) -> None:
        lists = [message for message in messages if message.topic == FACES]
        self._received_s = np.array([1e-9 * message.received_ns for message in lists])
        self._ids = [frozenset(message.content.ids) for message in lists]

    def checked(self, seen: Sighted) -> Sighted:
        """A face without the poses of which neither the list before nor the one after knows."""
        face = seen.name.removeprefix("face_")
        has = np.array([face in ids for ids in self._ids], dtype=np.bool_)
        if not (seen.name.startswith("face_") and has.any()):
            return seen
        after = np.searchsorted(self._received_s, seen.poses.times_s + seen.poses.delays_s)
        last = has.size - 1
        listed = has[np.clip(after - 1, 0, last)] | has[np.clip(after, 0, last)]
        return replace(seen, poses=seen.poses.chosen(listed), unlisted=int((~listed).sum()))


def _persons(messages: Iterable[BagMessage]) -> dict[str, str]:
    """Person by face."""
    found: dict[str, str] = {}
    for message in messages:
        person = person_of_topic(message.topic)
        if person is not None and message.content.data:
            found[message.content.data] = person
    return found


def _of_frame(frames: FrameTree, name: str, person: str | None) -> Sighted | None:
    """A person's frame in the nearest frame of no person; None where it never moves, or has no such frame."""
    own_id = name.partition("_")[2]
    way: list[tuple[tuple[str, str], bool]] = []
    here, been = name, {name}
    while here == name or is_person(here) or here.endswith(f"_{own_id}"):
        edges = [edge for edge in (*frames.moving, *frames.fixed) if edge[1] == here and edge[0] not in been]
        if not edges:
            return None
        # A frame has one parent; where two are told, the one told more often is it.
        edge = max(edges, key=lambda edge: len(frames.moving[edge].times_s) if edge in frames.moving else 0)
        way.append((edge, True))
        here = edge[0]
        been.add(here)
    moving = [edge for edge, _ in way if edge in frames.moving]
    if not moving:
        return None
    poses, repeated, unusable = usable(frames.moving[moving[0]])
    # Where the frame's own transform says all, it stays as it is.
    if len(way) > 1:
        position_m, turn, known = frames.along(way, poses.times_s)
        quats = turn.as_quat(scalar_first=True)
        poses = Poses(poses.times_s, poses.delays_s, position_m, quats).chosen(known)
        unusable += int((~known).sum())
    return Sighted(name, TF, person or own_id, here, poses, repeated, unusable)


def _joined(found: Sequence[Sighted]) -> list[Sighted]:
    """Faces of one person in one frame as one: a tracker that loses a face gives it a new id."""
    groups: dict[tuple[str, str, str], list[Sighted]] = defaultdict(list)
    for seen in found:
        groups[seen.person, seen.frame, seen.name.partition("_")[0]].append(seen)
    return [_join(group) if len(group) > 1 else group[0] for group in groups.values()]


def _join(group: Sequence[Sighted]) -> Sighted:
    fields = zip(
        *((s.poses.times_s, s.poses.delays_s, s.poses.position_m, s.poses.quat_wxyz) for s in group), strict=True
    )
    poses, repeated, _ = usable(Poses(*(np.concatenate(field) for field in fields)))
    first = group[0]
    return Sighted(
        name=f"{first.name.partition('_')[0]}_{first.person}",
        topic=TF,
        person=first.person,
        frame=first.frame,
        poses=poses,
        repeated=repeated + sum(seen.repeated for seen in group),
        unusable=sum(seen.unusable for seen in group),
        unlisted=sum(seen.unlisted for seen in group),
    )


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
            # All zeros is how ROS says that there is none.
            quat = (q.w, q.x, q.y, q.z) if any((q.w, q.x, q.y, q.z)) else quat
        at_ns = stamp_ns(content.header)
        rows.append((1e-9 * at_ns, 1e-9 * (message.received_ns - at_ns), point.x, point.y, point.z, *quat))
        frames.append(content.header.frame_id.lstrip("/"))
    frame = max(dict.fromkeys(frames), key=frames.count) if frames else ""
    same = np.array([name == frame for name in frames], dtype=np.bool_)
    poses, repeated, unusable = usable(poses_of(rows).chosen(same))
    # Who writes the identity into each message knows no orientation.
    if (poses.quat_wxyz == (1.0, 0.0, 0.0, 0.0)).all():
        poses = Poses(poses.times_s, poses.delays_s, poses.position_m, np.full_like(poses.quat_wxyz, np.nan))
    return Sighted(topic, topic, topic, frame, poses, repeated, unusable + int((~same).sum()))


_EXPECTED = (
    f"frames named {', '.join(f'{prefix}<id>' for prefix in PREFIXES)} in {TF}, as in ROS4HRI, or a topic of poses or "
    "points"
)


@dataclass(frozen=True)
class BagTrack:
    """One person over time, in the frame of the sensor.

    Attributes:
        frame_id: Name of the person's frame, such as ``face_23ed9``, or the topic.
        parent_id: Frame of the sensor that it is given in.
        optical: Whether that frame had optical axes, which were turned.
        times_s: Stamps, shape (N,), seconds, strictly increasing.
        delays_s: From the stamp to the message's arrival in the bag, shape (N,), seconds.
        position_m: Shape (N, 3), metres, in the sensor's frame, x forward, y left, z up.
        quat_wxyz: Orientation of the person's frame in that frame, shape (N, 4); NaN where not known.
        repeated: Messages with a stamp that had been there already; left out.
        unusable: Messages with a number that is not finite, or no orientation; left out.
    """

    frame_id: str
    parent_id: str
    optical: bool
    times_s: FloatArray
    delays_s: FloatArray
    position_m: FloatArray
    quat_wxyz: FloatArray
    repeated: int
    unusable: int


@dataclass(frozen=True)
class Bag:
    """What is in a bag.

    Attributes:
        path: Its folder.
        topics: Type of each topic.
        frames: FrameTree over time.
        people: What may be a person's head, the likeliest and longest first; at least one.
    """

    path: Path
    topics: Mapping[str, str]
    frames: FrameTree
    people: list[Sighted]


def read_bag_tracks(path: Path, tell: Callable[[float], None] = lambda share: None) -> tuple[BagTrack, ...]:
    """Read the tracks of people in a bag.

    Args:
        path: Folder of the bag.
        tell: Called with the share that is read, 0 to 1.

    Returns:
        A track for each person, the longest first. Where there are faces, heads, bodies and persons are not taken, and
        topics only where there are no such frames.

    Raises:
        RecordingError: If the folder is no bag, or has no person in it.
        MissingOptionalDependencyError: If rosbags is not installed.
    """
    bag = open_bag(path, tell)
    sensed = [seen for seen in bag.people if seen.frame not in FIXED_FRAMES]
    if not sensed:
        found = ", ".join(f"{seen.name} in {seen.frame}" for seen in bag.people)
        raise RecordingError(
            path,
            f"topic {TF}",
            f"no person is given in the frame of a sensor; found {found}",
            "face_<id> in a camera's frame",
        )
    return tuple(_track(seen) for seen in sensed if seen.rank[0] == sensed[0].rank[0])


def open_bag(path: Path, tell: Callable[[float], None] = lambda share: None) -> Bag:
    """Read a bag.

    Args:
        path: Folder of the bag, or a file of it.
        tell: Called with the share that is read, 0 to 1.

    Returns:
        What is in it.

    Raises:
        RecordingError: If this is no bag, or has no person in it.
        MissingOptionalDependencyError: If rosbags is not installed.
    """
    topics, messages = read_messages(path, tell)
    frames = FrameTree(messages)
    bag = Bag(path, topics, frames, people(frames, topics, messages))
    if bag.people:
        return bag
    tracked = sorted({name for message in messages if message.topic == FACES for name in message.content.ids})
    problem = f"no frame of a person; the bag's topics are {', '.join(topics) or 'none'}"
    if tracked and not any(name in frames.names for name in (f"face_{face}" for face in tracked)):
        problem += f". {FACES} lists {', '.join(tracked)}, but where they are was not recorded"
    raise RecordingError(path, f"topic {TF}", problem, _EXPECTED)


def _track(seen: Sighted) -> BagTrack:
    poses, optical = forward(seen.frame, seen.poses)
    return BagTrack(
        seen.name,
        seen.frame,
        optical,
        poses.times_s,
        poses.delays_s,
        poses.position_m,
        poses.quat_wxyz,
        seen.repeated,
        seen.unusable,
    )


def read_bag(path: Path, options: ReadOptions) -> Recording:
    """Read a bag: the longest track of a person in it, or the one that is chosen.

    The recording's frame is the sensor's, x forward, y left, z up, and the robot stands there. A frame such as ``map``
    is no sensor's; the robot then stands beside the walk. The truth is unknown: it is the track,
    smoothed without lag.

    Args:
        path: Folder of the bag, or a file of it.
        options: Topic, person, frame and axes, where others are meant.

    Returns:
        The recording, with notes of what else is in the bag.

    Raises:
        RecordingError: If this is no bag, no person is in it, or the track is too short.
        SettingsError: If the bag has no such topic, person or frame.
        MissingOptionalDependencyError: If rosbags is not installed.
    """
    bag = open_bag(path)
    seen = _chosen(bag, options)
    frame, axes, poses, notes = _in_frame(bag, seen, options)
    check_frame_count(Path(f"{path}: {seen.name} in {frame}"), poses.times_s.size, MIN_SEEN_FRAMES)
    times_s = poses.times_s - poses.times_s[0]
    check_frame_interval(path, times_s)
    check_head_travel(path, times_s, poses.position_m)
    every = np.ones(times_s.size, dtype=np.bool_)
    pelvis = _pelvis(bag, seen, frame, axes, poses.times_s)
    measured = Track(poses.position_m, poses.quat_wxyz, pelvis.position_m, pelvis.quat_wxyz, every)
    truth = replace(measured, head_position_m=smoothed(path, times_s, poses.position_m, every))
    name = path.stem if options.person is None else f"{path.stem}_{seen.person.strip('/').replace('/', '_')}"
    return Recording(
        name=name,
        source=str(path),
        kind="tracked",
        times_s=times_s,
        truth=truth,
        measured=measured,
        has_robot=frame not in FIXED_FRAMES,
        labels=_labels(path, seen, times_s, poses.position_m),
        notes=(*notes, *_listing(bag, seen)),
        delays_s=np.maximum(poses.delays_s, 0.0),
    )


def _labels(path: Path, seen: Sighted, times_s: FloatArray, position_m: FloatArray) -> Labels:
    """Labels as of any file; but ROS4HRI's persons are the same people in all bags of a robot."""
    labels = labels_for(path, times_s, position_m)
    from_index = labels.subject != path.stem.partition("_")[0]
    known = seen.topic == TF and seen.person != seen.name.partition("_")[2]
    return replace(labels, subject=seen.person) if known and not from_index else labels


def _chosen(bag: Bag, options: ReadOptions) -> Sighted:
    found = bag.people
    if options.bag_topic is not None:
        found = [seen for seen in found if seen.topic == options.bag_topic]
        if not found:
            topics = sorted({seen.topic for seen in bag.people})
            raise SettingsError(
                f"bag_topic: nobody on {options.bag_topic} in {bag.path}; {suggest(options.bag_topic, topics)}"
            )
    if options.person is not None:
        named = [seen for seen in found if seen.answers_to(options.person)]
        if not named:
            names = {name for seen in found for name in (seen.name, seen.person)}
            raise SettingsError(f"person: no {options.person!r} in {bag.path}; {suggest(options.person, names)}")
        return named[0]
    # Eyes are not between the hips.
    heads = [seen for seen in found if not seen.name.startswith("body_")]
    if not heads:
        raise RecordingError(
            bag.path,
            f"topic {TF}",
            f"only bodies: {', '.join(s.name for s in found)}",
            "a head; or the option person",
        )
    return heads[0]


def _in_frame(bag: Bag, seen: Sighted, options: ReadOptions) -> tuple[str, Axes, Poses, list[str]]:
    """The frame that is wanted, its axes, poses in it (x forward, z up; people's x out of the face), and notes."""
    goal = options.bag_frame or seen.frame
    moved, lost = (seen.poses, 0) if goal == seen.frame else _moved(bag, seen, goal)
    # People face the sensor, wherever the robot shall stand.
    own, _ = forward(seen.frame, seen.poses, options.bag_axes if goal == seen.frame else None)
    turn, note = person_axes(own, seen.frame not in FIXED_FRAMES, seen.name.startswith("face_"))
    poses, was_optical = forward(goal, moved, options.bag_axes)
    said = f"{seen.name}, {poses.times_s.size} frames in {goal}"
    said += ", optical axes turned to x forward, y left, z up" if was_optical else ", x forward, y left, z up"
    counted = [
        (seen.repeated, "repeat a stamp"),
        (seen.unusable, "have no finite pose"),
        (seen.unlisted, f"came while {FACES} did not list the face"),
        (lost, f"came while {goal} was not known"),
    ]
    notes = [
        f"{said} (the options bag_frame and bag_axes change it)",
        *([note] if note else []),
        *(f"{count} messages {what}: left out" for count, what in counted if count),
    ]
    if poses.times_s.size:
        notes.append(f"messages arrived {1e3 * np.median(poses.delays_s):.0f} ms after their stamp (median)")
    axes: Axes = "optical" if was_optical else "forward"
    return goal, axes, replace(poses, quat_wxyz=_after(poses.quat_wxyz, turn)), notes


def _after(quats_wxyz: FloatArray, turn: Rotation | None) -> FloatArray:
    """Orientations with a turn behind each; NaN where there is none."""
    turned = np.full_like(quats_wxyz, np.nan)
    known = np.isfinite(quats_wxyz).all(axis=1)
    if turn is not None and known.any():
        turned[known] = (Rotation.from_quat(quats_wxyz[known], scalar_first=True) * turn).as_quat(scalar_first=True)
    return turned


def _moved(bag: Bag, seen: Sighted, goal: str) -> tuple[Poses, int]:
    """Poses in another frame of the bag, and how many are lost."""
    way = bag.frames.way(seen.frame, goal)
    if way is None:
        joined = [name for name in bag.frames.names if bag.frames.way(seen.frame, name) is not None]
        others = [name for name in joined if not (is_person(name) or name.startswith("gaze_"))]
        raise SettingsError(f"bag_frame: no way from {seen.frame} to {goal!r} in {bag.path}; {suggest(goal, others)}")
    old = seen.poses
    shift_m, turn, known = bag.frames.along(way, old.times_s)
    quats, oriented = old.quat_wxyz.copy(), np.isfinite(old.quat_wxyz).all(axis=1)
    if oriented.any():
        of_person = Rotation.from_quat(quats[oriented], scalar_first=True)
        quats[oriented] = (turn[np.flatnonzero(oriented)] * of_person).as_quat(scalar_first=True)
    moved = Poses(old.times_s, old.delays_s, shift_m + turn.apply(old.position_m), quats)
    return moved.chosen(known), int((~known).sum())


def _pelvis(bag: Bag, seen: Sighted, frame: str, axes: Axes, times_s: FloatArray) -> Poses:
    """Poses between the hips where the skeleton of the head is known, else NaN."""
    unknown = Poses(
        times_s, np.zeros_like(times_s), np.full((times_s.size, 3), np.nan), np.full((times_s.size, 4), np.nan)
    )
    own_id = seen.name.removeprefix("head_")
    way = bag.frames.way(f"body_{own_id}", frame) if seen.name.startswith("head_") else None
    if way is None:
        return unknown
    position_m, turn, known = bag.frames.along(way, times_s)
    poses, _ = forward(frame, replace(unknown, position_m=position_m, quat_wxyz=turn.as_quat(scalar_first=True)), axes)
    return Poses(
        times_s,
        unknown.delays_s,
        np.where(known[:, None], poses.position_m, np.nan),
        np.where(known[:, None], poses.quat_wxyz, np.nan),
    )


def _listing(bag: Bag, seen: Sighted) -> Sequence[str]:
    """What else is in the bag, for people."""

    def said(other: Sighted) -> str:
        person = "" if other.person in other.name else f" of {other.person}"
        return f"{other.name}{person} ({other.poses.times_s.size} in {other.frame})"

    others = [said(other) for other in bag.people if other is not seen]
    topics = [name for name, kind in bag.topics.items() if kind in POSE_TYPES or name in (TF, FACES)]
    rest = len(bag.topics) - len(topics)
    return [
        *([f"also in the bag: {', '.join(others)}; the options person and bag_topic choose"] if others else []),
        f"topics: {', '.join(topics)}{f' and {rest} others' if rest else ''}",
    ]
