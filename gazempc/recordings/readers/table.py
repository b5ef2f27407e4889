"""Recordings as tables: CSV or Parquet with a row a frame.

Columns, in any order: ``t`` (seconds) and ``head_{x,y,z}`` (metres, z up, right-handed). Optional are
``pelvis_{x,y,z}``, ``head_q{w,x,y,z}`` and ``pelvis_q{w,x,y,z}`` (unit quaternions; the identity faces +x with +y to
the left). Other columns are ignored.
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
    check_times_increase,
    check_unit_quaternions,
)
from gazempc.recordings.readers.labels import labels_for
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.readers.position_checks import (
    check_head_to_pelvis,
    check_head_travel,
    check_upright,
)
from gazempc.recordings.readers.text import read_text, shown
from gazempc.recordings.recording import Recording, Track
from gazempc.types import FloatArray

_NEEDED = ("t", "head_x", "head_y", "head_z")
# Each of these is there with all of its columns, or not at all.
_OPTIONAL = {
    "head_q{w,x,y,z}": tuple(f"head_q{part}" for part in "wxyz"),
    "pelvis_{x,y,z}": tuple(f"pelvis_{axis}" for axis in "xyz"),
    "pelvis_q{w,x,y,z}": tuple(f"pelvis_q{part}" for part in "wxyz"),
}
COLUMNS = (*_NEEDED, *(name for names in _OPTIONAL.values() for name in names))


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
    columns: list[str] = []
    lines: list[int] = []
    cells: list[list[float]] = []
    picked: list[int] = []
    try:
        for row in reader:
            if not row:
                continue
            if header is None:
                header = [name.strip() for name in row]
                columns = _columns_in(path, header)
                picked = [header.index(name) for name in columns]
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
    return _recording(path, columns, np.array(cells), lambda index: f"row {lines[index]}")


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
    columns = _columns_in(path, names)
    try:
        table = pq.ParquetFile(path).read(columns=columns)
    except Exception as error:
        raise RecordingError(path, "", _library_text(error), "a Parquet table") from None
    for name in columns:
        kind = table.schema.field(name).type
        if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
            raise RecordingError(path, f"column {name}", f"it holds {kind}", "floating-point numbers")
    if table.num_rows == 0:
        raise RecordingError(path, "", "a header and no rows", "a row a frame")
    values = [table.column(name).to_numpy().astype(np.float64) for name in columns]
    return _recording(path, columns, np.column_stack(values), lambda index: f"row {index + 1}")


def _columns_in(path: Path, header: Sequence[str]) -> list[str]:
    """Which columns to read, in the order of COLUMNS.

    Raises:
        RecordingError: If a needed one is missing, an optional part is there in part, or one stands there twice.
    """
    begun = [names for names in _OPTIONAL.values() if any(name in header for name in names)]
    wanted = [*_NEEDED, *(name for names in begun for name in names)]
    missing = [name for name in wanted if name not in header]
    if missing:
        raise RecordingError(
            path,
            "header",
            f"missing column(s) {', '.join(missing)}; found {shown(', '.join(header), 200)}",
            f"the columns {', '.join(_NEEDED)}, and with all of its columns or none, each of {', '.join(_OPTIONAL)}",
        )
    twice = [name for name in wanted if header.count(name) > 1]
    if twice:
        raise RecordingError(path, "header", f"more than one column {', '.join(twice)}", "each column once")
    return wanted


def _numbers(path: Path, line: int, header: Sequence[str], row: Sequence[str], picked: Sequence[int]) -> list[float]:
    """Numbers of a row, of the picked columns.

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


def _recording(path: Path, columns: Sequence[str], values: FloatArray, place: Place) -> Recording:
    """Check a table of shape (N, C) with these columns, and make a recording of it."""
    check_frame_count(path, len(values))
    check_finite(path, values[:, 1:], columns[1:], place)
    times_s = values[:, 0].copy()
    check_times_increase(path, times_s, place)

    def part(names: Sequence[str]) -> FloatArray:
        if names[0] not in columns:
            return np.full((len(values), len(names)), np.nan)
        return values[:, [columns.index(name) for name in names]]

    def orientations(name: str) -> FloatArray:
        quats_wxyz = part(_OPTIONAL[name])
        check_unit_quaternions(path, quats_wxyz, name, place)
        return np.asarray(quats_wxyz / np.linalg.norm(quats_wxyz, axis=1, keepdims=True))

    truth = Track(
        head_position_m=part(_NEEDED[1:]),
        head_quat_wxyz=orientations("head_q{w,x,y,z}"),
        pelvis_position_m=part(_OPTIONAL["pelvis_{x,y,z}"]),
        pelvis_quat_wxyz=orientations("pelvis_q{w,x,y,z}"),
        valid=np.ones(len(values), dtype=np.bool_),
    )
    check_frame_interval(path, times_s)
    has_pelvis = "pelvis_x" in columns
    if has_pelvis:
        check_head_to_pelvis(path, truth.head_position_m, truth.pelvis_position_m)
        check_upright(path, truth.head_position_m, truth.pelvis_position_m, "metres with z up and the person upright")
    else:
        check_head_travel(path, times_s, truth.head_position_m)
    return Recording(
        name=path.stem,
        source=str(path),
        kind="motion capture",
        times_s=times_s,
        truth=truth,
        measured=None,
        has_robot=False,
        labels=labels_for(path, times_s, truth.pelvis_position_m if has_pelvis else truth.head_position_m),
    )


def _library_text(error: Exception) -> str:
    """First line of a library's message, without its final full stop."""
    lines = str(error).strip().splitlines()
    return f"cannot be read ({lines[0].rstrip('.') if lines else type(error).__name__})"
