"""A person in a ROS 2 bag as a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError, SettingsError, suggest
from gazempc.recordings.readers.bag import Bag, open_bag
from gazempc.recordings.readers.bag_axes import Axes, forward, person_axes
from gazempc.recordings.readers.bag_frames import Poses
from gazempc.recordings.readers.bag_messages import FACES, POSE_TYPES, TF
from gazempc.recordings.readers.bag_people import FIXED_FRAMES, Sighted, is_person
from gazempc.recordings.readers.checks import check_frame_count, check_frame_interval
from gazempc.recordings.readers.labels import labels_for
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.readers.position_checks import check_head_travel
from gazempc.recordings.readers.smoothing import MIN_SEEN_FRAMES, smoothed
from gazempc.recordings.recording import Labels, Recording, Track
from gazempc.types import FloatArray


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
