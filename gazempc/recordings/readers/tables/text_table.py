"""Tables as text: separator, header and layout, one header line or those of OptiTrack Motive and Vicon.

Motive (format 1.2x): a line of pairs of fact and value; then, over each column, the kind of object, its name, its id,
``Rotation`` or ``Position``, and the axis. Vicon: a section's name, such as ``Trajectories``; the rate; the objects'
names over the first of their columns; the axes; the units.
"""

from __future__ import annotations

import codecs
import contextlib
import csv
import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gazempc.errors import RecordingError
from gazempc.files.bounds import MEGABYTE
from gazempc.recordings.readers.tables.raw_table import UNIT_WORDS, RawTable, has_decimal_comma, is_number
from gazempc.recordings.readers.text import decode, read_bytes
from gazempc.types import FloatArray

# Where Vicon's programs put poses; a file may hold several sections, and devices before them.
_VICON_SECTIONS = ("Trajectories", "Segments", "Objects", "Model Outputs")
_MOTIVE_AXES = "Frame"
Row = tuple[int, tuple[str, ...]]


def motive_table(path: Path, rows: list[Row]) -> RawTable:
    """A table exported by OptiTrack Motive, columns named ``object.Position.X``.

    Args:
        path: File it is from.
        rows: All rows that are not blank, with their lines.

    Returns:
        The table, with the file's unit of length and frame rate.

    Raises:
        RecordingError: If the header has another form, or no rows follow it.
    """
    facts = dict(zip(rows[0][1][0::2], rows[0][1][1::2], strict=False))
    axes = next((k for k, (_, row) in enumerate(rows) if row[0].strip() == _MOTIVE_AXES), None)
    if axes is None or axes < 4:
        raise RecordingError(path, "header", "no line that begins with 'Frame'", "a CSV export of Motive with headers")
    # Above the axes stand Rotation or Position; above these names and ids, in an order that versions change.
    things = rows[axes - 1][1]
    above = [row for _, row in rows[1 : axes - 1] if any(cell.strip() for cell in row)]
    if len(above) < 2:
        raise RecordingError(path, "header", "no lines with kinds and names of objects", "a CSV export with headers")
    names = []
    for k, axis in enumerate(rows[axes][1]):
        kind, name, thing = (line[k].strip() if k < len(line) else "" for line in (above[0], above[1], things))
        # A body's markers must not pass for bodies.
        thing = "Marker" if "Marker" in kind and thing == "Position" else thing
        names.append(".".join(part for part in (*((name, thing) if k > 1 else ()), axis.strip()) if part))
    length = UNIT_WORDS.get(facts.get("Length Units", "").strip().lower())
    units = {name: length for name in names if length and (".Position." in name or ".Marker." in name)}
    notes = []
    rotation = facts.get("Rotation Type", "Quaternion").strip()
    if rotation != "Quaternion":
        notes.append(
            f"orientations are Euler angles in the order {rotation}, which is not read by itself: export quaternions, "
            "or say head_euler=NAME.Rotation:ORDER:deg"
        )
    if facts.get("Coordinate Space", "Global").strip() not in ("Global", ""):
        raise RecordingError(path, "header", f"Coordinate Space {facts['Coordinate Space']!r}", "an export in Global")
    return _table(path, "motive", names, rows[axes + 1 :], units, _rate(facts.get("Export Frame Rate", "")), notes)


def vicon_table(path: Path, rows: list[Row]) -> RawTable | None:
    """A table exported by Vicon Nexus, Tracker or Shogun, columns named ``object.X``.

    Args:
        path: File it is from.
        rows: All rows that are not blank, with their lines.

    Returns:
        The first section that holds poses, with its units and rate; None if the file has none.

    Raises:
        RecordingError: If the section's header has another form, or no rows follow it.
    """
    starts = {
        row[0].strip(): k
        for k, (_, row) in enumerate(rows[:-1])
        if row[0].strip() in _VICON_SECTIONS and is_number(rows[k + 1][1][0])
    }
    section = next((name for name in _VICON_SECTIONS if name in starts), None)
    if section is None:
        return None
    first = starts[section]
    if len(rows) < first + 5 or rows[first + 3][1][0].strip() != "Frame":
        raise RecordingError(
            path, f"row {rows[first][0]}", "no line that begins with 'Frame' under it", "a CSV export of Vicon"
        )
    objects, axes, units = (rows[first + k][1] for k in (2, 3, 4))
    names, name = [], ""
    for k, axis in enumerate(axes):
        name = (objects[k].strip() if k < len(objects) else "") or name
        # Vicon Tracker writes "Global Angle Anna:Anna" over the angles.
        name = name.removeprefix("Global Angle ")
        names.append(f"{name}.{axis.strip()}" if k > 1 else axis.strip())
    found = {n: UNIT_WORDS.get(unit.strip().lower()) for n, unit in zip(names, units, strict=False)}
    body = rows[first + 5 :]
    end = next((k for k, (_, row) in enumerate(body) if not is_number(row[0]) or len(row) == 1), len(body))
    rate_hz = _rate(rows[first + 1][1][0])
    return _table(path, "vicon", names, body[:end], {n: u for n, u in found.items() if u}, rate_hz, [])


