"""From a table and the meaning of its columns to a recording."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from gazempc.errors import RecordingError, SettingsError
from gazempc.recordings.readers.bag_people import FIXED_FRAMES
from gazempc.recordings.readers.checks import (
    MIN_FRAMES,
    check_finite,
    check_frame_count,
    check_frame_interval,
    check_times_increase,
)
from gazempc.recordings.readers.labels import labels_for
from gazempc.recordings.readers.position_checks import check_head_to_pelvis, check_head_travel, check_upright
from gazempc.recordings.readers.tables.body_poses import Parts, facing, read_parts
from gazempc.recordings.readers.tables.columns import Columns
from gazempc.recordings.readers.tables.frames import ros_frame
from gazempc.recordings.readers.tables.mapping import ColumnMapping
from gazempc.recordings.readers.tables.people import PERSON, choose_from_header, people_in_header, rows_of_person
from gazempc.recordings.readers.tables.raw_table import RawTable
from gazempc.recordings.readers.tables.track import lifted_from_hips, smooth_track
from gazempc.recordings.recording import Recording, Track
from gazempc.types import BoolArray

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
