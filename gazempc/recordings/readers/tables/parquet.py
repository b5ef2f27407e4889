"""Tables as Parquet files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gazempc.errors import MissingOptionalDependencyError, RecordingError
from gazempc.recordings.readers.tables.own import COLUMNS
from gazempc.recordings.readers.tables.raw_table import RawTable


def parquet_table(path: Path) -> RawTable:
    """Read the columns of a Parquet file.

    Args:
        path: File to read.

    Returns:
        The table; numbers are numbers, all else is text.

    Raises:
        RecordingError: If the file is no such table, or columns of ours hold no numbers; rows are counted from 1.
        MissingOptionalDependencyError: If pyarrow is not installed.
    """
    try:
        import pyarrow as pa  # noqa: PLC0415 - optional
        import pyarrow.parquet as pq  # noqa: PLC0415 - optional
    except ImportError:
        raise MissingOptionalDependencyError("Reading Parquet files", "pyarrow", "parquet") from None
    try:
        table = pq.ParquetFile(path).read()
    except Exception as error:  # a damaged file makes the library raise errors of many unrelated classes
        raise RecordingError(path, "", _library_text(error), "a Parquet table") from None
    if table.num_rows == 0:
        raise RecordingError(path, "", "a header and no rows", "a row a frame")
    columns = []
    for name, column in zip(table.column_names, table.columns, strict=True):
        if pa.types.is_floating(column.type) or pa.types.is_integer(column.type):
            columns.append(column.to_numpy().astype(np.float64))
        elif name in COLUMNS:
            raise RecordingError(path, f"column {name}", f"it holds {column.type}", "floating-point numbers")
        else:
            columns.append(["" if value is None else str(value) for value in column.to_pylist()])
    places = [f"row {k + 1}" for k in range(table.num_rows)]
    return RawTable(path, "plain", tuple(table.column_names), columns, places)


def _library_text(error: Exception) -> str:
    """First line of a library's message, without its final full stop."""
    lines = str(error).strip().splitlines()
    return f"cannot be read ({lines[0].rstrip('.') if lines else type(error).__name__})"