def _table(
    path: Path,
    layout: str,
    names: list[str],
    rows: list[Row],
    units: dict[str, str],
    rate_hz: float | None,
    notes: list[str],
) -> RawTable:
    if not rows:
        raise RecordingError(path, "", "a header and no rows", "a row a frame after the header")
    width = len(names)
    # Programs leave out the blank cells of what is not seen at the end of a row.
    padded = [[*row[:width], *[""] * (width - len(row))] for _, row in rows]
    return RawTable(
        path=path,
        layout="motive" if layout == "motive" else "vicon",
        names=tuple(names),
        columns=list(zip(*padded, strict=True)),
        places=[f"row {line}" for line, _ in rows],
        units=units,
        rate_hz=rate_hz,
        notes=tuple(notes),
    )


def _rate(text: str) -> float | None:
    return float(text) if is_number(text) and float(text) > 0 else None


_SPACES = " "
_SEPARATOR_LINE = re.compile(r"sep=(.)", re.IGNORECASE)
# So many lines tell the separator.
_LOOKED_AT = 50
# A row of 10,000 columns has a tenth of it.
_LONGEST_LINE_BYTES = MEGABYTE
_FORMAT = "a CSV table"


def read_text_table(path: Path) -> RawTable:
    """Read a table of text: separated by comma, semicolon, tab or spaces; with or without a header.

    Args:
        path: File to read; UTF-8, or as Excel writes it. Blank lines, lines that begin with ``#``, and a few words
            before the table are skipped.

    Returns:
        The table, laid out as by OptiTrack Motive, by Vicon, with one header line, or without.

    Raises:
        RecordingError: If the file is not such a table; rows are counted as lines of the file, from 1.
    """
    text = _text(path)
    first = text[: text.find("\n")].strip()
    said = _SEPARATOR_LINE.fullmatch(first)
    separator = said[1] if said else _separator_of(text)
    if not said and (numeric := _numeric(path, text, separator)) is not None:
        return numeric
    rows = [(line, row) for line, row in _rows(path, text, separator) if not (said and line == 1)]
    if rows and rows[0][1][0].strip() == "Format Version":
        return motive_table(path, rows)
    if (vicon := vicon_table(path, rows)) is not None:
        return vicon
    return _plain(path, text, separator, rows)


def _text(path: Path) -> str:
    """The file's text: UTF-8, UTF-16 by its mark, or Windows' letters where they stand in the first line only."""
    data = read_bytes(path, _FORMAT)
    marks = np.frombuffer(data, dtype=np.uint8)
    ends = np.flatnonzero((marks == ord("\n")) | (marks == ord("\r")))
    lengths = np.diff(ends, prepend=-1, append=len(data))
    if lengths.max() > _LONGEST_LINE_BYTES:
        line = int(np.argmax(lengths)) + 1
        problem = f"it has {int(lengths[line - 1])} bytes"
        raise RecordingError(path, f"line {line}", problem, f"lines of {_LONGEST_LINE_BYTES} bytes at most")
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        with contextlib.suppress(UnicodeDecodeError):
            return data.decode("utf-16")
    header, newline, rest = data.partition(b"\n")
    if newline and not header.isascii() and rest.isascii():
        try:
            header.decode("utf-8")
        except UnicodeDecodeError:
            return header.decode("cp1252") + "\n" + rest.decode("ascii")
    return decode(path, data, _FORMAT)


def _numeric(path: Path, text: str, separator: str) -> RawTable | None:
    """A table of numbers alone under one header line, a fifth of the time; None if the table has another form."""
    header, newline, body = text.partition("\n")
    names = [name.strip() for name in (header.split() if separator == _SPACES else header.split(separator))]
    if (
        not newline
        or '"' in header
        or header.startswith("#")
        or any(map(is_number, names))
        or not all(names)
        or not body.strip()
    ):
        return None
    # Blank lines and comments shift the numbers of the rows; Python reads 1_0 as 10.
    if any(mark in body for mark in ("\n\n", "\r\n\r\n", "#", '"', "_")) or body.startswith(("\n", "\r")):
        return None
    try:
        values: FloatArray = np.loadtxt(
            io.StringIO(body), delimiter=None if separator == _SPACES else separator, comments=None, ndmin=2
        )
    except ValueError:
        return None
    if values.shape[1] != len(names) or not len(values):
        return None
    return RawTable(path, "plain", tuple(names), list(values.T.copy()), Rows(range(2, len(values) + 2)))


class Rows(Sequence[str]):
    """Words for the rows of a table, made when they are read.

    Args:
        lines: Line of each row.
    """

    def __init__(self, lines: Sequence[int]) -> None:
        self._lines = lines

    def __len__(self) -> int:
        return len(self._lines)

    def __getitem__(self, index: Any) -> Any:
        found = self._lines[index]
        return Rows(found) if isinstance(index, slice) else f"row {found}"


