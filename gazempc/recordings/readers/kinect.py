"""Recordings from Azure Kinect Body Tracking: `offline_processor` JSON.

The file's frame is the depth camera's (x right, y down, z forward; millimetres); a joint's own axes are +X
up, +Y where the person faces, +Z to the person's left. Both are turned to this package's: x forward, y left,
z up. The joints' axes are nowhere documented, so they are checked against the face at load.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError
from gazempc.recordings.readers.checks import (
    MIN_SEEN_FRAMES,
    check_finite,
    check_frame_count,
    check_frame_interval,
    check_head_to_pelvis,
    check_times_increase,
    check_unit_quaternions,
    check_upright,
    smoothed,
)
from gazempc.recordings.readers.labels import labels_for
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.readers.text import read_text
from gazempc.recordings.recording import Recording, Track
from gazempc.types import BoolArray, FloatArray

JOINTS = ("PELVIS", "HEAD", "NOSE", "EAR_LEFT", "EAR_RIGHT")

# An hour at 30 Hz with one body has 7 million; each takes some 60 bytes of memory or more.
_MOST_LISTS = 10_000_000
_FORMAT = "Azure Kinect body tracking JSON (offline_processor)"


@dataclass(frozen=True)
class BodyTrack:
    """Joints of one body from its first to its last sighting, in the file's frame and units.

    Attributes:
        times_usec: Shape (N,), device time stamps, microseconds.
        position_camera_mm: For each of JOINTS, shape (N, 3), millimetres, depth camera's frame.
        quat_camera_wxyz: For each of JOINTS, shape (N, 4), joint's axes in the depth camera's frame.
        seen: Shape (N,); rows of the joints are NaN where it is False.
    """

    times_usec: FloatArray
    position_camera_mm: dict[str, FloatArray]
    quat_camera_wxyz: dict[str, FloatArray]
    seen: BoolArray


def read_body(path: Path, body_id: int | None) -> BodyTrack:
    """Read one body's track.

    Args:
        path: File to read.
        body_id: Which body; None takes the one seen in most frames.

    Returns:
        Its joints.

    Raises:
        RecordingError: If the file is not such JSON, holds no (such) body, or the body's values are not
            finite numbers and unit quaternions for each joint.
    """
    document = _parse(path)
    names = _key(path, "", document, "joint_names", list)
    for name in JOINTS:
        if name not in names:
            raise RecordingError(path, "joint_names", f"no joint {name}", f"the joints {', '.join(JOINTS)}")
    frames = _key(path, "", document, "frames", list)
    if not frames:
        raise RecordingError(path, "frames", "the list is empty", "a list of frames")
    times_usec = np.array([_time_usec(path, index, frame) for index, frame in enumerate(frames)])
    check_times_increase(path, times_usec, lambda index: f"frame {index}")
    bodies = [_bodies(path, index, frame) for index, frame in enumerate(frames)]
    chosen = _choose(path, bodies, body_id)
    sightings = [index for index, found in enumerate(bodies) if chosen in found]
    first, last = sightings[0], sightings[-1]
    span = bodies[first : last + 1]
    track = _joints(path, span, first, chosen, names)
    return BodyTrack(times_usec[first : last + 1], *track)


def _parse(path: Path) -> dict[str, Any]:
    """Parse the file's JSON object."""
    text = read_text(path, _FORMAT)
    if (found := text.count("[") + text.count("{")) > _MOST_LISTS:
        raise RecordingError(path, "", f"not JSON of frames: {found} lists and objects", f"{_MOST_LISTS} at most")
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        cut = " (the file may be cut off)" if not text[error.pos :].strip() else ""
        raise RecordingError(path, place, f"not JSON: {error.msg}{cut}", _FORMAT) from None
    except ValueError:
        raise RecordingError(path, "", "not JSON: a whole number of thousands of digits", _FORMAT) from None
    except RecursionError:
        raise RecordingError(path, "", "not JSON: nested too deeply", _FORMAT) from None
    if not isinstance(document, dict):
        raise RecordingError(path, "", "the JSON is not an object", f"{_FORMAT}: joint_names, frames")
    return document


def _key(path: Path, where: str, mapping: Any, key: str, kind: type) -> Any:
    """Value of a key that has to be there with a given type."""
    names = {list: "a list", int: "a whole number"}
    if not isinstance(mapping, dict):
        raise RecordingError(path, where, "not a JSON object", f"an object with the key {key!r}")
    if key not in mapping:
        raise RecordingError(path, where, f"the key {key!r} is missing", f"{_FORMAT} with {key!r}")
    value = mapping[key]
    if not isinstance(value, kind) or isinstance(value, bool):
        raise RecordingError(path, where, f"{key!r} is not {names[kind]}", f"{names[kind]}")
    return value


def _time_usec(path: Path, index: int, frame: Any) -> float:
    """Time stamp of a frame."""
    where = f"frame {index}"
    value = frame.get("timestamp_usec") if isinstance(frame, dict) else None
    if isinstance(value, float):
        return value  # not what the tool writes, but it still says when
    value = _key(path, where, frame, "timestamp_usec", int)
    if abs(value) > 2**63:
        raise RecordingError(path, where, "'timestamp_usec' is too large", "microseconds as a 64-bit number")
    return float(value)


