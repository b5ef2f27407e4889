"""Recordings as tables: the meaning of their columns, and from a table to a recording.

The package's own columns, in any order, are ``t`` (seconds) and ``head_{x,y,z}`` (metres, z up, right-handed).
Optional are ``pelvis_{x,y,z}``, ``head_q{w,x,y,z}`` and ``pelvis_q{w,x,y,z}`` (unit quaternions; the identity faces
+x with +y to the left). Other columns are ignored. For other tables a mapping says what the columns mean: the user's,
one saved beside the file, one that ships, or a guess.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gazempc.errors import RecordingError, SettingsError, shown
from gazempc.recordings.readers.bag_frames import FIXED_FRAMES
from gazempc.recordings.readers.checks import (
    MIN_FRAMES,
    MIN_SEEN_FRAMES,
    check_finite,
    check_frame_count,
    check_frame_interval,
    check_head_to_pelvis,
    check_head_travel,
    check_times_increase,
    check_upright,
    smoothed,
)
from gazempc.recordings.readers.labels import labels_for
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.readers.tables.body_poses import Parts, facing, orientations, read_parts, ros_frame
from gazempc.recordings.readers.tables.guess import Guess, guess
from gazempc.recordings.readers.tables.mapping import (
    ColumnMapping,
    ShippedMapping,
    parse_columns,
    read_mapping,
    save_mapping,
    saved_places,
)
from gazempc.recordings.readers.tables.other_files import mvnx_table, openpose_table, parquet_table
from gazempc.recordings.readers.tables.people import (
    NEEDED,
    PERSON,
    choose_from_header,
    own_mapping,
    people_in_header,
    rows_of_person,
)
from gazempc.recordings.readers.tables.raw_table import RawTable, is_number, wide
from gazempc.recordings.readers.tables.text_table import read_text_table
from gazempc.recordings.readers.tables.values import Columns, in_metres, seconds
from gazempc.recordings.recording import Recording, Track
from gazempc.specfiles import load_spec, shipped_names
from gazempc.types import BoolArray, FloatArray

FOLDER = "recordings/readers/tables/mappings"
_FEW_ROWS = 20


@lru_cache(maxsize=1)
def shipped_mappings() -> dict[str, ShippedMapping]:
    """All mappings that ship, by name, in the order in which they are tried."""
    found = {name: load_spec(ShippedMapping, FOLDER, name) for name in shipped_names(FOLDER)}
    # Those that ask for more columns come first: a skeleton before a rigid body.
    return dict(sorted(found.items(), key=lambda item: -len(item[1].texts())))


def fitting_mapping(table: RawTable) -> tuple[str, ShippedMapping] | None:
    """The shipped mapping that a table fits, without the parts that the table has not.

    Args:
        table: The table.

    Returns:
        Its name and the mapping, or None.
    """
    for name, mapping in shipped_mappings().items():
        if table.layout in mapping.layout and _shape_fits(table, mapping) and (found := _present(table, mapping)):
            return name, found
    return None


def _shape_fits(table: RawTable, mapping: ShippedMapping) -> bool:
    """Whether a table without a header has as many columns, with numbers, whole numbers and words where they belong."""
    if mapping.columns is None:
        return True
    if len(table.names) != mapping.columns:
        return False
    for number, name in enumerate(table.names, 1):
        cells = table.texts(name)[:_FEW_ROWS]
        is_text = not all(is_number(cell) for cell in cells)
        if is_text != (number in mapping.words):
            return False
        if number in mapping.integers and any(float(cell.replace(",", ".")) % 1.0 for cell in cells):
            return False
    return True


def _present(table: RawTable, mapping: ShippedMapping) -> ShippedMapping | None:
    """The mapping without optional parts that are not in the table; None if a needed part is not."""
    given = mapping.texts()
    for head in given["head"].split("|"):
        names = people_in_header(table, head) if PERSON in head else [""]
        # Of several, each has the same columns.
        columns = Columns(table.first(_FEW_ROWS), (names or [""])[0])
        if names and _is_there(partial(in_metres, columns, head, "head")):
            break
    else:
        return None

    def first(key: str, read: Callable[[str], object]) -> str | None:
        return next((text for text in given[key].split("|") if _is_there(partial(read, text))), None)

    found: dict[str, str | None] = {"head": head}
    readers: dict[str, Callable[[str], object]] = {
        "t": partial(seconds, columns),
        "person": columns.one,
        "frame_id": columns.one,
        "pelvis": partial(in_metres, columns, what="pelvis"),
    }
    for part, way in product(("head", "pelvis"), ("q", "euler", "yaw", "forward", "left")):
        readers[f"{part}_{way}"] = partial(_orientations, columns, part, way)
    found |= {key: first(key, read) for key, read in readers.items() if key in given}
    needed = ("t", *(key for key in ("person", *mapping.needs) if key in given))
    return None if any(found[key] is None for key in needed) else mapping.model_copy(update=found)


def _orientations(columns: Columns, part: str, way: str, text: str) -> object:
    """Orientations by one value of a mapping; the axes do not matter for whether its columns are there."""
    return orientations(columns, ColumnMapping.model_validate({f"{part}_{way}": text}), part, "z-up")


def _is_there(read: Callable[[], object]) -> bool:
    """Whether columns are in the header; what is wrong with their cells is said when they are read."""
    try:
        read()
    except RecordingError as error:
        return error.where != "header"
    return True


# Where hips are that the file puts at the origin: the pelvis of a person of 1.75 m who stands.
HIPS_HEIGHT_M = 0.95
# How near to the origin they must be.
_HIPS_AT_ORIGIN_M = 0.1


def smooth_track(path: Path, times_s: FloatArray, track: Track) -> Track:
    """The track without the tracker's noise, where the truth is unknown.

    Args:
        path: File it is from, for messages.
        times_s: Shape (N,), seconds.
        track: What the tracker saw.

    Returns:
        The same with positions smoothed without lag.

    Raises:
        RecordingError: If there are too few frames, or the time stamps do not allow it.
    """
    check_frame_count(path, len(times_s), MIN_SEEN_FRAMES)
    # Seconds since 1970 would spoil the spline's equations.
    times_s = times_s - times_s[0]
    pelvis_m = track.pelvis_position_m
    has_pelvis = np.asarray(np.isfinite(pelvis_m).all(axis=1))
    enough = int(has_pelvis.sum()) >= MIN_SEEN_FRAMES
    return replace(
        track,
        head_position_m=smoothed(path, times_s, track.head_position_m, track.valid),
        pelvis_position_m=smoothed(path, times_s, pelvis_m, has_pelvis) if enough else pelvis_m,
    )


def lifted_from_hips(path: Path, track: Track) -> tuple[Track, str]:
    """Positions relative to the hips, lifted to where hips are.

    Args:
        path: File they are from, for messages.
        track: The track, z up, the hips at the origin.

    Returns:
        The lifted track, and what is to be said of it.

    Raises:
        RecordingError: If the hips are elsewhere than at the origin, as in coordinates of the image.
    """
    from_origin_m = float(np.nanmedian(np.linalg.norm(track.pelvis_position_m, axis=1)))
    if not from_origin_m < _HIPS_AT_ORIGIN_M:
        raise RecordingError(
            path,
            "positions",
            f"the middle of the hips is {from_origin_m:.2f} from the origin (median)",
            "world landmarks, in metres from the middle of the hips; coordinates of the image have no depth",
        )
    lift_m = np.array([0.0, 0.0, HIPS_HEIGHT_M])
    lifted = replace(
        track,
        head_position_m=track.head_position_m + lift_m,
        pelvis_position_m=track.pelvis_position_m + lift_m,
    )
    note = f"positions are relative to the hips, which are put at {HIPS_HEIGHT_M} m"
    return lifted, f"{note}: how the person walks is not in the file"


# With fewer rows usable, something else is wrong than a head out of sight.
_LEAST_USABLE = 0.5


def recording_of(table: RawTable, mapping: ColumnMapping, person: str | None, notes: tuple[str, ...] = ()) -> Recording:
    """Read a table by its mapping.

    Rows without a time or a head position are dropped, counted and said; a part that is not known in a row is NaN.

    Args:
        table: The table.
        mapping: What its columns mean; needs `t` and `head`.
        person: Whose rows or columns to read; None for the person who is seen longest.
        notes: What else is to be said of the recording.

    Returns:
        The recording, with the file's own time stamps.

    Raises:
        RecordingError: If columns are missing, cells are damaged, more than half of the rows cannot be used, or the
            checks that all readers share refuse it.
        SettingsError: If the mapping has an invalid value, or there is no such person.
    """
    path = table.path
    for key in ("t", "head"):
        if getattr(mapping, key) is None:
            raise RecordingError(path, "mapping", f"it does not say which columns are {key}", "at least t and head")
    said = [*table.notes, *notes]
    who = ""
    assert mapping.head is not None
    if PERSON in mapping.head:
        names = people_in_header(table, mapping.head)
        if not names:
            raise Columns(table).missing(f"columns for {mapping.head}")
        who, note = choose_from_header(table, names, person)
        said += note
    elif person is not None and mapping.person is None:
        raise SettingsError(f"--reading.person {person}: {path} does not tell people apart; say person=COLUMN")
    columns = Columns(table, who)
    parts = read_parts(columns, mapping)
    known = np.isfinite(parts.times_s) & np.isfinite(parts.head_m).all(axis=1)
    mine = np.ones(len(known), dtype=np.bool_)
    if mapping.person is not None:
        mine, who, note = rows_of_person(table, columns.one(mapping.person), known, person)
        said += note
    said += _dropped(table, known, mine)
    rows = np.flatnonzero(known & mine)
    parts = parts.rows(known & mine)
    frame = ros_frame(columns, mapping)
    at_sensor = mapping.origin == "sensor" and frame not in FIXED_FRAMES
    if frame is not None and mapping.head_axes is None:
        parts, note = facing(parts, at_sensor, who.startswith("face_"))
        said += note
    said += _partly_unknown(parts)
    _check(table, parts, rows)
    has_pelvis = bool(np.isfinite(parts.pelvis_m).any())
    track = Track(
        head_position_m=parts.head_m,
        head_quat_wxyz=parts.head_quat,
        pelvis_position_m=parts.pelvis_m,
        pelvis_quat_wxyz=parts.pelvis_quat,
        valid=np.ones(len(rows), dtype=np.bool_),
    )
    if mapping.origin == "hips":
        track, lifted = lifted_from_hips(path, track)
        said.append(lifted)
    tracked = mapping.kind == "tracked"
    return Recording(
        name=path.stem if person is None else "_".join([path.stem, *re.findall(r"\w+", who)]),
        source=str(path),
        kind="tracked" if tracked else "motion capture",
        times_s=parts.times_s,
        truth=smooth_track(path, parts.times_s, track) if tracked else track,
        measured=track if tracked else None,
        has_robot=at_sensor,
        labels=labels_for(path, parts.times_s, parts.pelvis_m if has_pelvis else parts.head_m),
        notes=tuple(dict.fromkeys(said)),
    )


def _dropped(table: RawTable, known: BoolArray, mine: BoolArray) -> list[str]:
    """What is said of rows that are left out.

    Raises:
        RecordingError: If they are too many.
    """
    count, lost = int(mine.sum()), mine & ~known
    dropped = int(lost.sum())
    if not dropped:
        return []
    first = table.place(int(np.argmax(lost)))
    said = f"{dropped} of {count} rows have no time or no head position (first {first})"
    usable = count - dropped
    if usable < _LEAST_USABLE * count:
        raise RecordingError(table.path, "", said, f"at least {_LEAST_USABLE:.0%} of the rows, or other columns")
    return [f"{said}: dropped"]


def _partly_unknown(parts: Parts) -> list[str]:
    """What is said of parts that are known in some rows only."""
    said = []
    for name, values in (("head", parts.head_quat), ("pelvis", parts.pelvis_m), ("pelvis", parts.pelvis_quat)):
        unknown = int((~np.isfinite(values).all(axis=1)).sum())
        if 0 < unknown < len(values):
            what = "position" if values.shape[1] == 3 else "orientation"
            said.append(f"the {name}'s {what} is not known in {unknown} of {len(values)} rows")
    return said


def _check(table: RawTable, parts: Parts, rows: NDArray[np.intp]) -> None:
    """The checks that all readers share."""
    path = table.path

    def place(index: int) -> str:
        return table.place(int(rows[index]))

    check_frame_count(path, len(rows), MIN_FRAMES)
    check_finite(path, parts.head_m, ["head_x", "head_y", "head_z"], place)
    check_times_increase(path, parts.times_s, place)
    check_frame_interval(path, parts.times_s)
    both = np.isfinite(parts.pelvis_m).all(axis=1)
    if both.any():
        check_finite(path, parts.pelvis_m[both], ["pelvis_x", "pelvis_y", "pelvis_z"], place)
        check_head_to_pelvis(path, parts.head_m[both], parts.pelvis_m[both])
        check_upright(path, parts.head_m[both], parts.pelvis_m[both], "metres with z up and the person upright")
    else:
        check_head_travel(path, parts.times_s, parts.head_m)


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
