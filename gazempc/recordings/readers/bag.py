"""People in a ROS 2 bag, and a person in it as a recording.

Names and axes of people's frames are those of ROS4HRI (REP 155): ``face_<id>`` between the eyes and ``head_<id>``, both
with x out of the face and z up; ``person_<id>`` at the face or the head; ``body_<id>`` between the hips.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gazempc.errors import RecordingError, SettingsError, suggest
from gazempc.recordings.readers.bag_frames import (
    FIXED_FRAMES,
    Axes,
    FrameTree,
    Poses,
    composed,
    forward,
    person_axes,
)
from gazempc.recordings.readers.bag_messages import (
    FACES,
    POSE_TYPES,
    TF,
    read_messages,
)
from gazempc.recordings.readers.bag_people import PREFIXES, Sighted, is_person, people
from gazempc.recordings.readers.checks import recording_of
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.recording import Recording, Track
from gazempc.types import FloatArray

_EXPECTED = (
    f"frames named {', '.join(f'{prefix}<id>' for prefix in PREFIXES)} in {TF}, as in ROS4HRI, or a topic of poses or "
    "points"
)


@dataclass(frozen=True)
class Bag:
    """Content of a bag.

    Attributes:
        path: Its folder.
        topics: Type of each topic.
        frames: FrameTree over time.
        people: Possible heads of people, the likeliest and longest first; at least one.
    """

    path: Path
    topics: Mapping[str, str]
    frames: FrameTree
    people: list[Sighted]


def read_bag_tracks(path: Path, tell: Callable[[float], None] = lambda share: None) -> list[tuple[Sighted, bool]]:
    """Read the tracks of people in a bag.

    Args:
        path: Folder of the bag.
        tell: Called with the share that is read, 0 to 1.

    Returns:
        For each person the track in the sensor's frame, x forward, y left, z up, and whether that frame had optical
        axes, which were turned; the longest first. Where there are faces, heads, bodies and persons are not taken, and
        topics only where there are no such frames.

    Raises:
        RecordingError: If the folder is no bag, or has no person in it.
        MissingOptionalDependencyError: If rosbags is not installed.
    """
    bag = open_bag(path, tell)
    sensed = [seen for seen in bag.people if seen.frame not in FIXED_FRAMES]
    if not sensed:
        found = ", ".join(f"{seen.name} in {seen.frame}" for seen in bag.people)
        problem = f"no person is given in the frame of a sensor; found {found}"
        raise RecordingError(path, f"topic {TF}", problem, "face_<id> in a camera's frame")
    turned = [(seen, *forward(seen.frame, seen.poses)) for seen in sensed if seen.rank[0] == sensed[0].rank[0]]
    return [(replace(seen, poses=poses), optical) for seen, poses, optical in turned]


def open_bag(path: Path, tell: Callable[[float], None] = lambda share: None) -> Bag:
    """Read a bag.

    Args:
        path: Folder of the bag, or a file of it.
        tell: Called with the share that is read, 0 to 1.

    Returns:
        Its content.

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
    if not poses.times_s.size:
        raise RecordingError(f"{path}: {seen.name} in {frame}", "", "no frame", "at least one in that frame")
    pelvis = _pelvis(bag, seen, frame, axes, poses.times_s)
    every = np.ones(poses.times_s.size, dtype=np.bool_)
    track = Track(poses.position_m, poses.quat_wxyz, pelvis.position_m, pelvis.quat_wxyz, every)
    times_s, has_robot = poses.times_s - poses.times_s[0], frame not in FIXED_FRAMES
    found = recording_of(path, times_s, track, "tracked", has_robot, notes=(*notes, *_listing(bag, seen)))
    name, labels = path.stem, found.labels
    if options.person is not None:
        name = f"{name}_{seen.person.strip('/').replace('/', '_')}"
    # ROS4HRI's persons are the same people in all bags of a robot; an index beside the bag wins.
    is_person_id = seen.topic == TF and seen.person != seen.name.partition("_")[2]
    if is_person_id and labels.subject == path.stem.partition("_")[0]:
        labels = replace(labels, subject=seen.person)
    return replace(found, name=name, labels=labels, delays_s=np.maximum(poses.delays_s, 0.0))