def _separator_of(text: str) -> str:
    """Of tab, semicolon and comma the first that cuts most lines; else spaces."""
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")][:_LOOKED_AT]
    for separator in ("\t", ";", ","):
        cut = sum(separator in line for line in lines)
        if cut > 0.8 * len(lines) and not (separator == "," and _spaced_decimal_commas(lines)):
            return separator
    spaced = bool(lines) and (not any("," in line for line in lines) or _spaced_decimal_commas(lines))
    return _SPACES if spaced else ","


def _spaced_decimal_commas(lines: list[str]) -> bool:
    """Whether spaces separate the numbers of the last line, and commas are in them."""
    cells = lines[-1].split()
    return len(cells) > 1 and all(is_number(cell) for cell in cells) and any(map(has_decimal_comma, cells))


def _rows(path: Path, text: str, separator: str) -> Iterator[Row]:
    """Rows that are not blank and no comment, with their line."""
    if separator == _SPACES:
        for number, line in enumerate(text.splitlines(), 1):
            if line.strip() and not line.startswith("#"):
                yield number, tuple(line.split())
        return
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    try:
        for row in reader:
            if row and not row[0].startswith("#"):
                # Tuples of text are left alone by the garbage collector: a fifth of the time.
                yield reader.line_num, tuple(row)
    except csv.Error as error:
        raise RecordingError(path, f"row {reader.line_num}", f"{error}", "a comma-separated table") from None


def _plain(path: Path, text: str, separator: str, rows: list[Row]) -> RawTable:
    """A table with one header line, in a comment if need be, or without."""
    rows, notes = _without_preamble(rows)
    header, rows = _header(text, separator, rows)
    if header is None:
        rows, odd = _of_usual_width(rows)
        notes += odd
    names = header if header is not None else [str(k + 1) for k in range(len(rows[0][1]))] if rows else []
    units = _units(names, rows) if header is not None else {}
    rows = rows[1:] if units else rows
    rows = [(line, _without_blank_end(row, len(names))) for line, row in rows]
    if len(rows) > 1 and len(rows[-1][1]) < len(names):
        notes.append(f"the last row ({rows[-1][0]}) is cut off: dropped")
        rows = rows[:-1]
    for line, row in rows:
        if len(row) != len(names):
            raise RecordingError(path, f"row {line}", f"{len(row)} cells", f"{len(names)} cells, as in the header")
    if not rows:
        raise RecordingError(path, "", "a header and no rows", "a row a frame after the header")
    return RawTable(
        path=path,
        layout="plain" if header is not None else "no header",
        names=tuple(names),
        columns=list(zip(*(row for _, row in rows), strict=True)),
        places=Rows([line for line, _ in rows]),
        units=units,
        notes=tuple(notes),
    )


def _without_preamble(rows: list[Row]) -> tuple[list[Row], list[str]]:
    """Rows without those in front of the table that have half as many cells or fewer; and what is said of it."""
    if not rows:
        return rows, []
    width = Counter(len(row) for _, row in rows).most_common(1)[0][0]
    first = next(k for k, (_, row) in enumerate(rows) if 2 * len(row) > width)
    return rows[first:], [f"the first {first} lines are no part of the table: skipped"] if first else []


def _of_usual_width(rows: list[Row]) -> tuple[list[Row], list[str]]:
    """Rows without those in between that programs print for people; and what is said of it."""
    if not rows:
        return rows, []
    width = Counter(len(row) for _, row in rows).most_common(1)[0][0]
    usual = [(line, row) for line, row in rows if len(row) == width]
    odd = [line for line, row in rows if len(row) != width]
    return usual, [f"{len(odd)} rows have not {width} cells (first row {odd[0]}): dropped"] if odd else []


def _units(names: list[str], rows: list[Row]) -> dict[str, str]:
    """Units of the columns where the first row holds nothing else; empty where it does not."""
    words = [cell.strip("[]() ").lower() for cell in rows[0][1]] if rows else []
    if not any(words) or not set(words) <= {*UNIT_WORDS, ""}:
        return {}
    return {name: UNIT_WORDS[word] for name, word in zip(names, words, strict=False) if word}


def _header(text: str, separator: str, rows: list[Row]) -> tuple[list[str] | None, list[Row]]:
    """The header, and the rows after it: the first row if no cell of it is a number, or a comment before it."""
    if rows and not any(is_number(cell) for cell in rows[0][1]):
        return [name.strip() for name in rows[0][1]], rows[1:]
    for line in text.splitlines()[: rows[0][0] - 1 if rows else 0][::-1]:
        inside = line.lstrip("# ")
        cells = inside.split() if separator == _SPACES else inside.split(separator)
        if line.startswith("#") and len(cells) == len(rows[0][1]):
            return [name.strip() for name in cells], rows
    return None, rows


def _without_blank_end(row: tuple[str, ...], width: int) -> tuple[str, ...]:
    """A row without blank cells beyond the header's."""
    return row[:width] if len(row) > width and not any(cell.strip() for cell in row[width:]) else row
