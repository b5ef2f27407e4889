"""Raw table of a file: named columns of text or numbers; rows of landmarks are merged, one row per frame.

Reader of text tables: separator, header and layout (one header line, OptiTrack Motive's or Vicon's). Motive (format
1.2x): a line of key-value pairs; then, over each column, the kind of object, its name, its id, ``Rotation`` or
``Position``, and the axis. Vicon: a section's name, such as ``Trajectories``; the rate; the objects' names over the
first of their columns; the axes; the units.
"""

from __future__ import annotations

import codecs
import contextlib
import csv
import io
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice, product, zip_longest
from pathlib import Path
from typing import Literal

import numpy as np

from gazempc.errors import RecordingError, shown, suggest
from gazempc.files.bounds import MEGABYTE
from gazempc.files.text import decode, read_bytes
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
        rate_hz: Frame rate, if stated in the file.
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
    landmarks = dict.fromkeys(marks)
    found = {f"{prefix}{mark}_{axis}": [""] * len(rows) for mark in landmarks for axis in "xyz"}
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
        notes=(*table.notes, f"rows of {len(landmarks)} landmarks are merged, one row per frame"),
    )


Row = tuple[int, tuple[str, ...]]
# Sections of Vicon's files with poses; a file may have several, and devices before them.
_VICON_SECTIONS = ("Trajectories", "Segments", "Objects", "Model Outputs")
_AXES = "Frame"  # begins the line of axes
_SPACES = " "
# Number of lines from which the separator is inferred.
_SEPARATOR_LINES = 50
# A row of 10,000 columns has a tenth of it.
_LONGEST_LINE_BYTES = MEGABYTE
_FORMAT = "a CSV table"


def read_text_table(path: Path) -> RawTable:
    """Read a table of text: separated by comma, semicolon, tab or spaces; with or without a header.

    Args:
        path: File to read; UTF-8, or as Excel writes it. Blank lines, lines that begin with ``#``, and lines of text
            before the table are skipped.

    Returns:
        The table, laid out as by OptiTrack Motive, by Vicon, with one header line, or without.

    Raises:
        RecordingError: If the file is not such a table; rows are counted as lines of the file, from 1.
    """
    text = _text(path)
    separator = _separator_of(text)
    if (numeric := _numeric(path, text, separator)) is not None:
        return numeric
    rows = _rows(path, text, separator)
    if not rows:
        raise _no_rows(path)
    if rows[0][1][0].strip() == "Format Version":
        return _motive_table(path, rows)
    return _vicon_table(path, rows) or _plain(path, text, separator, rows)


def _text(path: Path) -> str:
    """The file's text: UTF-8, or UTF-16 with a byte order mark."""
    data = read_bytes(path)
    marks = np.frombuffer(data, dtype=np.uint8)
    lengths = np.diff(np.flatnonzero((marks == ord("\n")) | (marks == ord("\r"))), prepend=-1, append=len(data))
    line = int(np.argmax(lengths))
    if lengths[line] > _LONGEST_LINE_BYTES:
        problem = f"it has {lengths[line]} bytes"
        raise RecordingError(path, f"line {line + 1}", problem, f"lines of {_LONGEST_LINE_BYTES} bytes at most")
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        with contextlib.suppress(UnicodeDecodeError):
            return data.decode("utf-16")
    return decode(path, data, _FORMAT)


def _split(line: str, separator: str) -> list[str]:
    return [cell.strip() for cell in (line.split() if separator == _SPACES else line.split(separator))]


def _separator_of(text: str) -> str:
    """First of tab, semicolon and comma that splits most lines; else spaces."""
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")][:_SEPARATOR_LINES]
    # The last line has decimal commas, separated by spaces.
    last = lines[-1].split() if lines else []
    spaced_commas = len(last) > 1 and all(map(is_number, last)) and any(map(has_decimal_comma, last))
    for separator in ("\t", ";", ","):
        if sum(separator in line for line in lines) > 0.8 * len(lines) and not (separator == "," and spaced_commas):
            return separator
    return _SPACES if spaced_commas or (lines and not any("," in line for line in lines)) else ","


