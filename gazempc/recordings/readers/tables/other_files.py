"""Tables as Parquet, Xsens MVN's ``.mvnx`` and folders of OpenPose's 3-D key points."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any
from xml.etree import ElementTree

import numpy as np
from pydantic import BaseModel, Field, ValidationError

from gazempc.errors import RecordingError, importing
from gazempc.files.bounds import check_file, read_text
from gazempc.recordings.readers.tables.raw_table import RawTable

# An hour of 50 columns at 60 Hz.
_MOST_CELLS = 10_000_000
# Types that pyarrow can read dictionary-encoded.
_TEXT_TYPES = ("string", "large_string", "binary", "large_binary")
# Names and dates are shorter.
_LONGEST_TEXT = 200


def parquet_table(path: Path) -> RawTable:
    """Read the columns of a Parquet file.

    Args:
        path: File to read.

    Returns:
        The table; numeric columns as numbers, all others as text.

    Raises:
        OSError: If it is not a regular file.
        RecordingError: If the file is not such a table; rows are counted from 1.
        MissingOptionalDependencyError: If pyarrow is not installed.
    """
    with importing("Reading Parquet files", "pyarrow", "parquet"):
        import pyarrow as pa  # noqa: PLC0415 - optional
        import pyarrow.parquet as pq  # noqa: PLC0415 - optional
    check_file(path)  # reading a pipe would not terminate
    try:
        file = pq.ParquetFile(path)
        arrow = file.schema_arrow
        # Nested columns may be a thousand times as long as the table, and are not numeric.
        names = [field.name for field in arrow if not pa.types.is_nested(field.type)]
        if len(set(names)) < len(names):
            raise ValueError("a column name occurs twice")
        cells = file.metadata.num_rows * len(names)
        if cells > _MOST_CELLS:
            raise ValueError(f"it has {cells} cells; at most {_MOST_CELLS} are accepted")
        # Dictionary-encoded: a repeated long text would otherwise take gigabytes.
        texts = [field.name for field in arrow if str(field.type) in _TEXT_TYPES]
        table = pq.ParquetFile(path, read_dictionary=texts).read(columns=names)
    except Exception as error:  # a damaged file makes the library raise errors of many unrelated classes
        reason = (str(error).strip() or type(error).__name__).splitlines()[0].rstrip(".")
        raise RecordingError(path, "", f"cannot be read ({reason})", "a Parquet table") from None
    if table.num_rows == 0:
        raise RecordingError(path, "", "a header and no rows", "one row per frame")
    columns = []
    for column in table.columns:
        if pa.types.is_floating(column.type) or pa.types.is_integer(column.type):
            columns.append(column.to_numpy().astype(np.float64))
        else:
            columns.append(_texts(column))
    return RawTable(path, "plain", tuple(table.column_names), columns, range(1, table.num_rows + 1))


def _texts(column: Any) -> list[str]:
    """Cells of a non-numeric column as text; equal cells share one object."""
    cells: list[str] = []
    for chunk in column.chunks:
        words = chunk if hasattr(chunk, "dictionary") else chunk.dictionary_encode()
        texts = ["" if value is None else str(value)[:_LONGEST_TEXT] for value in words.dictionary.to_pylist()]
        cells += ["" if index is None else texts[index] for index in words.indices.to_pylist()]
    return cells


# A frame has about 30, and takes 5 kB: a file of the largest size has a million.
_MOST_TAGS = 2_000_000
_ACCEPTED = "an .mvnx file of Xsens MVN with positions and orientations of the segments"


def mvnx_table(path: Path) -> RawTable:
    """Read the frames of a recording; without calibration poses.

    Args:
        path: File to read.

    Returns:
        Columns ``Time_ms``, ``Head x``, ``Head q0`` and so on for each segment; metres, z up, scalar first.

    Raises:
        RecordingError: If the file is not such XML, or a frame's counts do not match the segments.
    """
    text = read_text(path, "an .mvnx file")
    if (tags := text.count("<")) > _MOST_TAGS:
        raise RecordingError(path, "", f"{tags} tags", f"{_MOST_TAGS} at most: {_ACCEPTED}")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise RecordingError(path, "", "it defines entities, which may expand to gigabytes", _ACCEPTED)
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise RecordingError(path, "", f"not valid XML: {error}", _ACCEPTED) from None
    segments = [element.get("label") or "" for element in root.iterfind(".//{*}segments/{*}segment")]
    frames = [frame for frame in root.iterfind(".//{*}frame") if frame.get("type", "normal") == "normal"]
    if not segments or not frames:
        raise RecordingError(path, "", f"{len(segments)} segments and {len(frames)} frames", _ACCEPTED)
    counts = {"time": 1, "position": 3 * len(segments), "orientation": 4 * len(segments)}
    rows = []
    for number, frame in enumerate(frames):
        row: list[float] = []
        for what, count in counts.items():
            words = frame.findtext(f"{{*}}{what}", frame.get(what, ""))
            try:
                found = [float(word) for word in words.split()]
            except ValueError:
                found = []
            if len(found) != count:
                raise RecordingError(path, f"frame {number}, {what}", f"{len(found)} numbers", f"{count} numbers")
            row += found
        rows.append(row)
    names = ["Time_ms", *(f"{s} {c}" for s in segments for c in "xyz")]
    names += [f"{s} q{k}" for s in segments for k in range(4)]
    return RawTable(path, "mvnx", tuple(names), list(np.array(rows).T), [f"frame {k}" for k in range(len(rows))])


PATTERN = "*_keypoints.json"
# The first key points of BODY_25, up to the last one that is read.
_NAMES = (
    "Nose", "Neck", "RShoulder", "RElbow", "RWrist", "LShoulder", "LElbow", "LWrist", "MidHip", "RHip", "RKnee",
    "RAnkle", "LHip", "LKnee", "LAnkle", "REye", "LEye", "REar", "LEar",
)  # fmt: skip
_BODY_25 = 25
_FRAME = re.compile(r"(\d+)_keypoints$")
# Upper bound on ids, which count people.
_MOST_PEOPLE = 10**9
# Distance from nose to hips that separates metres from millimetres; see HEAD_TO_PELVIS_RANGE_M.
_METRES_BELOW = 10.0
_OPENPOSE = "files of OpenPose --3d --write_json with pose_keypoints_3d of BODY_25: 25 times x, y, z, score"


class _Person(BaseModel):
    person_id: list[Annotated[int, Field(ge=-1, le=_MOST_PEOPLE)]] = []
    # Empty if only one camera saw the person.
    pose_keypoints_3d: list[float] | None = None


class _People(BaseModel):
    people: list[_Person]


def is_openpose_folder(path: Path) -> bool:
    """Whether a folder has OpenPose's files, one per frame."""
    return next(path.glob(PATTERN), None) is not None