def _chosen(bag: Bag, options: ReadOptions) -> Sighted:
    found = bag.people
    if options.bag_topic is not None:
        found = [seen for seen in found if seen.topic == options.bag_topic]
        if not found:
            topics = sorted({seen.topic for seen in bag.people})
            near = suggest(options.bag_topic, topics)
            raise SettingsError(f"bag_topic: no person on {options.bag_topic} in {bag.path}; {near}")
    if options.person is not None:
        named = [seen for seen in found if seen.answers_to(options.person)]
        if not named:
            names = {name for seen in found for name in (seen.name, seen.person)}
            raise SettingsError(f"person: no {options.person!r} in {bag.path}; {suggest(options.person, names)}")
        return named[0]
    # Eyes are not between the hips.
    heads = [seen for seen in found if not seen.name.startswith("body_")]
    if not heads:
        problem = f"only bodies: {', '.join(s.name for s in found)}"
        raise RecordingError(bag.path, f"topic {TF}", problem, "a head; or the option person")
    return heads[0]


def _in_frame(bag: Bag, seen: Sighted, options: ReadOptions) -> tuple[str, Axes, Poses, list[str]]:
    """The frame that is wanted, its axes, poses in it (x forward, z up; people's x out of the face), and notes."""
    goal = options.bag_frame or seen.frame
    moved, lost = (seen.poses, 0) if goal == seen.frame else _moved(bag, seen, goal)
    # People face the sensor, wherever the robot shall stand.
    own, _ = forward(seen.frame, seen.poses, options.bag_axes if goal == seen.frame else None)
    turn, note = person_axes(own, seen.frame not in FIXED_FRAMES, seen.name.startswith("face_"))
    poses, was_optical = forward(goal, moved, options.bag_axes)
    about = f"{seen.name}, {poses.times_s.size} frames in {goal}"
    about += ", optical axes turned to x forward, y left, z up" if was_optical else ", x forward, y left, z up"
    counted = [
        (seen.repeated, "repeat a stamp"),
        (seen.unusable, "have no finite pose"),
        (seen.unlisted, f"came while {FACES} did not list the face"),
        (lost, f"came while {goal} was not known"),
    ]
    notes = [
        f"{about} (the options bag_frame and bag_axes change it)",
        *([note] if note else []),
        *(f"{count} messages {what}: left out" for count, what in counted if count),
    ]
    if poses.times_s.size:
        notes.append(f"messages arrived {1e3 * np.median(poses.delays_s):.0f} ms after their stamp (median)")
    axes: Axes = "optical" if was_optical else "forward"
    return goal, axes, replace(poses, quat_wxyz=composed(poses.quat_wxyz, turn)), notes


def _moved(bag: Bag, seen: Sighted, goal: str) -> tuple[Poses, int]:
    """Poses in another frame of the bag, and how many are lost."""
    way = bag.frames.way(seen.frame, goal)
    if way is None:
        joined = [name for name in bag.frames.names if bag.frames.way(seen.frame, name) is not None]
        others = [name for name in joined if not (is_person(name) or name.startswith("gaze_"))]
        raise SettingsError(f"bag_frame: no way from {seen.frame} to {goal!r} in {bag.path}; {suggest(goal, others)}")
    old = seen.poses
    shift_m, turn, known = bag.frames.along(way, old.times_s)
    quats = composed(old.quat_wxyz, first=turn)
    moved = Poses(old.times_s, old.delays_s, shift_m + turn.apply(old.position_m), quats)
    return moved.chosen(known), int((~known).sum())


def _pelvis(bag: Bag, seen: Sighted, frame: str, axes: Axes, times_s: FloatArray) -> Poses:
    """Poses between the hips where the skeleton of the head is known, else NaN."""
    count = times_s.size
    unknown = Poses(times_s, np.zeros(count), np.full((count, 3), np.nan), np.full((count, 4), np.nan))
    own_id = seen.name.removeprefix("head_")
    way = bag.frames.way(f"body_{own_id}", frame) if seen.name.startswith("head_") else None
    if way is None:
        return unknown
    position_m, turn, known = bag.frames.along(way, times_s)
    poses, _ = forward(frame, replace(unknown, position_m=position_m, quat_wxyz=turn.as_quat(scalar_first=True)), axes)
    poses.position_m[~known] = np.nan
    poses.quat_wxyz[~known] = np.nan
    return poses


def _listing(bag: Bag, seen: Sighted) -> Sequence[str]:
    """Notes on the rest of the bag."""

    def described(other: Sighted) -> str:
        person = "" if other.person in other.name else f" of {other.person}"
        return f"{other.name}{person} ({other.poses.times_s.size} in {other.frame})"

    others = [described(other) for other in bag.people if other is not seen]
    topics = [name for name, kind in bag.topics.items() if kind in POSE_TYPES or name in (TF, FACES)]
    rest = len(bag.topics) - len(topics)
    return [
        *([f"also in the bag: {', '.join(others)}; the options person and bag_topic choose"] if others else []),
        f"topics: {', '.join(topics)}{f' and {rest} others' if rest else ''}",
    ]
