"""Reader of recordings in tables: mapping of the columns, and conversion to a recording.

The package's own columns, in any order, are ``t`` (seconds) and ``head_{x,y,z}`` (metres, z up, right-handed).
Optional are ``pelvis_{x,y,z}``, ``head_q{w,x,y,z}`` and ``pelvis_q{w,x,y,z}`` (unit quaternions; the identity faces
+x with +y to the left). Other columns are ignored. For other tables a mapping gives the meaning of the columns: the
user's, one saved beside the file, a shipped one, or a guess.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from gazempc.errors import RecordingError, SettingsError, shown, suggest
from gazempc.files.documents import as_toml
from gazempc.files.whole import write_whole
from gazempc.recordings.readers.bag_frames import FIXED_FRAMES, person_axes
from gazempc.recordings.readers.checks import recording_of
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.readers.tables.body_poses import read_parts, ros_frame
from gazempc.recordings.readers.tables.mapping import (
    NEEDED,
    ColumnMapping,
    ShippedMapping,
    choose_from_header,
    guess,
    own_mapping,
    parse_columns,
    people_in_header,
    read_mapping,
    saved_places,
)
from gazempc.recordings.readers.tables.other_files import is_openpose_folder, mvnx_table, openpose_table, parquet_table
from gazempc.recordings.readers.tables.raw_table import PERSON, RawTable, is_number, wide
from gazempc.recordings.readers.tables.text_table import read_text_table
from gazempc.recordings.recording import Recording, Track
from gazempc.specfiles import load_spec, shipped_names

FOLDER = "recordings/readers/tables/mappings"
# Minimum share of usable rows; more unusable rows indicate wrong columns.
_LEAST_USABLE = 0.5
# Hips' height of a standing person of 1.75 m, for files with the hips at the origin; and tolerance of that origin.
HIPS_HEIGHT_M, _HIPS_AT_ORIGIN_M = 0.95, 0.1
_FEW_ROWS = 20
_EVERY_ROW = ":30hz"
# Number of other people in a note, which is one line.
_SHOWN_PEOPLE = 8
# Keys whose values name columns.
_COLUMN_KEYS = ColumnMapping.model_fields.keys() - {"head", "axes", "head_axes", "pelvis_axes", "origin", "kind"}
_OPTIONAL_PARTS = {
    "the head's orientation": "head_quat_wxyz",
    "the pelvis's position": "pelvis_position_m",
    "the pelvis's orientation": "pelvis_quat_wxyz",
}
# Readers of tables, by the ending of the file.
TABLES: dict[str, Callable[[Path], RawTable]] = {
    **dict.fromkeys((".csv", ".tsv", ".txt"), read_text_table),
    ".parquet": parquet_table,
    ".mvnx": mvnx_table,
}


def read_table(path: Path, options: ReadOptions) -> Recording:
    """Read a table: text, Parquet, Xsens MVN's ``.mvnx``, or a folder of OpenPose's files.

    Rows without a time or a head position are dropped and counted; unknown parts of a row are NaN.

    Args:
        path: The table; its ending determines the format.
        options: The user's mapping of the columns, and the person.

    Returns:
        The recording, with the file's own time stamps.

    Raises:
        RecordingError: If the file is not a table, its columns have no known meaning, more than half of the rows are
            unusable, or a check fails; rows of text are numbered by lines, from 1.
        SettingsError: If an option is invalid, or there is no such person.
        MissingOptionalDependencyError: If the format needs a package that is not installed.
    """
    table = _raw(path)
    mapping, about = _mapping_of(table, options)
    given = mapping.texts()
    if missing := [key for key in ("t", "head") if key not in given]:
        raise RecordingError(path, "mapping", f"columns of {' and '.join(missing)} are missing", "at least t and head")
    notes, person, identity = [*table.notes, *about], options.person, ""
    if PERSON in given["head"]:
        names = people_in_header(table, given["head"])
        if not names:
            raise table.missing(f"columns for {given['head']}")
        identity, more = choose_from_header(table, names, person)
        notes += more
    elif person is not None and mapping.person is None:
        raise SettingsError(f"--reading.person {person}: {path} has no column of person ids; add person=COLUMN")
    table = replace(table, person=identity)
    times_s, track = read_parts(table, mapping)
    known, selected = np.isfinite(times_s) & track.valid, np.ones(times_s.size, dtype=np.bool_)
    if mapping.person is not None:
        ids = np.array([_plain(text) for text in table.texts(table.one(mapping.person))])
        seen = Counter(dict.fromkeys(ids.tolist(), 0))
        seen.update(ids[known].tolist())
        identity, more = _choose_person(path, seen, person and _plain(person))
        selected, notes = ids == identity, [*notes, *more]
    count, lost = int(selected.sum()), selected & ~known
    if lost.any():
        first = table.place(int(np.argmax(lost)))
        note = f"{lost.sum()} of {count} rows have no time or no head position (first {first})"
        if count - lost.sum() < _LEAST_USABLE * count:
            raise RecordingError(path, "", note, f"at least {_LEAST_USABLE:.0%} of the rows, or other columns")
        notes.append(f"{note}: dropped")
    rows, frame = np.flatnonzero(known & selected), ros_frame(table, mapping)
    times_s, track = times_s[rows], track.rows(known & selected)
    at_sensor = mapping.origin == "sensor" and frame not in FIXED_FRAMES
    if frame is not None and mapping.head_axes is None and not track.positions_only:
        turn, note = person_axes(track.head_position_m, track.head_quat_wxyz, at_sensor, identity.startswith("face_"))
        track = replace(track, head_quat_wxyz=turn(track.head_quat_wxyz))
        notes += [note] if note else []
    for what, field in _OPTIONAL_PARTS.items():
        unknown = int((~np.isfinite(getattr(track, field)).all(axis=1)).sum())
        if 0 < unknown < rows.size:
            notes.append(f"{what} is unknown in {unknown} of {rows.size} rows")
    if mapping.origin == "hips" and rows.size:
        track = _lifted_from_hips(path, track)
        note = f"positions are relative to the hips, which are placed at {HIPS_HEIGHT_M} m"
        notes.append(f"{note}: the file does not contain the walk itself")
    kind = mapping.kind or "motion capture"
    found = recording_of(
        path, times_s, track, kind, at_sensor, lambda index: table.place(int(rows[index])), notes=notes
    )
    return found if person is None else replace(found, name="_".join([path.stem, *re.findall(r"\w+", identity)]))


def remember_columns(path: Path, options: ReadOptions) -> str:
    """Save the user's mapping of a table's columns, or a requested guess, beside the table.

    Args:
        path: The recording.
        options: Options of the readers.

    Returns:
        Message for the user; empty if there is nothing to save.

    Raises:
        RecordingError: If the table cannot be read.
    """
    is_table = is_openpose_folder(path) if path.is_dir() else path.is_file() and path.suffix.lower() in TABLES
    if not is_table or not (options.columns is not None or options.guess):
        return ""
    saved, (mapping, _) = saved_places(path)[0], _mapping_of(_raw(path), options)
    try:
        write_whole(saved, f"# Columns of {path.name}\n{as_toml(mapping.texts())}")
    except OSError as error:
        return f"columns not saved: {saved}: {error.strerror}; expected: a writable folder"
    return f"columns saved in {saved}"


@lru_cache(maxsize=1)
def shipped_mappings() -> dict[str, ShippedMapping]:
    """All shipped mappings, by name, in the order of trial."""
    found = {name: load_spec(ShippedMapping, FOLDER, name) for name in shipped_names(FOLDER)}
    # Most specific first, by number of columns: a skeleton before a rigid body.
    return dict(sorted(found.items(), key=lambda item: -len(item[1].texts())))


def _choose_person(source: Path, seen: Counter[str], wanted: str | None) -> tuple[str, list[str]]:
    """Select one person of a file.

    Args:
        source: The file, for messages.
        seen: Number of frames with each person, by id; at least one person.
        wanted: The user's choice, or None for the person in most frames (of several, the first).

    Returns:
        The id, and a note if there are others.

    Raises:
        SettingsError: If the wanted person is not in the file.
    """
    chosen = seen.most_common(1)[0][0] if wanted is None else wanted
    if chosen not in seen:
        raise SettingsError(f"--reading.person {wanted}: not in {source}; {suggest(chosen, seen)}")
    if len(seen) == 1:
        return chosen, []
    others = [f"{name} ({count})" for name, count in seen.most_common() if name != chosen]
    more = f" and {len(others) - _SHOWN_PEOPLE} more" if len(others) > _SHOWN_PEOPLE else ""
    about = f"person {chosen} of {len(seen)} ({seen[chosen]} frames{'' if wanted else ', the most'})"
    return chosen, [f"{about}; also in the file: {', '.join(others[:_SHOWN_PEOPLE])}{more}; choose by --reading.person"]


def _plain(text: str) -> str:
    """Normalised id: 3 for 3.0 and for 3.0e+00."""
    try:
        number = float(text)
        return str(int(number)) if number.is_integer() else text.strip()
    except (ValueError, OverflowError):
        return text.strip()


def _raw(path: Path) -> RawTable:
    return openpose_table(path) if path.is_dir() else wide(TABLES[path.suffix.lower()](path))


def _mapping_of(table: RawTable, options: ReadOptions) -> tuple[ColumnMapping, tuple[str, ...]]:
    """Mapping of a table, by the first of user, saved file, header, shipped mapping and guess; and notes."""
    given = ColumnMapping() if options.columns is None else parse_columns(options.columns)
    if options.mapping is None and given.t is not None and given.head is not None:
        return given, ()
    base, notes = _found(table, options)
    return given.over(base), notes


def _found(table: RawTable, options: ReadOptions) -> tuple[ColumnMapping, tuple[str, ...]]:
    saved = options.mapping or next((place for place in saved_places(table.path) if place.is_file()), None)
    if saved is not None:
        return read_mapping(saved), (f"columns as in {saved}",)
    if set(NEEDED) <= set(table.names):
        return own_mapping(table), ()
    for name, mapping in shipped_mappings().items():
        if table.layout in mapping.layout and _shape_fits(table, mapping) and (shipped := _present(table, mapping)):
            note = (shipped.note,) if shipped.note else ()
            return ColumnMapping.model_validate(shipped.texts()), (f"columns as in {name}: {shipped.source}", *note)
    proposal = "name them, such as --reading.columns 't=stamp:ms, head=[px,py,pz]:mm'"
    proposal, guessed = f"no columns match a time and one head: {proposal}", None
    with suppress(RecordingError):  # such as a cell that is not a number
        guessed = guess(table)
    if guessed is not None:
        proposed, remarks = guessed
        option = proposed.as_option()
        if options.guess:
            return proposed, (f'columns guessed: "{option}"', *remarks)
        remark = f" ({'; '.join(remarks)})" if remarks else ""
        proposal = f'a guess: --reading.columns "{option}"{remark}; paste and correct it, or accept it with --guess'
    missing = ", ".join(name for name in NEEDED if name not in table.names)
    problem = f"missing column(s) {missing}; found {shown(', '.join(table.names), 200)}"
    expected = f"the columns {', '.join(NEEDED)}, or a mapping of the columns; {proposal}"
    raise RecordingError(table.path, "header", problem, expected)


def _shape_fits(table: RawTable, mapping: ShippedMapping) -> bool:
    """Whether a table without a header has the mapping's number of columns and types of cells."""
    if mapping.columns is None:
        return True
    rows = table.first(_FEW_ROWS)
    cells = [rows.texts(name) for name in table.names]
    words = {number for number, column in enumerate(cells, 1) if not all(map(is_number, column))}
    if len(cells) != mapping.columns or words != set(mapping.words):
        return False
    return all(float(cell.replace(",", ".")).is_integer() for k in mapping.integers for cell in cells[k - 1])