def _bodies(path: Path, index: int, frame: Any) -> dict[int, Any]:
    """Bodies of a frame by id."""
    found: dict[int, Any] = {}
    for body in _key(path, f"frame {index}", frame, "bodies", list):
        body_id = _key(path, f"frame {index}, a body", body, "body_id", int)
        if body_id in found:
            raise RecordingError(path, f"frame {index}", f"body {body_id} stands there twice", "each body once")
        found[body_id] = body
    return found


def _choose(path: Path, bodies: list[dict[int, Any]], body_id: int | None) -> int:
    """Id of the body to read: the wanted one, or the one in most frames (of several, the lowest id)."""
    counts: dict[int, int] = {}
    for found in bodies:
        for seen_id in found:
            counts[seen_id] = counts.get(seen_id, 0) + 1
    if not counts:
        raise RecordingError(path, "frames", f"no body in any of {len(bodies)} frames", "a tracked body")
    if body_id is None:
        return min(counts, key=lambda seen_id: (-counts[seen_id], seen_id))
    if body_id not in counts:
        ids = ", ".join(f"{seen_id} ({counts[seen_id]} frames)" for seen_id in sorted(counts))
        raise RecordingError(path, "frames", f"no body with id {body_id}", f"one of the ids {ids}")
    return body_id


def _joints(
    path: Path, span: list[dict[int, Any]], first: int, body_id: int, names: list[Any]
) -> tuple[dict[str, FloatArray], dict[str, FloatArray], BoolArray]:
    """Positions, orientations and sightings of a body in consecutive frames, checked."""
    columns = [names.index(name) for name in JOINTS]
    seen = np.array([body_id in found for found in span], dtype=np.bool_)
    seen_frames = [int(index) for index in np.flatnonzero(seen)]
    joints: list[FloatArray] = []
    for key, width in (("joint_positions", 3), ("joint_orientations", 4)):
        values = np.empty((len(seen_frames), len(JOINTS), width))
        for row, index in enumerate(seen_frames):
            where = f"frame {first + index}, body {body_id}"
            entries = _key(path, where, span[index][body_id], key, list)
            if len(entries) != len(names):
                problem = f"{len(entries)} {key} for {len(names)} joint_names"
                raise RecordingError(path, where, problem, f"{len(names)} {key}, one a joint")
            for slot, column in enumerate(columns):
                values[row, slot] = _numbers(path, f"{where}, joint {JOINTS[slot]}", key, entries[column], width)
        joints.append(values)
    for slot, name in enumerate(JOINTS):

        def place(row: int, name: str = name) -> str:
            return f"frame {first + seen_frames[row]}, body {body_id}, joint {name}"

        check_finite(path, joints[0][:, slot], ("x", "y", "z"), place)
        check_finite(path, joints[1][:, slot], ("qw", "qx", "qy", "qz"), place)
        check_unit_quaternions(path, joints[1][:, slot], "joint_orientations (w,x,y,z)", place)
    position_mm = {name: _spread(joints[0][:, slot], seen) for slot, name in enumerate(JOINTS)}
    quat_wxyz = {name: _spread(joints[1][:, slot], seen) for slot, name in enumerate(JOINTS)}
    return position_mm, quat_wxyz, seen


def _numbers(path: Path, where: str, key: str, entry: Any, width: int) -> list[float]:
    """A joint's numbers; null, which the tool writes for NaN, becomes NaN."""
    if not isinstance(entry, list) or len(entry) != width:
        raise RecordingError(path, where, f"its entry in {key} is not a list of {width}", f"{width} numbers")
    numbers = []
    for value in entry:
        if value is not None and (isinstance(value, bool) or not isinstance(value, (int, float))):
            raise RecordingError(path, where, f"{key} holds {value!r:.40}", f"{width} numbers")
        try:
            numbers.append(np.nan if value is None else float(value))
        except OverflowError:
            numbers.append(np.inf)
    return numbers


def _spread(seen_values: FloatArray, seen: BoolArray) -> FloatArray:
    """Rows for all frames from rows for the frames with a sighting; NaN in the others."""
    values = np.full((len(seen), seen_values.shape[1]), np.nan)
    values[seen] = seen_values
    return values


_MAX_AXIS_ERROR_DEG = 60.0