def _numeric(path: Path, text: str, separator: str) -> RawTable | None:
    """Fast path, a fifth of the time: one header line and numbers only; None for any other form."""
    header, _, body = text.partition("\n")
    names = _split(header, separator)
    if '"' in header or header.startswith("#") or any(map(is_number, names)) or not all(names) or not body.strip():
        return None
    # Blank lines and comments shift the numbers of the rows; Python reads 1_0 as 10.
    if any(mark in body for mark in ("\n\n", "\r\n\r\n", "#", '"', "_")) or body.startswith(("\n", "\r")):
        return None
    delimiter = None if separator == _SPACES else separator
    try:
        values = np.loadtxt(io.StringIO(body), dtype=np.float64, delimiter=delimiter, comments=None, ndmin=2)
    except ValueError:
        return None
    if values.shape[1] != len(names):
        return None
    return RawTable(path, "plain", tuple(names), list(values.T.copy()), range(2, len(values) + 2))


def _rows(path: Path, text: str, separator: str) -> list[Row]:
    """Rows and their line numbers, without blank lines and comments."""
    if separator == _SPACES:
        split = ((number, tuple(line.split())) for number, line in enumerate(text.splitlines(), 1))
        return [(number, row) for number, row in split if row and not row[0].startswith("#")]
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    try:
        # The garbage collector does not track tuples of text: a fifth of the time.
        return [(reader.line_num, tuple(row)) for row in reader if row and not row[0].startswith("#")]
    except csv.Error as error:
        raise RecordingError(path, f"row {reader.line_num}", f"{error}", "a comma-separated table") from None


def _plain(path: Path, text: str, separator: str, rows: list[Row]) -> RawTable:
    """A table with one header line, possibly in a comment, or without."""
    notes: list[str] = []
    width = Counter(len(row) for _, row in rows).most_common(1)[0][0]
    # Lines of text before the table have at most half as many cells.
    first = next(k for k, (_, row) in enumerate(rows) if 2 * len(row) > width)
    if first:
        notes.append(f"the first {first} lines are not part of the table: skipped")
        rows = rows[first:]
    names, units = [name.strip() for name in rows[0][1]], dict[str, str]()
    layout: Layout = "plain"
    if not any(map(is_number, names)):
        words = [cell.strip("[]() ").lower() for cell in rows[1][1]] if len(rows) > 1 else []
        # A second line of units only.
        if any(words) and set(words) <= {*UNIT_WORDS, ""}:
            units = {name: UNIT_WORDS[word] for name, word in zip(names, words, strict=False) if word}
        rows = rows[2 if units else 1 :]
    elif commented := _commented_header(text, separator, rows[0]):
        names = commented
    else:
        names, layout = [str(k + 1) for k in range(width)], "no header"
        # Programs print messages in between.
        if odd := [line for line, row in rows if len(row) != width]:
            notes.append(f"{len(odd)} rows do not have {width} cells (first row {odd[0]}): dropped")
        rows = [(line, row) for line, row in rows if len(row) == width]
    width = len(names)
    rows = [(line, row if any(cell.strip() for cell in row[width:]) else row[:width]) for line, row in rows]
    if len(rows) > 1 and len(rows[-1][1]) < width:
        notes.append(f"the last row ({rows[-1][0]}) is truncated: dropped")
        rows = rows[:-1]
    for line, row in rows:
        if len(row) != width:
            raise RecordingError(path, f"row {line}", f"{len(row)} cells", f"{width} cells, as in the header")
    return RawTable(path, layout, tuple(names), *_cells(path, names, rows), units, notes=tuple(notes))


def _commented_header(text: str, separator: str, first: Row) -> list[str] | None:
    """The header in the last comment before a first row of numbers; None if there is none."""
    lines = [line for line in text.splitlines()[: first[0] - 1] if line.startswith("#")]
    headers = [names for line in lines if len(names := _split(line.lstrip("# "), separator)) == len(first[1])]
    return headers[-1] if headers else None


