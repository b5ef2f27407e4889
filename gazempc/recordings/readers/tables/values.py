"""Values of a mapping from the columns of a table: times, points and directions."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

from gazempc.errors import RecordingError, shown
from gazempc.recordings.readers.checks import check_finite
from gazempc.recordings.readers.tables.raw_table import RawTable
from gazempc.types import FloatArray


def split_options(text: str, known: Sequence[str]) -> tuple[str, list[str]]:
    """Split units and orders off the end of a value.

    Args:
        text: Such as ``pose.position:mm``.
        known: Accepted words.

    Returns:
        The rest, and the words.
    """
    words: list[str] = []
    while ":" in text:
        rest, _, word = text.rpartition(":")
        if word.strip() not in known:
            break
        words.insert(0, word.strip())
        text = rest
    return text.strip(), words


def listed(text: str) -> list[str] | None:
    """Elements of ``[a, b, c]``; None if the text is not a list."""
    if text[:1] in "[(" and text[-1:] in "])":
        return [part.strip() for part in text[1:-1].split(",")]
    return None


LENGTHS_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
ANGLES_RAD = {"rad": 1.0, "deg": np.pi / 180.0}
# Letters of the columns of a group.
POSITION = (("x", "y", "z"), ("0", "1", "2"))
QUATERNION = (("w", "x", "y", "z"), ("0", "1", "2", "3"))
EULER = (("roll", "pitch", "yaw"), ("x", "y", "z"))
_CONSTANT = re.compile(r"=\s*[-+]?(?:\d+\.?\d*|\.\d+)")


def vector(table: RawTable, text: str, alphabets: Sequence[Sequence[str]], what: str) -> tuple[FloatArray, str | None]:
    """Numbers of several columns as one array.

    Args:
        table: The table.
        text: A group's name, or a list of columns and constants such as ``=1.6``.
        alphabets: Letters of the columns of a group.
        what: Name of the quantity, for messages.

    Returns:
        Shape (N, C), and the unit in the table, or None.

    Raises:
        RecordingError: If a column is missing or not numeric, or the list has another length.
    """
    parts = listed(text) or table.group(text, alphabets)
    if parts is None:
        raise table.missing(f"columns {text!r} with {', '.join(alphabets[0])} for the {what}", text)
    if len(parts) != len(alphabets[0]):
        raise RecordingError(table.path, f"mapping of the {what}", f"{text!r}", f"{len(alphabets[0])} columns")
    constants = {part: float(part[1:]) for part in parts if _CONSTANT.fullmatch(part)}
    names = [part if part in constants else table.one(part) for part in parts]
    units = {table.unit(name) for name in names if name not in constants}
    unit = units.pop() if len(units) == 1 else None
    if unit not in (None, "m") and any(constants.values()):
        problem = f"a constant with columns in {unit}"
        raise RecordingError(table.path, f"mapping of the {what}", problem, "columns in metres, or =0")
    values = []
    for name in names:
        numbers = np.full(len(table.places), constants[name]) if name in constants else table.numbers(name)
        # Infinite numbers are unknown; large ones, whose square would overflow, are damage.
        values.append(np.where(np.isfinite(numbers), numbers, np.nan))
        check_finite(table.path, np.nan_to_num(values[-1])[:, None], [name], table.place)
    return np.column_stack(values), unit


def points(table: RawTable, text: str, what: str) -> tuple[list[FloatArray], list[FloatArray], str | None]:
    """Signed points: ``A+B-C``; a name in the table is not split.

    Args:
        table: The table.
        text: The value without its unit.
        what: Name of the quantity, for messages.

    Returns:
        Positions of the points with plus and of those with minus, each of shape (N, 3), and the unit in the table, or
        None.
    """
    whole = listed(text) is not None or table.group(text, POSITION) is not None
    parts = [text] if whole else re.split(r"([+-])", text)
    terms = zip(["+", *parts[1::2]], parts[0::2], strict=True)
    read = [(sign, *vector(table, name.strip(), POSITION, what)) for sign, name in terms if name.strip()]
    units = {unit for _, _, unit in read}
    plus, minus = ([values for sign, values, _ in read if sign == wanted] for wanted in "+-")
    return plus, minus, units.pop() if len(units) == 1 else None


def in_metres(table: RawTable, text: str, what: str) -> FloatArray:
    """A position of a mapping: one point, or the mean of several.

    Args:
        table: The table.
        text: The value, with its unit or without.
        what: Name of the quantity, for messages.

    Returns:
        Shape (N, 3), metres, in the table's axes; NaN where a point is unknown.
    """
    body, words = split_options(text, tuple(LENGTHS_M))
    plus, minus, unit = points(table, body, what)
    if minus or not plus:
        raise RecordingError(table.path, f"mapping of the {what}", f"{text!r}", "a sum of points: A+B")
    unit = (words or [unit or "m"])[-1]
    if unit not in LENGTHS_M:
        raise RecordingError(table.path, f"columns of the {what}", f"their unit is {unit}", "a unit of length")
    return np.asarray(np.mean(plus, axis=0) * LENGTHS_M[unit])


def direction(table: RawTable, text: str, what: str) -> FloatArray:
    """Difference vector from the points with minus to those with plus.

    Args:
        table: The table.
        text: Such as ``LEFT_EAR-RIGHT_EAR``.
        what: Name of the quantity, for messages.

    Returns:
        Shape (N, 3), of any length, in the table's axes.
    """
    plus, minus, _ = points(table, text, what)
    if not plus or not minus:
        raise RecordingError(table.path, f"mapping of the {what}", f"{text!r}", "a difference of points: A-B")
    return np.asarray(np.mean(plus, axis=0) - np.mean(minus, axis=0))


TIMES_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}
_RATE = re.compile(r"(?P<rate>(?:\d+\.?\d*|\.\d+)?)\s*hz", re.IGNORECASE)
_WAYS = (*TIMES_S, "date")


def seconds(table: RawTable, text: str) -> FloatArray:
    """Capture times of a mapping.

    Args:
        table: The table.
        text: ``stamp:ns``; a sum such as ``sec:s+nanosec:ns``; ``frame:100hz`` for frame numbers; ``:30hz`` for
            consecutive rows; ``when:date`` for dates or clock times.

    Returns:
        Shape (N,), seconds; NaN where the file has none.

    Raises:
        RecordingError: If a column is missing, a cell is not a time, or a rate is missing.
    """
    head, _, last = text.rpartition(":")
    rate = _RATE.fullmatch(last.strip())
    if rate:
        return _frames(table, head.strip(), rate["rate"])
    total = np.zeros(len(table.places))
    for term in [text] if table.find(split_options(text, _WAYS)[0]) else text.split("+"):
        body, words = split_options(term, _WAYS)
        name = table.one(body)
        unit = (words or [table.unit(name) or "s"])[-1]
        if unit == "date":
            total += _dates(table, name)
        elif unit in TIMES_S:
            total += table.numbers(name) * TIMES_S[unit]
        else:
            raise RecordingError(table.path, f"column {name}", f"its unit is {unit}", "a unit of time")
    return total


def seconds_since_1970(cell: str) -> float | None:
    """A date or clock time in ISO 8601 as seconds, in UTC if it has no time zone; None for any other text."""
    cell = cell.strip().replace(",", ".")
    try:
        found = datetime.fromisoformat(f"1970-01-01T{cell}" if cell[2:3] == ":" else cell)
        return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()
    except (ValueError, OverflowError):
        return None


def _dates(table: RawTable, name: str) -> FloatArray:
    cells = table.texts(name)
    found = [seconds_since_1970(cell) if cell else float("nan") for cell in cells]
    if None in found:
        row = found.index(None)
        problem = f"{shown(cells[row])} is neither a date nor a clock time"
        expected = "ISO 8601, such as 2024-05-01T12:00:00.25 or 12:00:00.25"
        raise RecordingError(table.path, f"{table.place(row)}, column {name}", problem, expected)
    return np.array(found, dtype=np.float64)


def _frames(table: RawTable, column: str, rate: str) -> FloatArray:
    """Frame numbers as seconds; the smallest step between numbers is one frame."""
    numbers = table.numbers(table.one(column)) if column else np.arange(float(len(table.places)))
    rate_hz = float(rate) if rate else table.rate_hz
    if not rate_hz:
        expected = f"the rate, such as --reading.columns 't={column}:60hz'"
        raise RecordingError(table.path, "time stamps", "the file has frame numbers and no frame rate", expected)
    steps = np.diff(np.unique(numbers[np.isfinite(numbers)]))
    return numbers / (float(steps.min()) if steps.size else 1.0) / rate_hz
