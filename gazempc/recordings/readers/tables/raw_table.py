"""Raw table of a file: named columns of text or numbers; rows of landmarks are merged, one row per frame."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Literal

import numpy as np

from gazempc.errors import RecordingError, shown, suggest
from gazempc.types import FloatArray

# Stands for the name of a person of the header in the values of a mapping.
PERSON = "{person}"

Layout = Literal["plain", "no header", "motive", "vicon", "mvnx", "openpose"]

# Texts for a missing value.
_MISSING = {"", "nan", "na", "n/a", "none", "null", "-", "--", "?"}
_DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+(?:[eE][-+]?\d+)?\s*")
# Names of units in mappings, by their spelling in headers.
UNIT_WORDS: Mapping[str, str] = {
    "s": "s", "sec": "s", "secs": "s", "second": "s", "seconds": "s", "ms": "ms", "msec": "ms", "milliseconds": "ms",
    "us": "us", "µs": "us", "usec": "us", "microseconds": "us", "ns": "ns", "nsec": "ns", "nanoseconds": "ns",
    "m": "m", "meters": "m", "metres": "m", "cm": "cm", "centimeters": "cm", "centimetres": "cm",
    "mm": "mm", "millimeters": "mm", "millimetres": "mm", "in": "in", "inches": "in", "ft": "ft", "feet": "ft",
    "deg": "deg", "degrees": "deg", "°": "deg", "rad": "rad", "radians": "rad",
}  # fmt: skip
# Separators between a group's name and the letter of a column.
_SEPARATORS = ("", ".", "_", " ", "/", "-", ":", "__")
_NUMBER = re.compile(r"#(\d+)")
_BRACKETED = re.compile(r"^(?P<stem>.*?)\s*[\[(]\s*(?P<unit>[^\[\]()]+?)\s*[\])]\s*$")
_SUFFIXED = re.compile(r"^(?P<stem>.+?),?[_. ](?P<unit>[a-zµ°]+)$", re.IGNORECASE)


@dataclass(frozen=True)
class RawTable:
    """Columns of a file.

    Attributes:
        path: The file.
        layout: Layout of the file.
        names: Names of the columns, in the order of the file; their numbers from 1 if there is no header.
        columns: Cells of each column, N rows, as text or as numbers.
        places: Place of each row in the file: the line, or text such as ``frame 17``.
        units: Units of columns, by name, if stated in the file.
        rate_hz: Frame rate, if stated in the file; positive.
        notes: Remarks of the reader.
        person: Name of the person in the header, for ``{person}`` in the values of a mapping; may be empty.
    """

    path: Path
    layout: Layout
    names: tuple[str, ...]
    columns: Sequence[Sequence[str] | FloatArray]
    places: Sequence[int | str]
    units: Mapping[str, str] = field(default_factory=dict)
    rate_hz: float | None = None
    notes: tuple[str, ...] = ()
    person: str = ""

    def place(self, index: int) -> str:
        """Place of a row in the file, such as ``row 17``."""
        place = self.places[index]
        return place if isinstance(place, str) else f"row {place}"

    def first(self, count: int) -> RawTable:
        """The first rows."""
        return replace(self, columns=[cells[:count] for cells in self.columns], places=self.places[:count])

    def texts(self, name: str) -> list[str]:
        """Cells of a column as text, such as a person's name; whole numbers without a point."""
        return [
            cell.strip() if isinstance(cell, str) else f"{cell:.0f}" if cell == np.round(cell) else repr(float(cell))
            for cell in self._column(name)
        ]

    def numbers(self, name: str) -> FloatArray:
        """Cells of a column as numbers, shape (N,); NaN where the file has no value.

        Raises:
            RecordingError: Names the first cell that is not a number.
        """
        cells = self._column(name)
        if isinstance(cells, np.ndarray):
            return cells
        values = [_number(cell) for cell in cells]
        if None in values:
            row = values.index(None)
            where = f"{self.place(row)}, column {name}"
            raise RecordingError(self.path, where, f"{shown(cells[row])} is not a number", "a number")
        return np.array(values, dtype=np.float64)

    def unit(self, name: str) -> str | None:
        """Unit of a column, from the file or from its name; None if unknown."""
        return self.units.get(name) or split_unit(name)[1]

    def find(self, text: str) -> str | None:
        """Name of the column for a mapping's value; None if there is no such column."""
        text = self._of_person(text)
        number = _NUMBER.fullmatch(text)
        if number and 0 < int(number[1]) <= len(self.names):
            return self.names[int(number[1]) - 1]
        return text if text in self.names else self._by_name.get(text.casefold())

    def one(self, text: str) -> str:
        """Name of the column for a mapping's value.

        Raises:
            RecordingError: If there is no such column.
        """
        if (found := self.find(text)) is None:
            wanted = self._of_person(text)
            raise self.missing(f"column {wanted!r}", wanted)
        return found

    def group(self, text: str, alphabets: Sequence[Sequence[str]]) -> list[str] | None:
        """Columns of a group such as ``head`` for ``head_x``, ``head_y``, ``head_z``; None if missing."""
        base = self._of_person(text).casefold()
        for letters, joint in product(alphabets, _SEPARATORS):
            for wanted in ([f"{base}{joint}{c}" for c in letters], [f"{c}{joint}{base}" for c in letters]):
                if all(name in self._by_name for name in wanted):
                    return [self._by_name[name] for name in wanted]
        return None

    def missing(self, what: str, wanted: str = "") -> RecordingError:
        """Error for missing columns."""
        near = suggest(wanted, self.names).partition(";")[0] if wanted else ""
        hint = f" ({near})" if near.startswith("perhaps") else ""
        problem = f"no {what}{hint}; found {shown(', '.join(self.names), 200)}"
        expected = "names of columns in the header or, without a header, their numbers"
        return RecordingError(self.path, "header", problem, expected)

    def _of_person(self, text: str) -> str:
        """A column of a mapping with the person's name."""
        own = text.replace(f"{PERSON}:", f"{self.person}:" if self.person else "")
        return own.replace(PERSON, self.person)

    @cached_property
    def _by_name(self) -> dict[str, str]:
        """Columns by name, with or without the unit, in lower case; the first of several."""
        with_units = {name.casefold(): name for name in reversed(self.names)}
        return {split_unit(name)[0].casefold(): name for name in reversed(self.names)} | with_units

    def _column(self, name: str) -> Sequence[str] | FloatArray:
        if self.names.count(name) > 1:
            raise RecordingError(self.path, "header", f"more than one column {name}", "each column once")
        return self.columns[self.names.index(name)]


