"""ROS 2 bags: tracks of people's frames in `/tf`, as ROS4HRI has them (`face_<id>` in the frame of a camera)."""

from __future__ import annotations

import sqlite3
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import MissingOptionalDependencyError, RecordingError
from gazempc.types import FloatArray

# Frames of people in the order of preference: a face is measured, a person is derived from faces and bodies.
_PREFIXES = ("face_", "head_", "body_", "person_")
_TF = "/tf"
_EXPECTED = "the folder of a ROS 2 bag (metadata.yaml, and .db3 or .mcap files)"
# Frames that no sensor is the origin of: what is along the line of sight is not known there.
_FIXED = ("map", "odom", "world", "earth")
# Optical axes (x right, y down, z forward) to x forward, y left, z up.
_FROM_OPTICAL = Rotation.from_matrix([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
# Definitions that no standard type store has.
_OWN_TYPES = {"hri_msgs/msg/IdsList": "std_msgs/Header header\nstring[] ids"}


@dataclass(frozen=True)
class BagTrack:
    """One frame of a person over time.

    Attributes:
        frame_id: Name of the frame, such as ``face_23ed9``.
        parent_id: Frame of the sensor that it is given in.
        optical: Whether that frame had optical axes, which were turned.
        times_s: Stamps, shape (N,), seconds, strictly increasing.
        delays_s: From the stamp to the message's arrival in the bag, shape (N,), seconds.
        position_m: Shape (N, 3), metres, in the sensor's frame, x forward, y left, z up.
        quat_wxyz: Orientation of the person's frame in that frame, shape (N, 4).
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


def read_bag_tracks(path: Path, tell: Callable[[float], None] = lambda share: None) -> tuple[BagTrack, ...]:
    """Read the tracks of people in a bag.

    Args:
        path: Folder of the bag.
        tell: Called with the share that is read, 0 to 1.

    Returns:
        A track for each frame of a person, the longest first. Where there are faces, heads, bodies and persons are
        not taken.

    Raises:
        RecordingError: If the folder is no bag, or nobody is in it.
        MissingOptionalDependencyError: If rosbags is not installed.
    """
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError  # noqa: PLC0415 - optional
        from rosbags.rosbag2 import ReaderError  # noqa: PLC0415 - optional
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415 - optional
    except ImportError:
        raise MissingOptionalDependencyError("Reading ROS 2 bags", "rosbags", "bags") from None
    store = get_typestore(Stores.ROS2_FOXY)
    for name, definition in _OWN_TYPES.items():
        store.register(get_types_from_msg(definition, name))
    rows: dict[tuple[str, str], list[tuple[float, ...]]] = defaultdict(list)
    try:
        with AnyReader([path], default_typestore=store) as reader:
            topics = sorted(reader.topics)
            wanted = [c for c in reader.connections if c.topic == _TF]
            total = max(1, sum(c.msgcount for c in wanted))
            for k, (connection, received_ns, raw) in enumerate(reader.messages(wanted) if wanted else ()):
                tell(k / total)
                message: Any = reader.deserialize(raw, connection.msgtype)
                for transform in message.transforms:
                    parent, child = (name.lstrip("/") for name in (transform.header.frame_id, transform.child_frame_id))
                    if child.startswith(_PREFIXES):
                        rows[parent, child].append(_row(transform, received_ns))
    except (AnyReaderError, ReaderError, sqlite3.Error, OSError, KeyError, ValueError) as error:
        raise RecordingError(path, "", f"cannot be read ({_first_line(error)})", _EXPECTED) from None
    if not rows:
        raise RecordingError(
            path,
            "topic /tf",
            f"no frame of a person; the bag's topics are {', '.join(topics) or 'none'}",
            f"frames named {', '.join(f'{prefix}<id>' for prefix in _PREFIXES)}, as in ROS4HRI",
        )
    return _best_tracks(path, rows)


def _row(transform: Any, received_ns: int) -> tuple[float, ...]:
    """Stamp, delay, position and quaternion of one transform."""
    header, pose = transform.header, transform.transform
    p, q = pose.translation, pose.rotation
    stamp_ns = header.stamp.sec * 10**9 + header.stamp.nanosec
    return (1e-9 * stamp_ns, 1e-9 * (received_ns - stamp_ns), p.x, p.y, p.z, q.w, q.x, q.y, q.z)


def _best_tracks(path: Path, rows: dict[tuple[str, str], list[tuple[float, ...]]]) -> tuple[BagTrack, ...]:
    """Tracks of the first prefix that is in a sensor's frame, the longest first."""
    sensed = {key: values for key, values in rows.items() if key[0] not in _FIXED}
    for prefix in _PREFIXES:
        chosen = [_track(*key, np.array(values)) for key, values in sensed.items() if key[1].startswith(prefix)]
        if chosen := [track for track in chosen if track.times_s.size]:
            return tuple(sorted(chosen, key=lambda track: -track.times_s.size))
    found = ", ".join(f"{child} in {parent}" for parent, child in rows)
    raise RecordingError(
        path,
        "topic /tf",
        f"no person is given in the frame of a sensor; found {found}",
        "face_<id> in a camera's frame",
    )


def _track(parent: str, child: str, rows: FloatArray) -> BagTrack:
    usable = np.isfinite(rows).all(axis=1) & (np.linalg.norm(rows[:, 5:9], axis=1) > 0.5)
    unusable, rows = int((~usable).sum()), rows[usable]
    times_s, first = np.unique(rows[:, 0], return_index=True)
    repeated, rows = len(rows) - len(first), rows[first]
    position_m, turn = rows[:, 2:5], Rotation.from_quat(rows[:, 5:9], scalar_first=True) if len(rows) else None
    # Cameras are not always named by the convention: people are in front of them, along z or along x.
    optical = "optical" in parent or bool(len(rows) and np.median(position_m[:, 2]) > np.median(position_m[:, 0]))
    if optical and turn is not None:
        position_m, turn = _FROM_OPTICAL.apply(position_m), _FROM_OPTICAL * turn
    quats = turn.as_quat(scalar_first=True) if turn is not None else np.zeros((0, 4))
    return BagTrack(child, parent, optical, times_s, rows[:, 1], position_m, quats, repeated, unusable)


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0].rstrip(".") if lines else type(error).__name__
