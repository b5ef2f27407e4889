"""Capture times as tables have them: numbers in any unit, frame numbers, dates and clock times."""

from __future__ import annotations

import re
from datetime import UTC, datetime

import numpy as np

from gazempc.errors import RecordingError, shown
from gazempc.recordings.readers.tables.columns import Columns, split_options
from gazempc.types import FloatArray

TIMES_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}
_RATE = re.compile(r"(?P<rate>[\d.]*)\s*hz", re.IGNORECASE)
_WAYS = (*TIMES_S, "date")
_DATE_FORMATS = (
    "%H:%M:%S.%f", "%H:%M:%S", "%d.%m.%Y %H:%M:%S.%f", "%d.%m.%Y %H:%M:%S", "%Y/%m/%d %H:%M:%S.%f",
    "%Y/%m/%d %H:%M:%S", "%d/%m/%Y %H:%M:%S.%f", "%d/%m/%Y %H:%M:%S", "%m/%d/%Y %H:%M:%S.%f", "%m/%d/%Y %H:%M:%S",
    "%m/%d/%Y %I:%M:%S.%f %p", "%m/%d/%Y %I:%M:%S %p", "%Y-%m-%d %H-%M-%S.%f", "%Y-%m-%d_%H-%M-%S.%f",
)  # fmt: skip


def seconds(columns: Columns, text: str) -> FloatArray:
    """Capture times as a mapping says them.

    Args:
        columns: Columns of the table.
        text: ``stamp:ns``; a sum such as ``sec:s+nanosec:ns``; ``frame:100hz`` for frame numbers; ``:30hz`` for the
            rows as they follow each other; ``when:date`` for dates or clock times.

    Returns:
        Shape (N,), seconds; NaN where the file has none.

    Raises:
        RecordingError: If a column is missing, a cell is no time, or a rate is nowhere said.
    """
    head, _, last = text.rpartition(":")
    rate = _RATE.fullmatch(last.strip())
    if rate:
        return _frames(columns, head.strip(), rate["rate"])
    total = np.zeros(len(columns.table.places))
    for term in [text] if columns.has(split_options(text, _WAYS)[0]) else text.split("+"):
        body, words = split_options(term, _WAYS)
        name = columns.one(body)
        unit = (words or [columns.table.unit(name) or "s"])[-1]
        if unit == "date":
            total += _dates(columns, name)
        elif unit in TIMES_S:
            total += columns.table.numbers(name) * TIMES_S[unit]
        else:
            raise RecordingError(columns.table.path, f"column {name}", f"it is in {unit}", "a unit of time")
    return total


def seconds_since_1970(cell: str) -> float | None:
    """A date or a clock time as seconds; None if the text is neither. Without a time zone it counts as UTC."""
    cell = cell.strip().replace(",", ".")
    found: datetime | None
    try:
        found = datetime.fromisoformat(cell)
    except ValueError:
        found = next((date for way in _DATE_FORMATS if (date := _parsed(cell, way)) is not None), None)
    if found is None:
        return None
    return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()


def _parsed(cell: str, way: str) -> datetime | None:
    try:
        # Years before 1970 have no time stamp everywhere.
        found = datetime.strptime(cell, way)
        return found if found.year > 1970 else found.replace(year=1970)
    except ValueError:
        return None


def _dates(columns: Columns, name: str) -> FloatArray:
    table, found = columns.table, []
    for row, cell in enumerate(table.texts(name)):
        value = seconds_since_1970(cell) if cell else float("nan")
        if value is None:
            raise RecordingError(
                table.path,
                f"{table.place(row)}, column {name}",
                f"{shown(cell)} is no date and no clock time",
                "such as 2024-05-01T12:00:00.25, 01.05.2024 12:00:00,25 or 12:00:00.25",
            )
        found.append(value)
    return np.array(found)


def _frames(columns: Columns, column: str, said: str) -> FloatArray:
    """Frame numbers as seconds; the smallest step between numbers is one frame."""
    table = columns.table
    numbers = table.numbers(columns.one(column)) if column else np.arange(float(len(table.places)))
    rate_hz = float(said) if said else table.rate_hz
    if not rate_hz:
        raise RecordingError(
            table.path,
            "time stamps",
            "the file has frame numbers and no frame rate",
            f"the rate, such as --reading.columns 't={column}:60hz'",
        )
    steps = np.diff(np.unique(numbers[np.isfinite(numbers)]))
    return numbers / (float(steps.min()) if steps.size else 1.0) / rate_hz