_LEVEL_FROM_CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
_JOINT_FROM_PERSON = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def read_kinect(path: Path, options: ReadOptions) -> Recording:
    """Read a body tracking file.

    The robot's frame is the depth camera's place, turned level: x forward, y left, z up. Time is 0 at the
    body's first sighting; frames between sightings are kept as not valid. The measured track is the raw one;
    for the truth its positions are smoothed without lag by a cubic spline (generalised cross-validation).

    Args:
        path: File to read.
        options: Body, head joint and the camera's pitch.

    Returns:
        The recording, with the robot in its frame's origin.

    Raises:
        RecordingError: If the file is not such JSON, the body is not in it, the values are damaged or in
            other units, or the head's axes disagree with the face.
    """
    body = read_body(path, options.kinect_body_id)
    check_frame_count(path, int(body.seen.sum()), MIN_SEEN_FRAMES)
    times_s = (body.times_usec - body.times_usec[0]) * 1e-6
    check_frame_interval(path, times_s, unit="microseconds")
    head = options.kinect_head_joint.upper()
    level_from_camera = _level_from_camera(options.kinect_camera_pitch_deg)
    measured = Track(
        head_position_m=_position_m(body, head, level_from_camera),
        head_quat_wxyz=_quat_wxyz(body, head, level_from_camera),
        pelvis_position_m=_position_m(body, "PELVIS", level_from_camera),
        pelvis_quat_wxyz=_quat_wxyz(body, "PELVIS", level_from_camera),
        valid=body.seen,
    )
    seen_head_m = measured.head_position_m[body.seen]
    seen_pelvis_m = measured.pelvis_position_m[body.seen]
    check_head_to_pelvis(path, seen_head_m, seen_pelvis_m, unit="millimetres")
    check_upright(path, seen_head_m, seen_pelvis_m, "an upright person, and the camera's pitch as an option")
    _check_head_axes(path, body, head, measured.head_quat_wxyz, level_from_camera)
    truth = Track(
        head_position_m=smoothed(path, times_s, measured.head_position_m, body.seen),
        head_quat_wxyz=measured.head_quat_wxyz.copy(),
        pelvis_position_m=smoothed(path, times_s, measured.pelvis_position_m, body.seen),
        pelvis_quat_wxyz=measured.pelvis_quat_wxyz.copy(),
        valid=body.seen.copy(),
    )
    return Recording(
        name=path.stem,
        source=str(path),
        kind="body tracking",
        times_s=times_s,
        truth=truth,
        measured=measured,
        has_robot=True,
        labels=labels_for(path, times_s, truth.pelvis_position_m),
    )


def _level_from_camera(pitch_deg: float) -> FloatArray:
    """Rotation from the camera's axes to level ones, shape (3, 3); the pitch is positive looking up."""
    # Looking up is a negative turn about +y (left), as a positive one takes x to -z.
    pitch = Rotation.from_euler("y", -pitch_deg, degrees=True).as_matrix()
    return np.asarray(pitch @ _LEVEL_FROM_CAMERA)


def _position_m(body: BodyTrack, joint: str, level_from_camera: FloatArray) -> FloatArray:
    """Position of a joint in the level frame, shape (N, 3), metres."""
    return np.asarray(body.position_camera_mm[joint] @ level_from_camera.T * 1e-3)


def _quat_wxyz(body: BodyTrack, joint: str, level_from_camera: FloatArray) -> FloatArray:
    """Orientation of a joint's person axes in the level frame, shape (N, 4)."""
    quat_wxyz = np.full((len(body.seen), 4), np.nan)
    camera_from_joint = Rotation.from_quat(body.quat_camera_wxyz[joint][body.seen][:, [1, 2, 3, 0]])
    level_from_person = (
        Rotation.from_matrix(level_from_camera) * camera_from_joint * Rotation.from_matrix(_JOINT_FROM_PERSON)
    )
    quat_wxyz[body.seen] = level_from_person.as_quat()[:, [3, 0, 1, 2]]
    return quat_wxyz


def _check_head_axes(
    path: Path, body: BodyTrack, joint: str, head_quat_wxyz: FloatArray, level_from_camera: FloatArray
) -> None:
    """Refuse a file whose head axes are not those this reader takes for granted.

    Raises:
        RecordingError: If the head's forward axis is over 60 degrees (median) from the direction in which
            the nose is from between the ears, or its up axis over 60 degrees from up.
    """
    ears_mm = 0.5 * (body.position_camera_mm["EAR_LEFT"] + body.position_camera_mm["EAR_RIGHT"])
    face = ((body.position_camera_mm["NOSE"] - ears_mm) @ level_from_camera.T)[body.seen]
    head = Rotation.from_quat(head_quat_wxyz[body.seen][:, [1, 2, 3, 0]])
    forward_deg = _median_angle_deg(head.apply([1.0, 0.0, 0.0]), face)
    up_deg = _median_angle_deg(head.apply([0.0, 0.0, 1.0]), np.array([[0.0, 0.0, 1.0]]))
    if forward_deg >= _MAX_AXIS_ERROR_DEG or up_deg >= _MAX_AXIS_ERROR_DEG:
        raise RecordingError(
            path,
            f"joint {joint}",
            f"its forward axis is {forward_deg:.0f} deg from the face (nose minus the ears' midpoint) "
            f"and its up axis {up_deg:.0f} deg from up (medians)",
            f"both under {_MAX_AXIS_ERROR_DEG:.0f} deg, with the joint's axes +X up, +Y facing, +Z left",
        )


def _median_angle_deg(a: FloatArray, b: FloatArray) -> float:
    """Median angle between vectors, row by row, degrees."""
    cross = np.linalg.norm(np.cross(a, b), axis=1)
    return float(np.degrees(np.median(np.arctan2(cross, np.sum(a * b, axis=1)))))
