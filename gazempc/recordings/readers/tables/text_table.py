"""Text tables: separator, header and layout (one header line, OptiTrack Motive's or Vicon's).

Motive (format 1.2x): a line of key-value pairs; then, over each column, the kind of object, its name, its id,
``Rotation`` or ``Position``, and the axis. Vicon: a section's name, such as ``Trajectories``; the rate; the objects'
names over the first of their columns; the axes; the units.
"""

from __future__ import annotations

import codecs
import contextlib
import csv
import io
from collections import Counter
from itertools import islice, zip_longest
from pathlib import Path

import numpy as np

from gazempc.errors import RecordingError
from gazempc.files.bounds import MEGABYTE, decode, read_bytes
from gazempc.recordings.readers.tables.raw_table import (
    UNIT_WORDS,
    Layout,
    RawTable,
    _number,
    has_decimal_comma,
    is_number,
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
    width = Counter(len(row) for _, row in rows).most_common(1)[0][0]
    # Lines of text before the table have at most half as many cells.
    first = next(k for k, (_, row) in enumerate(rows) if 2 * len(row) > width)
    rows, notes = rows[first:], [f"the first {first} lines are not part of the table: skipped"] if first else []
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
    if (space := facts.get("Coordinate Space", "").strip()) not in ("Global", ""):
        raise RecordingError(path, "header", f"Coordinate Space {space!r}", "an export with Coordinate Space Global")
    names = []
    for k, axis in enumerate(rows[axes][1]):
        kind, name, quantity = ("".join(line[k : k + 1]).strip() for line in (*above[:2], rows[axes - 1][1]))
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
        # Vicon Tracker writes "Global Angle Anna:Anna" over the angles.
        name = "".join(objects[k : k + 1]).strip().removeprefix("Global Angle ") or name
        names.append(f"{name}.{axis.strip()}" if k > 1 else axis.strip())
    words = (UNIT_WORDS.get(unit.strip().lower()) for unit in units)
    of_columns = {name: word for name, word in zip(names, words, strict=False) if word}
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
    return rate_hz if rate_hz and rate_hz > 0.0 else None  # NaN is neither


def _no_rows(path: Path) -> RecordingError:
    return RecordingError(path, "", "a header and no rows", "one row per frame after the header")