def _present(table: RawTable, mapping: ShippedMapping) -> ShippedMapping | None:
    """The mapping without missing optional parts; None if a required part is missing."""
    given, rows = mapping.texts(), table.first(_FEW_ROWS)
    found: dict[str, str] = {}
    for key in ("head", *(given.keys() & _COLUMN_KEYS)):
        ways = ({"head": found.get("head", text), key: text} for text in given[key].split("|"))
        if way := next((way for way in ways if _columns_exist(rows, way)), None):
            found |= way
        elif key in {"head", "t", "person", *mapping.needs}:
            return None
    return mapping.model_copy(update=dict.fromkeys(_COLUMN_KEYS) | found)


def _columns_exist(table: RawTable, values: dict[str, str]) -> bool:
    """Whether the columns of a mapping are in the header; invalid cells raise an error when they are read."""
    mapping = ColumnMapping.model_validate({"t": _EVERY_ROW} | values)
    names = people_in_header(table, values["head"]) if PERSON in values["head"] else [""]
    try:
        # All people have the same columns.
        read_parts(replace(table, person=names[0] if names else ""), mapping)
        return bool(names) and (mapping.person is None or table.find(mapping.person) is not None)
    except RecordingError as error:
        return bool(names) and error.where != "header"


def _lifted_from_hips(path: Path, track: Track) -> Track:
    """Positions relative to the hips, lifted to the height of hips."""
    from_origin_m = float(np.nanmedian(np.linalg.norm(track.pelvis_position_m, axis=1)))
    if not from_origin_m < _HIPS_AT_ORIGIN_M:
        problem = f"the middle of the hips is {from_origin_m:.2f} from the origin (median)"
        expected = "world landmarks, in metres from the middle of the hips; coordinates of the image have no depth"
        raise RecordingError(path, "positions", problem, expected)
    lift_m = np.array([0.0, 0.0, HIPS_HEIGHT_M])
    head_m, pelvis_m = track.head_position_m + lift_m, track.pelvis_position_m + lift_m
    return replace(track, head_position_m=head_m, pelvis_position_m=pelvis_m)
