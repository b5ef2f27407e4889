"""Parsing of Azure Kinect Body Tracking JSON (`offline_processor`) into arrays of one body's joints.

Frames are counted from 0, as they stand in the file's list ``frames``.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gazempc.errors import RecordingError
from gazempc.recordings.readers.checks import check_finite, check_times_increase, check_unit_quaternions
from gazempc.recordings.readers.text import read_text
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
