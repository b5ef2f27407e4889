"""Tables as Parquet files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gazempc.errors import MissingOptionalDependencyError, RecordingError
from gazempc.recordings.readers.tables.own import COLUMNS
from gazempc.recordings.readers.tables.raw_table import RawTable

# An hour of 50 columns at 60 Hz.
_MOST_CELLS = 10_000_000
# Names and dates are shorter.
_LONGEST_TEXT = 200


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
        file = pq.ParquetFile(path)
        arrow = file.schema_arrow
        # What is nested in columns may be a thousand times as long as the table, and is no number.
        names = [field.name for field in arrow if not pa.types.is_nested(field.type)]
        if len(set(names)) < len(names):
            raise ValueError("a column stands there twice")
        cells = file.metadata.num_rows * len(names)
        if cells > _MOST_CELLS:
            raise ValueError(f"it says that it has {cells} cells; accepted are {_MOST_CELLS} at most")
        kinds = (pa.types.is_string, pa.types.is_large_string, pa.types.is_binary, pa.types.is_large_binary)
        # As numbers of distinct values: else one long text, repeated, takes gigabytes.
        texts = [field.name for field in arrow if any(is_kind(field.type) for is_kind in kinds)]
        table = pq.ParquetFile(path, read_dictionary=texts).read(columns=names)
    except Exception as error:  # a damaged file makes the library raise errors of many unrelated classes
        raise RecordingError(path, "", _library_text(error), "a Parquet table") from None
    if table.num_rows == 0:
        raise RecordingError(path, "", "a header and no rows", "a row a frame")
    columns = []
    for name, column in zip(table.column_names, table.columns, strict=True):
        if pa.types.is_floating(column.type) or pa.types.is_integer(column.type):
            columns.append(column.to_numpy().astype(np.float64))
        elif name in COLUMNS:
            raise RecordingError(path, f"column {name}", f"it holds {arrow.field(name).type}", "floating-point numbers")
        else:
            columns.append(_texts(column))
    places = [f"row {k + 1}" for k in range(table.num_rows)]
    return RawTable(path, "plain", tuple(table.column_names), columns, places)


def _texts(column: Any) -> list[str]:
    """Cells of a column that holds no numbers, as text; equal ones are one text in memory."""
    cells: list[str] = []
    for chunk in column.chunks:
        words = chunk if hasattr(chunk, "dictionary") else chunk.dictionary_encode()
        texts = ["" if value is None else str(value)[:_LONGEST_TEXT] for value in words.dictionary.to_pylist()]
        cells += ["" if index is None else texts[index] for index in words.indices.to_pylist()]
    return cells


def _library_text(error: Exception) -> str:
    """First line of a library's message, without its final full stop."""
    lines = str(error).strip().splitlines()
    return f"cannot be read ({lines[0].rstrip('.') if lines else type(error).__name__})"
