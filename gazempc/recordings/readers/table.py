"""Recordings as tables: CSV or Parquet with a row a frame.

Columns, in any order: ``t`` (seconds), ``head_{x,y,z}`` and ``pelvis_{x,y,z}`` (metres, z up, right-handed),
``head_q{w,x,y,z}`` and ``pelvis_q{w,x,y,z}`` (unit quaternions; the identity faces +x with +y to the left).
Other columns are ignored.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gazempc.errors import MissingOptionalDependencyError, RecordingError
from gazempc.recordings.readers.checks import (
    Place,
    check_finite,
    check_frame_count,
    check_frame_interval,
    check_head_to_pelvis,
    check_times_increase,
    check_unit_quaternions,
    check_upright,
)
from gazempc.recordings.readers.labels import labels_for
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.readers.text import read_text, shown
from gazempc.recordings.recording import Recording, Track
from gazempc.types import FloatArray

COLUMNS = (
    "t",
    *(f"head_{axis}" for axis in "xyz"),
    *(f"head_q{part}" for part in "wxyz"),
    *(f"pelvis_{axis}" for axis in "xyz"),
    *(f"pelvis_q{part}" for part in "wxyz"),
)


def read_csv(path: Path, options: ReadOptions) -> Recording:  # all readers have the same signature
    """Read a comma-separated table.

    Args:
        path: File to read; UTF-8, a header line, a line a frame. Blank lines are skipped.
        options: Not needed by this format.

    Returns:
        The recording, with the file's own time stamps.

    Raises:
        RecordingError: If the file is not such a table; rows are counted as lines of the file, from 1.
    """
    reader = csv.reader(io.StringIO(read_text(path, "a CSV table"), newline=""))
    header: list[str] | None = None
    lines: list[int] = []
    cells: list[list[float]] = []
    picked: list[int] = []
    try:
        for row in reader:
            if not row:
                continue
            if header is None:
                header = [name.strip() for name in row]
                picked = _columns_in(path, header)
                continue
            if len(row) != len(header):
                raise RecordingError(
                    path,
                    f"row {reader.line_num}",
                    f"{len(row)} cells",
                    f"{len(header)} cells, as in the header",
                )
            cells.append(_numbers(path, reader.line_num, header, row, picked))
            lines.append(reader.line_num)
    except csv.Error as error:
        raise RecordingError(path, f"row {reader.line_num}", f"{error}", "a comma-separated table") from None
    if not cells:
        raise RecordingError(path, "", "a header and no rows", "a row a frame after the header")
    return _recording(path, np.array(cells), lambda index: f"row {lines[index]}")


def read_parquet(path: Path, options: ReadOptions) -> Recording:
    """Read a Parquet table with the same columns as the CSV.

    Args:
        path: File to read.
        options: Not needed by this format.

    Returns:
        The recording, with the file's own time stamps.

    Raises:
        RecordingError: If the file is not such a table; rows are counted from 1.
        MissingOptionalDependencyError: If pyarrow is not installed.
    """
    try:
        import pyarrow as pa  # noqa: PLC0415 - optional
        import pyarrow.parquet as pq  # noqa: PLC0415 - optional
    except ImportError:
        raise MissingOptionalDependencyError("Reading Parquet files", "pyarrow", "parquet") from None
    try:
        names = list(pq.read_schema(path).names)
    except Exception as error:  # a damaged file makes the library raise errors of many unrelated classes
        raise RecordingError(path, "", _library_text(error), "a Parquet table") from None
    _columns_in(path, names)
    try:
        table = pq.ParquetFile(path).read(columns=list(COLUMNS))
    except Exception as error:
        raise RecordingError(path, "", _library_text(error), "a Parquet table") from None
    for name in COLUMNS:
        kind = table.schema.field(name).type
        if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
            raise RecordingError(path, f"column {name}", f"it holds {kind}", "floating-point numbers")
    if table.num_rows == 0:
        raise RecordingError(path, "", "a header and no rows", "a row a frame")
    values = [table.column(name).to_numpy().astype(np.float64) for name in COLUMNS]
    return _recording(path, np.column_stack(values), lambda index: f"row {index + 1}")


def _columns_in(path: Path, header: Sequence[str]) -> list[int]:
    """Where the wanted columns stand in the header.

    Raises:
        RecordingError: If some are missing or stand there twice.
    """
    missing = [name for name in COLUMNS if name not in header]
    if missing:
        raise RecordingError(
            path,
            "header",
            f"missing column(s) {', '.join(missing)}; found {shown(', '.join(header), 200)}",
            f"the columns {', '.join(COLUMNS)}, in any order",
        )
    twice = [name for name in COLUMNS if header.count(name) > 1]
    if twice:
        raise RecordingError(path, "header", f"more than one column {', '.join(twice)}", "each column once")
    return [header.index(name) for name in COLUMNS]


def _numbers(path: Path, line: int, header: Sequence[str], row: Sequence[str], picked: Sequence[int]) -> list[float]:
    """Numbers of a row in the order of COLUMNS.

    Raises:
        RecordingError: Names the first cell that is not a number.
    """
    numbers = []
    for column in picked:
        cell = row[column]
        try:
            # Python reads 1_0 as 10; in a table it is a damaged cell.
            number = float(cell if "_" not in cell else "")
        except ValueError:
            raise RecordingError(
                path, f"row {line}, column {header[column]}", f"{shown(cell)} is not a number", "a number"
            ) from None
        numbers.append(number)
    return numbers


def _recording(path: Path, values: FloatArray, place: Place) -> Recording:
    """Check a table of shape (N, 15), columns as COLUMNS, and make a recording of it."""
    check_frame_count(path, len(values))
    times_s = values[:, 0].copy()
    head_position_m, head_quat_wxyz = values[:, 1:4].copy(), values[:, 4:8]
    pelvis_position_m, pelvis_quat_wxyz = values[:, 8:11].copy(), values[:, 11:15]
    check_finite(path, values[:, 1:], COLUMNS[1:], place)
    check_times_increase(path, times_s, place)
    check_unit_quaternions(path, head_quat_wxyz, "head_q{w,x,y,z}", place)
    check_unit_quaternions(path, pelvis_quat_wxyz, "pelvis_q{w,x,y,z}", place)
    check_frame_interval(path, times_s)
    check_head_to_pelvis(path, head_position_m, pelvis_position_m)
    check_upright(path, head_position_m, pelvis_position_m, "metres with z up and the person upright")
    truth = Track(
        head_position_m=head_position_m,
        head_quat_wxyz=head_quat_wxyz / np.linalg.norm(head_quat_wxyz, axis=1, keepdims=True),
        pelvis_position_m=pelvis_position_m,
        pelvis_quat_wxyz=pelvis_quat_wxyz / np.linalg.norm(pelvis_quat_wxyz, axis=1, keepdims=True),
        valid=np.ones(len(values), dtype=np.bool_),
    )
    return Recording(
        name=path.stem,
        source=str(path),
        kind="motion capture",
        times_s=times_s,
        truth=truth,
        measured=None,
        has_robot=False,
        labels=labels_for(path, times_s, pelvis_position_m),
    )


def _library_text(error: Exception) -> str:
    """First line of a library's message, without its final full stop."""
    lines = str(error).strip().splitlines()
    return f"cannot be read ({lines[0].rstrip('.') if lines else type(error).__name__})"