def openpose_table(path: Path) -> RawTable:
    """Read all frames of a folder; missing key points are NaN.

    Args:
        path: The folder.

    Returns:
        Columns ``frame``, ``person``, ``Nose.x`` and so on, a row for each person in each frame, in metres or
        millimetres, by the distance from nose to hips.

    Raises:
        RecordingError: If a file is damaged, or no file has 3-D key points.
    """
    rows, places = [], []
    for file in sorted(path.glob(PATTERN)):
        number = _FRAME.search(file.stem)
        if number is None:
            raise RecordingError(file, "", "no frame number in the file's name", "NAME_000000000012_keypoints.json")
        try:
            people = _People.model_validate_json(read_text(file, "a JSON file")).people
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(map(str, first["loc"]))
            raise RecordingError(file, where, f"no list of people with key points: {first['msg']}", _OPENPOSE) from None
        for index, person in enumerate(people):
            if not person.pose_keypoints_3d:
                continue
            if (count := len(person.pose_keypoints_3d)) != 4 * _BODY_25:
                raise RecordingError(file, f"people.{index}.pose_keypoints_3d", f"{count} numbers", _OPENPOSE)
            points = np.array(person.pose_keypoints_3d).reshape(_BODY_25, 4)
            points[points[:, 3] <= 0.0] = np.nan
            # OpenPose's id if it tracks people, else the index in the list.
            tracked = person.person_id[0] if person.person_id and person.person_id[0] >= 0 else index
            rows.append([float(number[1]), tracked, *points[: len(_NAMES), :3].ravel()])
            places.append(file.name)
    if not rows:
        raise RecordingError(path, "", "no 3-D key points in any frame", _OPENPOSE)
    values = np.array(rows)
    names = ["frame", "person", *(f"{name}.{axis}" for name in _NAMES for axis in "xyz")]
    nose, hips = (values[:, 2 + 3 * _NAMES.index(name) :][:, :3] for name in ("Nose", "MidHip"))
    apart = np.linalg.norm(nose - hips, axis=1)
    known = apart[np.isfinite(apart)]
    unit = "mm" if known.size and float(np.median(known)) > _METRES_BELOW else "m"
    notes, units = (f"positions are in {unit}, by the distance from nose to hips",), dict.fromkeys(names[2:], unit)
    return RawTable(path, "openpose", tuple(names), list(values.T), places, units, notes=notes)
