"""Recordings from Azure Kinect Body Tracking: `offline_processor` JSON.

The file's frame is the depth camera's (x right, y down, z forward; millimetres); a joint's own axes are +X up, +Y
forward, +Z to the person's left. Both are rotated to this package's: x forward, y left, z up. The joints' axes are
undocumented; loading checks them against the face.

Frame numbers are indices of the file's list ``frames``, from 0.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydantic import BaseModel, Field, ValidationError
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError
from gazempc.files.bounds import read_text
from gazempc.recordings.readers.checks import (
    Place,
    check_finite,
    check_times_increase,
    check_unit_quaternions,
    recording_of,
)
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.recording import Recording, Track
from gazempc.types import FloatArray

JOINTS = ("PELVIS", "HEAD", "NOSE", "EAR_LEFT", "EAR_RIGHT")
_MAX_AXIS_ERROR_DEG = 60.0
_LEVEL_FROM_CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
_PERSON_IN_JOINT = Rotation.from_matrix([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
# An hour at 30 Hz with one body has 7 million; each takes some 60 bytes of memory or more.
_MOST_LISTS = 10_000_000
# The tool writes the names of bones and joints first; they have 1 kB.
_BEGINNING_BYTES = 65_536
_FORMAT = "Azure Kinect body tracking JSON (offline_processor)"
_NOTE = "; the format has microseconds and millimetres; the option kinect_camera_pitch_deg turns the axes"
_Number = float | None  # the tool writes null for NaN


class _Body(BaseModel, strict=True):
    body_id: int
    joint_positions: list[tuple[_Number, _Number, _Number]]
    joint_orientations: list[tuple[_Number, _Number, _Number, _Number]]


class _Frame(BaseModel, strict=True):
    timestamp_usec: float = Field(ge=-(2.0**63), le=2.0**63)
    bodies: list[_Body]


class _File(BaseModel, strict=True):
    joint_names: list[str]
    frames: list[_Frame] = Field(min_length=1)


def is_kinect(path: Path) -> bool:
    """Whether a JSON file begins like a body tracking file.

    Args:
        path: The file.
    """
    with path.open("rb") as file:
        beginning = file.read(_BEGINNING_BYTES)
    return any(key in beginning for key in (b'"frames"', b'"joint_names"', b'"bone_list"'))


def read_kinect(path: Path, options: ReadOptions) -> Recording:
    """Read a body tracking file.

    The robot's frame is the depth camera's, levelled: x forward, y left, z up. Time is 0 at the
    body's first sighting; later frames without the body are kept as not valid.

    Args:
        path: File to read.
        options: Body, head joint and the camera's pitch.

    Returns:
        The recording, with the robot in its frame's origin.

    Raises:
        RecordingError: If the file is not such JSON, the body is missing, the values are damaged or in
            other units, or the head's axes disagree with the face.
    """
    file = _parse(path)
    times_usec = np.array([frame.timestamp_usec for frame in file.frames])
    check_times_increase(path, times_usec, "frame {}".format)
    bodies = [_bodies(path, index, frame) for index, frame in enumerate(file.frames)]
    chosen = _choose(path, bodies, options.kinect_body_id)
    seen = np.array([index for index, found in enumerate(bodies) if chosen in found])
    tracked = [bodies[index][chosen] for index in seen]

    def place(row: int) -> str:
        return f"frame {seen[row]}, body {chosen}"

    positions_mm = _joints(path, file.joint_names, "joint_positions", [body.joint_positions for body in tracked], place)
    quats = _joints(path, file.joint_names, "joint_orientations", [body.joint_orientations for body in tracked], place)
    for name, values in quats.items():
        check_unit_quaternions(path, values, f"{name} joint_orientations (w,x,y,z)", place)
    # Pitch up is a negative rotation about +y (left), as a positive one takes x to -z.
    level = Rotation.from_euler("y", -options.kinect_camera_pitch_deg, degrees=True)
    level *= Rotation.from_matrix(_LEVEL_FROM_CAMERA)
    head = options.kinect_head_joint.upper()
    names = (head, "PELVIS")
    turns = [level * Rotation.from_quat(quats[name], scalar_first=True) * _PERSON_IN_JOINT for name in names]
    face = positions_mm["NOSE"] - 0.5 * (positions_mm["EAR_LEFT"] + positions_mm["EAR_RIGHT"])
    _check_head_axes(path, head, turns[0], level.apply(face))
    head_m, pelvis_m = (1e-3 * level.apply(positions_mm[name]) for name in names)
    head_quat, pelvis_quat = (turn.as_quat(scalar_first=True) for turn in turns)
    # Frames without the body take the last row, which is unknown.
    rows = np.full(seen[-1] + 1 - seen[0], -1)
    rows[seen - seen[0]] = np.arange(seen.size)
    parts = (head_m, head_quat, pelvis_m, pelvis_quat)
    track = Track(*(np.pad(part, ((0, 1), (0, 0)), constant_values=np.nan)[rows] for part in parts))
    times_s = (times_usec[seen[0] : seen[-1] + 1] - times_usec[seen[0]]) * 1e-6
    return recording_of(path, times_s, track, "body tracking", has_robot=True, note=_NOTE)


def _parse(path: Path) -> _File:
    text = read_text(path, _FORMAT)
    if (found := text.count("[") + text.count("{")) > _MOST_LISTS:
        raise RecordingError(path, "", f"too many lists and objects: {found}", f"{_MOST_LISTS} at most")
    try:
        file = _File.model_validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"])).replace("frames.", "frame ", 1).replace(".", ", ", 1)
        raise RecordingError(path, where, first["msg"], _FORMAT) from None
    for name in JOINTS:
        if name not in file.joint_names:
            raise RecordingError(path, "joint_names", f"no joint {name}", f"the joints {', '.join(JOINTS)}")
    return file


def _bodies(path: Path, index: int, frame: _Frame) -> dict[int, _Body]:
    """Bodies of a frame by id."""
    found = {body.body_id: body for body in frame.bodies}
    if len(found) < len(frame.bodies):
        raise RecordingError(path, f"frame {index}", "two bodies with the same id", "each body once")
    return found


def _choose(path: Path, bodies: list[dict[int, _Body]], body_id: int | None) -> int:
    """Id of the body to read: the requested one, else the one in most frames (of several, the lowest id)."""
    counts = Counter(seen_id for found in bodies for seen_id in found)
    if not counts:
        raise RecordingError(path, "frames", f"no body in any of {len(bodies)} frames", "a tracked body")
    if body_id is None:
        return min(counts, key=lambda seen_id: (-counts[seen_id], seen_id))
    if body_id not in counts:
        ids = ", ".join(f"{seen_id} ({counts[seen_id]} frames)" for seen_id in sorted(counts))
        raise RecordingError(path, "frames", f"no body with id {body_id}", f"one of the ids {ids}")
    return body_id


def _joints(
    path: Path, names: list[str], field: str, frames: Sequence[Sequence[Sequence[_Number]]], place: Place
) -> dict[str, FloatArray]:
    """Values of each of `JOINTS` in the frames with the body, shape (N, C)."""
    for row, entries in enumerate(frames):
        if len(entries) != len(names):
            problem = f"{len(entries)} {field} for {len(names)} joint_names"
            raise RecordingError(path, place(row), problem, f"{len(names)} {field}, one per joint")
    found, axes = {}, "xyz" if field == "joint_positions" else "wxyz"
    for joint in JOINTS:
        column = names.index(joint)
        found[joint] = np.array([entries[column] for entries in frames], dtype=np.float64)
        check_finite(path, found[joint], [f"{joint} {field} {axis}" for axis in axes], place)
    return found


def _check_head_axes(path: Path, joint: str, head: Rotation, face: FloatArray) -> None:
    """Reject a head whose axes are over 60 degrees (median) from the face, nose minus ears, and from up."""
    forward_deg = _median_angle_deg(head.apply([1.0, 0.0, 0.0]), face)
    up_deg = _median_angle_deg(head.apply([0.0, 0.0, 1.0]), np.array([[0.0, 0.0, 1.0]]))
    if max(forward_deg, up_deg) >= _MAX_AXIS_ERROR_DEG:
        problem = (
            f"its forward axis is {forward_deg:.0f} deg from the face (nose minus the ears' midpoint) "
            f"and its up axis {up_deg:.0f} deg from up (medians)"
        )
        expected = f"both under {_MAX_AXIS_ERROR_DEG:.0f} deg, with the joint's axes +X up, +Y facing, +Z left"
        raise RecordingError(path, f"joint {joint}", problem, expected)


def _median_angle_deg(a: FloatArray, b: FloatArray) -> float:
    cross = np.linalg.norm(np.cross(a, b), axis=1)
    return float(np.degrees(np.median(np.arctan2(cross, np.sum(a * b, axis=1)))))
