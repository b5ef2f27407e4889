"""Guess of the meaning of columns, by their English names, then by their values.

Only time, head, pelvis, yaw and people are guessed; orientations otherwise are for the user's mapping.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from gazempc.recordings.readers.tables.mapping import ColumnMapping
from gazempc.recordings.readers.tables.people import person_column
from gazempc.recordings.readers.tables.raw_table import RawTable, is_number, split_unit
from gazempc.recordings.readers.tables.values import LENGTHS_M, TIMES_S, seconds_since_1970
from gazempc.types import FloatArray

_HEIGHT_M = 1.6
_RATE_HZ = 30
_TIME = re.compile(r"(.*[._ ])?(t|s|secs?|seconds|time|time_?stamps?|stamp|date|date_?time)", re.I)
_FRAME = re.compile(r"frame(_?(id|no|number|index))?|index", re.I)
_GROUP = re.compile(r"(?P<base>.*?)[._ :\[-]*(?P<axis>[xyz])\]?", re.I)
_HEAD = re.compile(r"head|face|nose|eye", re.I)
_PELVIS = re.compile(r"(pelvis|hips?|waist|root)[._ ]*$", re.I)
_NO_POSITION = re.compile(
    r"vel|acc|rot|orient|quat|ang|euler|gyro|std|cov|var|gaze|dir|hand|foot|knee|wrist|elbow|ankle|shoulder|robot|"
    r"camera|target|pixel|bbox|image|scale|size|(^|[._ ])q$",
    re.I,
)
_TYPICAL_INTERVAL_S, _INTERVALS_S = 1.0 / 30.0, (1.0 / 1000.0, 1.0)
# Seconds since 1970, from 2001 to 2100.
_CLOCK_S = (1e9, 4.1e9)
_TYPICAL_RANGE_M, _TYPICAL_SPEED_M_S, _HEAD_TO_PELVIS_M = 3.0, 1.0, 0.6
# Heads of people who stand or sit, above the floor.
_HEIGHTS_M = (1.0, 2.2)


@dataclass(frozen=True)
class Guess:
    """A mapping that may be right.

    Attributes:
        mapping: It.
        remarks: Its parts that the file does not determine.
    """

    mapping: ColumnMapping
    remarks: tuple[str, ...] = ()


def guess(table: RawTable) -> Guess | None:
    """Guess a mapping.

    Args:
        table: The table.

    Returns:
        The guess; None where no columns could be times, or none, or several alike, the head.
    """
    groups, person = _groups(table), person_column(table)
    ids = np.array(table.texts(person) if person else [""] * len(table.places))
    one = ids == ids[0]  # rows of one person
    pelvis = next((base for base in groups if _PELVIS.search(base) and "z" in groups[base]), None)
    heads = [base for base in groups if not (_NO_POSITION.search(base) or base == pelvis)]
    heads = [base for base in heads if _HEAD.search(base)] or heads
    timing = _time(table, one)
    if len(heads) != 1 or timing is None:
        return None
    text, times_s, remarks = timing
    columns = groups[heads[0]]
    head = _values(table, columns)[one]
    from_pelvis = None if pelvis is None else head - _values(table, groups[pelvis])[one]
    unit = table.unit(columns["x"])
    if unit not in LENGTHS_M:
        unit = _length(times_s[one], head, from_pelvis)
    found = {"t": text, "head": _position(table, columns, unit)}
    if pelvis is not None:
        found["pelvis"] = _position(table, groups[pelvis], unit)
    if "z" not in columns:
        remarks.append(f"the file has no height: {_HEIGHT_M} m stands in")
    elif (axes := _axes(head * LENGTHS_M[unit], from_pelvis)) != "z-up":
        found["axes"] = axes
        if axes == "y-up":
            remarks.append("that y-up axes are right-handed is a guess: else say axes=unity")
    yaws = [name for name in table.names if re.fullmatch(r"(head|face)?[._ ]?yaw", split_unit(name)[0], re.I)]
    if len(yaws) == 1 and "axes" not in found:
        largest = float(np.nanmax(np.abs(table.numbers(yaws[0]))))
        found["head_yaw"] = f"{yaws[0]}:{table.unit(yaws[0]) or ('deg' if largest > 2.0 * np.pi else 'rad')}"
    if table.layout == "no header":
        remarks.append("without a header the order t, x, y, z is a guess")
    if person:
        found["person"] = person
    return Guess(ColumnMapping.model_validate(found), tuple(remarks))


def _groups(table: RawTable) -> dict[str, dict[str, str]]:
    """Columns of numbers that differ in an axis only: for each group's name the column of each axis."""

    def numeric(name: str) -> bool:
        return all(is_number(cell) or not cell.strip() for cell in table.texts(name)[:5])

    if table.layout == "no header":
        first = table.names[:4]
        return {"": dict(zip("xyz", first[1:], strict=True))} if len(first) == 4 and all(map(numeric, first)) else {}
    found: dict[str, dict[str, str]] = {}
    for name in table.names:
        match = _GROUP.fullmatch(split_unit(name)[0])
        if match and numeric(name):
            found.setdefault(match["base"], {}).setdefault(match["axis"].lower(), name)
    return {base: axes for base, axes in found.items() if {"x", "y"} <= axes.keys()}


