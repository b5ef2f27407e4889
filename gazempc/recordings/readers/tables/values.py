"""Reads points, angles and quaternions from the columns that a mapping names."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from gazempc.errors import RecordingError
from gazempc.recordings.readers.checks import MAX_MAGNITUDE
from gazempc.recordings.readers.tables.columns import Columns, listed, split_options
from gazempc.types import FloatArray

LENGTHS_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
ANGLES_RAD = {"rad": 1.0, "deg": np.pi / 180.0}
# Letters that tell the columns of a group.
POSITION = (("x", "y", "z"), ("0", "1", "2"))
QUATERNION = (("w", "x", "y", "z"), ("0", "1", "2", "3"))
EULER = (("roll", "pitch", "yaw"), ("x", "y", "z"))
_CONSTANT = re.compile(r"=\s*([-+]?[\d.]+)")


def vector(columns: Columns, text: str, alphabets: Sequence[Sequence[str]], what: str) -> tuple[FloatArray, str | None]:
    """Numbers of several columns, side by side.

    Args:
        columns: Columns of the table.
        text: A group's name, or a list of columns and constants such as ``=1.6``.
        alphabets: Letters that tell the columns of a group.
        what: What they are, for messages.

    Returns:
        Shape (N, C), and the unit that the table says, or None.

    Raises:
        RecordingError: If a column is missing or holds no numbers, or the list has another length.
    """
    count = len(alphabets[0])
    parts = listed(text)
    if parts is None:
        parts = columns.group(text, alphabets)
        if parts is None:
            letters = ", ".join(alphabets[0])
            raise columns.missing(f"columns {text!r} with {letters} for the {what}", text)
    if len(parts) != count:
        raise RecordingError(columns.table.path, f"mapping of the {what}", f"{text!r}", f"{count} columns")
    values, units = [], []
    for part in parts:
        constant = _CONSTANT.fullmatch(part)
        if constant:
            values.append(np.full(len(columns.table.places), float(constant[1])))
            continue
        name = columns.one(part)
        values.append(_in_reason(columns, name))
        units.append(columns.table.unit(name))
    unit = units[0] if len(set(units)) == 1 else None
    if any(_CONSTANT.fullmatch(part) for part in parts) and unit not in (None, "m"):
        raise RecordingError(
            columns.table.path, f"mapping of the {what}", f"a constant beside columns in {unit}", "columns in metres"
        )
    return np.column_stack(values), unit


def _in_reason(columns: Columns, name: str) -> FloatArray:
    """Numbers of a column, NaN where they are infinite.

    Raises:
        RecordingError: Names the first one whose square would overflow further on.
    """
    values = columns.table.numbers(name)
    values = np.where(np.isfinite(values), values, np.nan)
    if (np.abs(values) > MAX_MAGNITUDE).any():
        row = int(np.argmax(np.abs(values) > MAX_MAGNITUDE))
        raise RecordingError(
            columns.table.path,
            f"{columns.table.place(row)}, column {name}",
            f"the value is {values[row]:g}",
            f"a finite number no larger than {MAX_MAGNITUDE:g}",
        )
    return values


def signed_terms(columns: Columns, text: str) -> list[tuple[float, str]]:
    """Cut ``A+B-C`` into points with signs; a name that is in the table is not cut.

    Args:
        columns: Columns of the table.
        text: The value.

    Returns:
        Sign and name of each.
    """
    if listed(text) is not None or columns.group(text, POSITION) is not None:
        return [(1.0, text)]
    parts = re.split(r"([+-])", text)
    signs = [1.0, *(1.0 if sign == "+" else -1.0 for sign in parts[1::2])]
    return [(sign, part.strip()) for sign, part in zip(signs, parts[0::2], strict=True) if part.strip()]


def points(columns: Columns, text: str, what: str) -> tuple[list[tuple[float, FloatArray]], str | None]:
    """Points with signs.

    Args:
        columns: Columns of the table.
        text: The value without its unit.
        what: What they are, for messages.

    Returns:
        Sign and positions of shape (N, 3) of each, and the unit that the table says, or None.
    """
    found, units = [], []
    for sign, name in signed_terms(columns, text):
        values, unit = vector(columns, name, POSITION, what)
        found.append((sign, values))
        units.append(unit)
    return found, units[0] if len(set(units)) == 1 else None


def in_metres(columns: Columns, text: str, what: str) -> FloatArray:
    """A position as a mapping says it: one point, or the mean of several.

    Args:
        columns: Columns of the table.
        text: The value, with its unit or without.
        what: What it is, for messages.

    Returns:
        Shape (N, 3), metres, in the table's axes; NaN where a point is not known.
    """
    body, words = split_options(text, tuple(LENGTHS_M))
    found, unit = points(columns, body, what)
    if any(sign < 0 for sign, _ in found):
        raise RecordingError(columns.table.path, f"mapping of the {what}", f"{text!r}", "a sum of points: A+B")
    unit = (words or [unit or "m"])[-1]
    if unit not in LENGTHS_M:
        raise RecordingError(columns.table.path, f"columns of the {what}", f"they are in {unit}", "a unit of length")
    return np.asarray(np.mean([values for _, values in found], axis=0) * LENGTHS_M[unit])


def direction(columns: Columns, text: str, what: str) -> FloatArray:
    """Where the points with plus are, seen from those with minus.

    Args:
        columns: Columns of the table.
        text: Such as ``LEFT_EAR-RIGHT_EAR``.
        what: What it is, for messages.

    Returns:
        Shape (N, 3), of any length, in the table's axes.
    """
    found, _ = points(columns, text, what)
    plus = [values for sign, values in found if sign > 0]
    minus = [values for sign, values in found if sign < 0]
    if not plus or not minus:
        raise RecordingError(columns.table.path, f"mapping of the {what}", f"{text!r}", "a difference of points: A-B")
    return np.asarray(np.mean(plus, axis=0) - np.mean(minus, axis=0))
