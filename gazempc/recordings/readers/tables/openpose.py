"""OpenPose's 3-D key points as a table: a folder with a JSON file a frame."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np

from gazempc.errors import RecordingError
from gazempc.recordings.readers.tables.raw_table import RawTable
from gazempc.recordings.readers.text import read_text

PATTERN = "*_keypoints.json"
# The first key points of BODY_25, in its order, as far as they are read.
_NAMES = (
    "Nose", "Neck", "RShoulder", "RElbow", "RWrist", "LShoulder", "LElbow", "LWrist", "MidHip", "RHip", "RKnee",
    "RAnkle", "LHip", "LKnee", "LAnkle", "REye", "LEye", "REar", "LEar",
)  # fmt: skip
_BODY_25 = 25
_FRAME = re.compile(r"(\d+)_keypoints$")
# Ids of people are counted; no place sees more.
_MOST_PEOPLE = 1e9
# Nose and hips are so far apart in either unit; see HEAD_TO_PELVIS_RANGE_M.
_METRES_BELOW = 10.0
_ACCEPTED = "files of OpenPose --3d --write_json with pose_keypoints_3d of BODY_25: 25 times x, y, z, score"


def is_openpose_folder(path: Path) -> bool:
    """Whether a folder holds OpenPose's files, one a frame."""
    return next(path.glob(PATTERN), None) is not None


def openpose_table(path: Path) -> RawTable:
    """Read all frames of a folder; a key point that was not found is NaN.

    Args:
        path: The folder.

    Returns:
        Columns ``frame``, ``person``, ``Nose.x`` and so on, a row for each person in each frame, in metres or
        millimetres, as the distance from nose to hips says.

    Raises:
        RecordingError: If a file is damaged, or nowhere are 3-D key points.
    """
    rows, places = [], []
    for file in sorted(path.glob(PATTERN)):
        found = _FRAME.search(file.stem)
        if found is None:
            raise RecordingError(file, "", "no frame number in the file's name", "NAME_000000000012_keypoints.json")
        for index, person in enumerate(_people(file)):
            points = person.get("pose_keypoints_3d") or []
            if not points:
                continue
            rows.append([float(found[1]), _id(person, index), *_key_points(file, points)])
            places.append(file.name)
    if not rows:
        raise RecordingError(path, "", "no 3-D key points in any frame", _ACCEPTED)
    values = np.array(rows)
    names = ["frame", "person", *(f"{name}.{axis}" for name in _NAMES for axis in "xyz")]
    nose, hips = (values[:, 2 + 3 * _NAMES.index(name) :][:, :3] for name in ("Nose", "MidHip"))
    apart = np.linalg.norm(nose - hips, axis=1)
    known = apart[np.isfinite(apart)]
    unit = "mm" if known.size and float(np.median(known)) > _METRES_BELOW else "m"
    return RawTable(
        path=path,
        layout="openpose",
        names=tuple(names),
        columns=list(values.T),
        places=places,
        units=dict.fromkeys(names[2:], unit),
        notes=(f"positions are in {unit}, by the distance from nose to hips",),
    )


def _people(file: Path) -> list[dict[str, object]]:
    try:
        people = json.loads(read_text(file, "a JSON file"))["people"]
    except (ValueError, KeyError, TypeError, RecursionError):
        raise RecordingError(file, "", "no JSON with a list 'people'", _ACCEPTED) from None
    if not isinstance(people, list) or not all(isinstance(person, dict) for person in people):
        raise RecordingError(file, "people", "not a list of people", _ACCEPTED)
    return people


def _id(person: dict[str, object], index: int) -> float:
    """OpenPose's id where it tracks people, else the place in the list."""
    given = person.get("person_id")
    number = given[0] if isinstance(given, list) and given else -1
    return float(number) if isinstance(number, int | float) and 0 <= number < _MOST_PEOPLE else float(index)


def _key_points(file: Path, points: object) -> list[float]:
    try:
        values = np.array(points, dtype=np.float64).reshape(_BODY_25, 4)
    except (TypeError, ValueError, OverflowError):
        raise RecordingError(file, "pose_keypoints_3d", "not 100 numbers", _ACCEPTED) from None
    values[values[:, 3] <= 0.0] = np.nan
    return [float(value) for value in values[: len(_NAMES), :3].ravel()]