def _values(table: RawTable, columns: dict[str, str]) -> FloatArray:
    """Positions in the file's unit, shape (N, 3); without a height one stands in."""
    height = np.full(len(table.places), _HEIGHT_M)
    return np.column_stack([table.numbers(columns[axis]) if axis in columns else height for axis in "xyz"])


def _position(table: RawTable, columns: dict[str, str], unit: str) -> str:
    """The value of a mapping for the columns of a position."""
    parts = [_quoted(table, columns[axis]) if axis in columns else f"={_HEIGHT_M:g}" for axis in "xyz"]
    return f"[{','.join(parts)}]" + (f":{unit}" if unit != "m" else "")


def _quoted(table: RawTable, name: str) -> str:
    """A column's name, or its number where the name holds separators."""
    return f"#{table.names.index(name) + 1}" if re.search(r"[,\"'$`]|[\[(][^\])]*$", name) else name


def _time(table: RawTable, one: FloatArray) -> tuple[str, FloatArray, list[str]] | None:
    """The value of a mapping for the times, the times in seconds, and remarks."""
    for name in table.names:
        stem = split_unit(name)[0]
        cells = table.texts(name)
        if _TIME.fullmatch(stem) or (table.layout, name) == ("no header", "1"):
            if is_number(cells[0]):
                values = table.numbers(name)
                unit = table.unit(name) or _time_unit(values[one])
                return f"{_quoted(table, name)}:{unit}", values * TIMES_S.get(unit, 1.0), []
            if seconds_since_1970(cells[0]) is not None:
                times_s = np.array([seconds_since_1970(cell) or np.nan for cell in cells])
                return f"{_quoted(table, name)}:date", times_s, []
    for name in table.names:
        if _FRAME.fullmatch(split_unit(name)[0]) and is_number(table.texts(name)[0]):
            rate_hz = table.rate_hz or _RATE_HZ
            remarks = [] if table.rate_hz else [f"{_RATE_HZ} frames a second is a guess"]
            return f"{_quoted(table, name)}:{rate_hz:g}hz", table.numbers(name) / rate_hz, remarks
    return None


def _time_unit(values: FloatArray) -> str:
    """Unit of one person's time stamps: by the clock they show, else by the interval between frames."""
    known = values[np.isfinite(values)]
    units = ("s", "ms", "us", "ns")
    for unit in units:
        if known.size and _CLOCK_S[0] < known[0] * TIMES_S[unit] < _CLOCK_S[1]:
            return unit
    steps = np.diff(known)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else _TYPICAL_INTERVAL_S
    fitting = [unit for unit in units if _INTERVALS_S[0] <= step * TIMES_S[unit] <= _INTERVALS_S[1]]
    return min(fitting or ["s"], key=lambda unit: abs(np.log(step * TIMES_S[unit] / _TYPICAL_INTERVAL_S)))


def _length(times_s: FloatArray, head: FloatArray, from_pelvis: FloatArray | None) -> str:
    """Unit of positions: by the distance from pelvis to head, else by distance and speed; m, mm or cm."""
    if from_pelvis is not None:
        size = float(np.nanmedian(np.linalg.norm(from_pelvis, axis=1)))
        return min(("m", "mm", "cm"), key=lambda unit: abs(np.log(size * LENGTHS_M[unit] / _HEAD_TO_PELVIS_M + 1e-9)))
    away = float(np.nanmedian(np.linalg.norm(head, axis=1)))
    speed = float(np.linalg.norm(np.nanmax(head, axis=0) - np.nanmin(head, axis=0))) / max(float(np.ptp(times_s)), 1e-3)

    def strangeness(unit: str) -> float:
        size_m = LENGTHS_M[unit]
        pace = max(np.log(speed * size_m / _TYPICAL_SPEED_M_S + 1e-9), 0.0)  # who stands has no pace
        return float(abs(np.log(away * size_m / _TYPICAL_RANGE_M + 1e-9)) + 0.5 * pace)

    return min(("m", "mm", "cm"), key=strangeness)


def _axes(head_m: FloatArray, from_pelvis: FloatArray | None) -> str:
    """Axes of positions: by the head above the pelvis, else by heights and by the longest distance."""
    if from_pelvis is not None:
        x, y, z = np.nanmedian(from_pelvis, axis=0)
        return "z-up" if abs(z) >= max(abs(x), abs(y)) else "y-up" if y > 0 else "optical"
    middle = np.nanmedian(head_m, axis=0)
    spread = np.nanmax(head_m, axis=0) - np.nanmin(head_m, axis=0)
    tall = [k for k in (2, 1) if _HEIGHTS_M[0] < middle[k] < _HEIGHTS_M[1] and spread[k] < _HEIGHTS_M[0]]
    if tall:
        return "z-up" if min(tall, key=lambda k: (spread[k] > 0.3, k != 2)) == 2 else "y-up"
    # Seen from a sensor: the longest distance is forward, x or the z of a camera.
    return "optical" if middle[2] > max(abs(middle[0]), abs(middle[1])) else "z-up"