def _motive_table(path: Path, rows: list[Row]) -> RawTable:
    """A table exported by OptiTrack Motive, columns named ``object.Position.X``."""
    facts = dict(zip(rows[0][1][0::2], rows[0][1][1::2], strict=False))
    axes = next((k for k, (_, row) in enumerate(rows) if row[0].strip() == _AXES), 0)
    # Above the axes: Rotation or Position; above these: names and ids, in an order that depends on the version.
    above = [row for _, row in rows[1 : axes - 1] if any(cell.strip() for cell in row)]
    if axes < 4 or len(above) < 2:
        problem = f"no line that begins with {_AXES!r} under kinds and names of objects"
        raise RecordingError(path, "header", problem, "a CSV export of Motive with headers")
    if facts.get("Coordinate Space", "Global").strip() not in ("Global", ""):
        raise RecordingError(
            path, "header", f"Coordinate Space {facts['Coordinate Space']!r}", "an export with Coordinate Space Global"
        )
    names = []
    for k, axis in enumerate(rows[axes][1]):
        over = (above[0], above[1], rows[axes - 1][1])
        kind, name, quantity = (line[k].strip() if k < len(line) else "" for line in over)
        # Distinguishes a body's markers from bodies.
        quantity = "Marker" if "Marker" in kind and quantity == "Position" else quantity
        names.append(".".join(part for part in (*((name, quantity) if k > 1 else ()), axis.strip()) if part))
    length = UNIT_WORDS.get(facts.get("Length Units", "").strip().lower())
    units = {name: length for name in names if length and (".Position." in name or ".Marker." in name)}
    rotation = facts.get("Rotation Type", "Quaternion").strip()
    note = f"orientations are Euler angles in the order {rotation}: export quaternions, or add "
    notes = () if rotation == "Quaternion" else (f"{note}head_euler=NAME.Rotation:ORDER:deg",)
    cells, rate_hz = _cells(path, names, rows[axes + 1 :]), _rate_hz(facts.get("Export Frame Rate", ""))
    return RawTable(path, "motive", tuple(names), *cells, units, rate_hz, notes)


def _vicon_table(path: Path, rows: list[Row]) -> RawTable | None:
    """A table exported by Vicon Nexus, Tracker or Shogun, columns named ``object.X``; None for another program's.

    Only the first section with poses is read.
    """
    starts = {row[0].strip(): k for k, (_, row) in enumerate(rows[:-1]) if is_number(rows[k + 1][1][0])}
    first = next((starts[name] for name in _VICON_SECTIONS if name in starts), None)
    if first is None:
        return None
    if len(rows) < first + 5 or rows[first + 3][1][0].strip() != _AXES:
        problem = f"no line that begins with {_AXES!r} under it"
        raise RecordingError(path, f"row {rows[first][0]}", problem, "a CSV export of Vicon")
    objects, axes, units = (rows[first + k][1] for k in (2, 3, 4))
    names, name = [], ""
    for k, axis in enumerate(axes):
        name = (objects[k].strip() if k < len(objects) else "") or name
        # Vicon Tracker writes "Global Angle Anna:Anna" over the angles.
        name = name.removeprefix("Global Angle ")
        names.append(f"{name}.{axis.strip()}" if k > 1 else axis.strip())
    words = [unit.strip().lower() for unit in units]
    of_columns = {name: UNIT_WORDS[word] for name, word in zip(names, words, strict=False) if word in UNIT_WORDS}
    body = rows[first + 5 :]
    end = next((k for k, (_, row) in enumerate(body) if not is_number(row[0]) or len(row) == 1), len(body))
    cells = _cells(path, names, body[:end])
    return RawTable(path, "vicon", tuple(names), *cells, of_columns, _rate_hz(rows[first + 1][1][0]))


def _cells(path: Path, names: list[str], rows: list[Row]) -> tuple[list[tuple[str, ...]], list[int]]:
    """Cells of each column, and lines of the rows; programs omit blank cells at the end of a row."""
    if not rows:
        raise _no_rows(path)
    padded = zip_longest(names, *(row for _, row in rows), fillvalue="")
    return [column[1:] for column in islice(padded, len(names))], [line for line, _ in rows]


def _rate_hz(cell: str) -> float | None:
    rate_hz = _number(cell)
    return rate_hz if rate_hz is not None and rate_hz > 0 else None


def _no_rows(path: Path) -> RecordingError:
    return RecordingError(path, "", "a header and no rows", "one row per frame after the header")
