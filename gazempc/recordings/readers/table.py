"""Recordings as tables, as programs export them: finds out what the columns mean, and reads them.

The package's own columns, in any order, are ``t`` (seconds) and ``head_{x,y,z}`` (metres, z up, right-handed).
Optional are ``pelvis_{x,y,z}``, ``head_q{w,x,y,z}`` and ``pelvis_q{w,x,y,z}`` (unit quaternions; the identity faces
+x with +y to the left). Other columns are ignored. For other tables a mapping says what the columns mean: the user's,
one that was saved beside the file, one that ships, or a guess.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from gazempc.errors import RecordingError, shown
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.readers.tables.guess import Guess, guess
from gazempc.recordings.readers.tables.long import wide
from gazempc.recordings.readers.tables.mapped import recording_of
from gazempc.recordings.readers.tables.mapping import (
    ColumnMapping,
    parse_columns,
    read_mapping,
    save_mapping,
    saved_places,
)
from gazempc.recordings.readers.tables.mvnx import mvnx_table
from gazempc.recordings.readers.tables.openpose import openpose_table
from gazempc.recordings.readers.tables.own import NEEDED, own_mapping
from gazempc.recordings.readers.tables.parquet import parquet_table
from gazempc.recordings.readers.tables.raw_table import RawTable
from gazempc.recordings.readers.tables.shipped import fitting_mapping
from gazempc.recordings.readers.tables.text_table import read_text_table
from gazempc.recordings.recording import Recording


def read_table(path: Path, options: ReadOptions) -> Recording:
    """Read a table: text, Parquet, Xsens MVN's ``.mvnx``, or a folder of OpenPose's files.

    Args:
        path: What to read; the ending says what it is.
        options: What the user says of its columns and people.

    Returns:
        The recording, with the file's own time stamps.

    Raises:
        RecordingError: If the file is no table, or its columns are not understood; rows of text are lines, from 1.
        SettingsError: If an option is wrong.
        MissingOptionalDependencyError: If the format needs a package that is not installed.
    """
    table = _raw(path)
    mapping, notes = mapping_of(table, options)
    return recording_of(table, mapping, options.person, notes)


def remember_columns(path: Path, options: ReadOptions) -> str:
    """Save what the user said of a table's columns, or had guessed, beside it: next time nothing need be said.

    Args:
        path: What was read.
        options: What the user said.

    Returns:
        What was done, for people; empty if there is nothing to remember.

    Raises:
        RecordingError: If the table cannot be read.
    """
    is_table = path.is_dir() or path.suffix.lower() in TABLES
    if not is_table or not (options.columns is not None or options.guess):
        return ""
    mapping, _ = mapping_of(_raw(path), options)
    try:
        return f"columns saved in {save_mapping(path, mapping)}"
    except RecordingError as error:
        return f"columns not saved: {error}"


def mapping_of(table: RawTable, options: ReadOptions) -> tuple[ColumnMapping, tuple[str, ...]]:
    """What the columns of a table mean, by the first that says it: user, saved file, header, shipped mapping, guess.

    Args:
        table: The table.
        options: What the user says; `columns` completes or overrules what is found otherwise.

    Returns:
        The mapping, and what is to be said of it.

    Raises:
        RecordingError: If nothing says it; proposes a guess.
        SettingsError: If an option or a saved file is wrong.
    """
    said = parse_columns(options.columns) if options.columns is not None else ColumnMapping()
    base, notes = _found(table, options, complete=said.t is not None and said.head is not None)
    return said.over(base), notes


def _raw(path: Path) -> RawTable:
    return openpose_table(path) if path.is_dir() else wide(TABLES[path.suffix.lower()](path))


def _found(table: RawTable, options: ReadOptions, complete: bool) -> tuple[ColumnMapping, tuple[str, ...]]:
    if options.mapping is not None:
        return read_mapping(options.mapping), (f"columns as in {options.mapping}",)
    if complete:
        return ColumnMapping(), ()
    saved = next((place for place in saved_places(table.path) if place.is_file()), None)
    if saved is not None:
        return read_mapping(saved), (f"columns as in {saved}",)
    if set(NEEDED) <= set(table.names):
        return own_mapping(table), ()
    fitting = fitting_mapping(table)
    if fitting is not None:
        name, shipped = fitting
        note = (shipped.note,) if shipped.note else ()
        return ColumnMapping.model_validate(shipped.texts()), (f"columns as in {name}: {shipped.source}", *note)
    guessed = _guess(table)
    if options.guess and guessed is not None:
        return guessed.mapping, (f'columns guessed: "{guessed.mapping.as_option()}"', *guessed.remarks)
    missing = [name for name in NEEDED if name not in table.names]
    proposal = (
        "no columns that could be the time and one head: say them, such as --reading.columns 't=stamp:ms, "
        "head=[px,py,pz]:mm'"
    )
    if guessed is not None:
        remarks = f" ({'; '.join(guessed.remarks)})" if guessed.remarks else ""
        proposal = (
            f'a guess: --reading.columns "{guessed.mapping.as_option()}"{remarks}; paste and correct it, or take it as '
            "it is by --guess"
        )
    raise RecordingError(
        table.path,
        "header",
        f"missing column(s) {', '.join(missing)}; found {shown(', '.join(table.names), 200)}",
        f"the columns {', '.join(NEEDED)}, or what the columns mean; {proposal}",
    )


def _guess(table: RawTable) -> Guess | None:
    try:
        return guess(table)
    except RecordingError:  # such as a cell that is no number: nothing can be told from such columns
        return None


# How tables are read, by the ending of the file.
TABLES: dict[str, Callable[[Path], RawTable]] = {
    ".csv": read_text_table,
    ".tsv": read_text_table,
    ".txt": read_text_table,
    ".parquet": parquet_table,
    ".mvnx": mvnx_table,
}