def _number(cell: str) -> float | None:
    """Number in a cell of text; NaN for a missing value, None for any other text."""
    try:
        # Python reads 1_0 as 10; in a table it is a damaged cell.
        return float(cell if "_" not in cell else "x")
    except ValueError:
        if has_decimal_comma(cell):
            return float(cell.replace(",", "."))
        return float("nan") if cell.strip().lower() in _MISSING else None


def is_number(cell: str) -> bool:
    """Whether a cell of text is a number, with a decimal point or a decimal comma."""
    value = _number(cell)
    return value is not None and not math.isnan(value)


def has_decimal_comma(cell: str) -> bool:
    """Whether a cell of text is a number with a decimal comma."""
    return _DECIMAL_COMMA.fullmatch(cell) is not None


def split_unit(name: str) -> tuple[str, str | None]:
    """Split the unit off a column's name.

    Args:
        name: Such as ``Time (Seconds)``, ``head_x [mm]`` or ``stamp_ns``.

    Returns:
        The name without the unit, and the unit in a mapping's notation, or None.
    """
    for pattern in (_BRACKETED, _SUFFIXED):
        found = pattern.match(name)
        if found and found["unit"].lower() in UNIT_WORDS and found["stem"]:
            return found["stem"], UNIT_WORDS[found["unit"].lower()]
    return name, None


_LANDMARK = re.compile(
    r"(landmark|joint|key_?point|body_?part|marker|bone|segment)(_?(id|name|index|no|nr|number))?", re.I
)
_AXIS = re.compile(r"(?P<kind>pos|position)?[._ ]?(?P<axis>[xyz])", re.I)
# Columns that belong to one landmark; all others in a row, such as a time, belong to the frame.
_OF_LANDMARK = re.compile(r"(visibility|presence|confidence|score|likelihood|type)", re.I)


def wide(table: RawTable) -> RawTable:
    """Merge rows of single landmarks into columns ``NOSE_x``, ``NOSE_y`` and so on, one row per frame.

    Args:
        table: A table; returned unchanged if it has no column of landmarks with columns x, y and z.

    Returns:
        The table; a landmark without a row in a frame has blank cells there.
    """
    named = [name for name in table.names if _LANDMARK.fullmatch(name)]
    axes = {m["axis"].lower(): name for name in table.names if (m := _AXIS.fullmatch(split_unit(name)[0]))}
    if not named or set(axes) != {"x", "y", "z"}:
        return table
    marks = table.texts(named[0])
    own = [n for n in table.names if n not in (*named, *axes.values()) and not _OF_LANDMARK.fullmatch(n)]
    frames = list(zip(*(table.texts(name) for name in own), strict=True)) or [()] * len(marks)
    # For each frame the place of its first row.
    places = dict(zip(reversed(frames), reversed(table.places), strict=True))
    rows = {frame: row for row, frame in enumerate(dict.fromkeys(frames))}
    prefix = f"{named[0].partition('_')[0].lower()}_" if all(mark.isdigit() for mark in marks) else ""
    found = {f"{prefix}{mark}_{axis}": [""] * len(rows) for mark in dict.fromkeys(marks) for axis in "xyz"}
    for axis, name in axes.items():
        for mark, frame, cell in zip(marks, frames, table.texts(name), strict=True):
            found[f"{prefix}{mark}_{axis}"][rows[frame]] = cell
    unit = table.unit(axes["x"])
    return replace(
        table,
        names=(*own, *found),
        columns=[*([frame[k] for frame in rows] for k in range(len(own))), *found.values()],
        places=[places[frame] for frame in rows],
        units={**table.units, **(dict.fromkeys(found, unit) if unit else {})},
        notes=(*table.notes, f"rows of {len(set(marks))} landmarks are merged, one row per frame"),
    )
