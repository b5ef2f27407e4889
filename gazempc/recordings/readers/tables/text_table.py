"""Tables as text: finds the separator, the header and the layout, and cuts the text into columns."""

from __future__ import annotations

import codecs
import contextlib
import csv
import io
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from gazempc.errors import RecordingError
from gazempc.files.bounds import MOST_TEXT_BYTES, read_limited
from gazempc.recordings.readers.tables.mocap_headers import motive_table, vicon_table
from gazempc.recordings.readers.tables.raw_table import UNIT_WORDS, RawTable, has_decimal_comma, is_number
from gazempc.recordings.readers.text import read_text

_SPACES = " "
_SEPARATOR_LINE = re.compile(r"sep=(.)", re.IGNORECASE)
# So many lines tell the separator.
_LOOKED_AT = 50
Row = tuple[int, list[str]]


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
    first = text.split("\n", 1)[0].strip()
    said = _SEPARATOR_LINE.fullmatch(first)
    separator = said[1] if said else _separator_of(text)
    rows = [(line, row) for line, row in _rows(path, text, separator) if not (said and line == 1)]
    if rows and rows[0][1][0].strip() == "Format Version":
        return motive_table(path, rows)
    if (vicon := vicon_table(path, rows)) is not None:
        return vicon
    return _plain(path, text, separator, rows)


def _text(path: Path) -> str:
    """The file's text: UTF-8, UTF-16 by its mark, or Windows' letters where they stand in the first line only."""
    with contextlib.suppress(OSError, UnicodeDecodeError):
        data = read_limited(path, MOST_TEXT_BYTES)
        if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return data.decode("utf-16")
        header, newline, rest = data.partition(b"\n")
        if newline and not header.isascii() and rest.isascii():
            with contextlib.suppress(UnicodeDecodeError):
                header.decode("utf-8")
                return read_text(path, "a CSV table")
            return header.decode("cp1252") + "\n" + rest.decode("ascii")
    return read_text(path, "a CSV table")


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
                yield number, line.split()
        return
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    try:
        for row in reader:
            if row and not row[0].startswith("#"):
                yield reader.line_num, row
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
        places=[f"row {line}" for line, _ in rows],
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


def _without_blank_end(row: list[str], width: int) -> list[str]:
    """A row without blank cells beyond the header's."""
    return row[:width] if len(row) > width and not any(cell.strip() for cell in row[width:]) else row
