"""Recordings of people from a ROS 2 bag."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from gazempc.errors import RecordingError, SettingsError, suggest
from gazempc.recordings.readers.bag_frames import FIXED_FRAMES, Axes, FrameTree, Poses, forward, person_axes
from gazempc.recordings.readers.bag_messages import FACES, TF, read_messages
from gazempc.recordings.readers.bag_people import PREFIXES, Sighted, is_person, people_in
from gazempc.recordings.readers.checks import recording_of
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.recording import Recording, Track, composed
from gazempc.types import FloatArray

_EXPECTED = (
    f"frames named {', '.join(f'{prefix}<id>' for prefix in PREFIXES)} in {TF}, as in ROS4HRI, or a topic of poses or "
    "points"
)


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
        One recording per person, on one clock.

    Raises:
        GazempcError: As for `read_bag`.
    """
    frames, found = _open(path)
    alike = [seen for seen in found if seen.rank[0] == found[0].rank[0] and seen.poses.times_s.size > 1]
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
    raise RecordingError(path, f"topic {TF}", problem, _EXPECTED)


def _recording(path: Path, frames: FrameTree, people: list[Sighted], seen: Sighted, options: ReadOptions) -> Recording:
    frame, axes, poses, notes = _in_frame(path, frames, seen, options)
    if not poses.times_s.size:
        raise RecordingError(f"{path}: {seen.name} in {frame}", "", "no pose", "at least one pose in that frame")
    track = Track(poses.position_m, poses.quat_wxyz, *_pelvis(frames, seen, frame, axes, poses.times_s))
    others = [f"{other.name} ({other.poses.times_s.size} in {other.frame})" for other in people if other is not seen]
    if others:
        notes.append(f"also in the bag: {', '.join(others)}; select by the options person and bag_topic")
    times_s = poses.times_s - poses.times_s[0]
    found = recording_of(path, times_s, track, "tracked", frame not in FIXED_FRAMES, notes=notes)
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
        named = [seen for seen in found if seen.answers_to(options.person)]
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


def _in_frame(path: Path, frames: FrameTree, seen: Sighted, options: ReadOptions) -> tuple[str, Axes, Poses, list[str]]:
    """Target frame, its axes, the poses in it (x forward, z up; people's x out of the face), and notes."""
    goal = options.bag_frame or seen.frame
    moved, lost = (seen.poses, 0) if goal == seen.frame else _moved(path, frames, seen.poses, seen.frame, goal)
    # The person's axes are inferred in the sensor's frame, because people face the sensor.
    own, _ = forward(seen.frame, seen.poses, options.bag_axes if goal == seen.frame else None)
    is_sensor, is_face = seen.frame not in FIXED_FRAMES, seen.name.startswith("face_")
    turn, note = person_axes(own.position_m, own.quat_wxyz, is_sensor, is_face)
    poses, was_optical = forward(goal, moved, options.bag_axes)
    about = f"{seen.name}, {poses.times_s.size} frames in {goal}"
    about += ", optical axes rotated to x forward, y left, z up" if was_optical else ", x forward, y left, z up"
    notes = [f"{about} (the options bag_frame and bag_axes change it)", *([note] if note else [])]
    if left_out := seen.left_out + lost:
        notes.append(
            f"{left_out} messages repeat a stamp, have no finite pose, or came while {FACES} did not list the face or "
            f"{goal} was unknown: left out"
        )
    if poses.times_s.size:
        notes.append(f"messages arrived {1e3 * np.median(poses.delays_s):.0f} ms after their stamp (median)")
    axes: Axes = "optical" if was_optical else "forward"
    return goal, axes, replace(poses, quat_wxyz=turn(poses.quat_wxyz)), notes


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
    way = None
    if seen.name.startswith("head_"):
        way = frames.way(f"body_{seen.name.removeprefix('head_')}", frame)
    if way is None:
        return np.full((times_s.size, 3), np.nan), np.full((times_s.size, 4), np.nan)
    position_m, turn, known = frames.along(way, times_s)
    quats = turn.as_quat(scalar_first=True)
    poses, _ = forward(frame, Poses(times_s, np.zeros_like(times_s), position_m, quats), axes)
    return np.where(known[:, None], poses.position_m, np.nan), np.where(known[:, None], poses.quat_wxyz, np.nan)
