"""Guess of the meaning of columns, by their English names, then by their values."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from gazempc.errors import shown
from gazempc.recordings.readers.tables.mapping import ColumnMapping
from gazempc.recordings.readers.tables.people import person_column
from gazempc.recordings.readers.tables.raw_table import RawTable, is_number, split_unit
from gazempc.recordings.readers.tables.values import ANGLES_RAD, LENGTHS_M, TIMES_S, seconds_since_1970
from gazempc.types import FloatArray

_HEIGHT_M = 1.6
_RATE_HZ = 30
_TIME = re.compile(r"(.*[._ ])?(t|s|secs?|seconds|time|time_?stamps?|stamp|date|date_?time)", re.I)
_FRAME = re.compile(r"frame(_?(id|no|number|index))?|index", re.I)
# Seconds and their fraction, such as ROS's sec and nanosec.
_SECONDS = re.compile(r"(?P<base>.*?)(?P<fraction>n|nano|u|micro|)(sec(ond)?s?|(?<=[nu])s)", re.I)
_GROUP = re.compile(r"(?P<base>.*?)[._ :/,\[-]*(?P<axis>[wxyz]|roll|pitch|yaw)\]?", re.I)
_HEAD = re.compile(r"head|face|nose|eye", re.I)
_PELVIS = re.compile(r"(pelvis|hips?|waist|root)[._ ]*$", re.I)
# Positions end in these words, which orientations of the same part do not have.
_PLACE = re.compile(r"[._ /]?(pos|position|translation|location|point)$|(^|[._ /])[pt]$", re.I)
_ORIENTATION = re.compile(
    r"rot|orient|quat|angle|(^|[._ /])ang|euler|roll|pitch|yaw|(^|[._ /])[qr][._ ]?[wxyz0-4]?$", re.I
)
_OTHER = re.compile(
    r"vel|acc|gyro|std|cov|var|gaze|dir|hand|foot|knee|wrist|elbow|ankle|shoulder|robot|camera|target|pixel|bbox|image|"
    r"scale|size",
    re.I,
)
# Orientations of these names are the head's where it has none of its own name.
_OF_NO_PART = re.compile(
    r"([._ /]*(head|face|person|user|pose|rot(ation)?|orient(ation)?|quat(ernion)?|euler|angles?|rpy|[qr]))*[._ /]*",
    re.I,
)
_UNIT_NORM_TOLERANCE = 0.01
_TYPICAL_INTERVAL_S, _INTERVALS_S = 1.0 / 30.0, (1.0 / 1000.0, 1.0)
# Seconds since 1970, from 2001 to 2100.
_CLOCK_S = (1e9, 4.1e9)
_TYPICAL_RANGE_M, _TYPICAL_SPEED_M_S, _HEAD_TO_PELVIS_M = 3.0, 1.0, 0.6
_OWN_AXES = "that a body's own axes are those of the frame is a guess: else give head_axes or pelvis_axes"
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
    pelvis = next((base for base in groups if _PELVIS.search(_PLACE.sub("", base)) and "z" in groups[base]), None)
    heads = [
        base
        for base, axes in groups.items()
        if "x" in axes and "w" not in axes and base != pelvis and not (_ORIENTATION.search(base) or _OTHER.search(base))
    ]
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
    oriented, more = _orientations(table, groups, heads[0], pelvis, level="axes" not in found)
    found, remarks = found | oriented, [*remarks, *more]
    if table.layout == "no header":
        remarks.append("without a header the order t, x, y, z is a guess")
    if person:
        found["person"] = person
    return Guess(ColumnMapping.model_validate(found), tuple(remarks))


def _groups(table: RawTable) -> dict[str, dict[str, str]]:
    """Columns of numbers that differ in an axis or angle only: for each group's name the column of each."""

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
    return {base: axes for base, axes in found.items() if {"x", "y"} <= axes.keys() or "yaw" in axes}


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


def _orientations(
    table: RawTable, groups: dict[str, dict[str, str]], head: str, pelvis: str | None, level: bool
) -> tuple[dict[str, str], list[str]]:
    """Items of a mapping for the orientations of head and pelvis, and remarks.

    Args:
        table: The table.
        groups: Its groups of columns.
        head: Group of the head's position.
        pelvis: Group of the pelvis' position, or None.
        level: Whether z is up, as roll, pitch and yaw need it.
    """
    found: dict[str, str] = {}
    remarks: list[str] = []
    stems = {"head": _PLACE.sub("", head).casefold()}
    if pelvis is not None:
        stems["pelvis"] = _PLACE.sub("", pelvis).casefold()
    likely = {base.casefold(): base for base in groups if not _OTHER.search(base)}
    for part, stem in stems.items():
        own = [base for name, base in likely.items() if stem and name.startswith(stem)]
        bare = [base for base in likely.values() if part == "head" and _OF_NO_PART.fullmatch(base)]
        items = [item for base in own if (item := _orientation(table, groups[base], base, level))]
        items = items or [item for base in bare if (item := _orientation(table, groups[base], base, level))]
        # A quaternion goes before angles of the same part.
        items = [item for item in items if item[0] == "q"] or items
        if len(items) == 1:
            way, value, remark = items[0]
            found[f"{part}_{way}"] = value
            remarks += [remark] if remark else []
    if not found.keys() & {"head_q", "head_euler"}:
        used = set(re.split(r"[\[\],:]+", ",".join(found.values())))
        left = [name for name in table.names if _ORIENTATION.search(split_unit(name)[0]) and not _OTHER.search(name)]
        left = [name for name in left if _quoted(table, name) not in used]
        if left:
            remarks.append(f"orientations left out: {shown(', '.join(left), 80)}; head_q or head_euler takes them")
    return found, list(dict.fromkeys(remarks))


def _orientation(table: RawTable, columns: dict[str, str], base: str, level: bool) -> tuple[str, str, str] | None:
    """Orientation by one group of columns: kind (q, euler or yaw), value of a mapping and remark; None without one."""

    def listed(axes: Sequence[str]) -> str:
        return f"[{','.join(_quoted(table, columns[axis]) for axis in axes)}]"

    def unit(axes: Sequence[str]) -> str:
        largest = np.nanmax(np.abs([table.numbers(columns[axis]) for axis in axes]), initial=0.0)
        stated = table.unit(columns[axes[0]])
        return stated if stated in ANGLES_RAD else "deg" if largest > 2.0 * np.pi else "rad"

    if columns.keys() >= set("wxyz"):
        norms = np.linalg.norm([table.numbers(columns[axis]) for axis in "wxyz"], axis=0)
        seen = norms[norms > 0.0]  # programs write zeros for an unseen head
        if seen.size and abs(float(np.median(seen)) - 1.0) < _UNIT_NORM_TOLERANCE:
            return "q", f"{listed('wxyz')}:wxyz", _OWN_AXES
    angles = ("roll", "pitch", "yaw")
    if level and columns.keys() >= set(angles):
        return "euler", f"{listed(angles)}:{unit(angles)}", ""
    if level and "yaw" in columns:
        return "yaw", f"{_quoted(table, columns['yaw'])}:{unit(['yaw'])}", ""
    if "w" not in columns and columns.keys() >= set("xyz") and _ORIENTATION.search(base):
        return "euler", f"{listed('xyz')}:xyz:{unit('xyz')}", f"the order xyz of the angles {base!r} is a guess"
    return None


def _time(table: RawTable, one: FloatArray) -> tuple[str, FloatArray, list[str]] | None:
    """The value of a mapping for the times, the times in seconds, and remarks."""
    matches = {name: match for name in table.names if (match := _SECONDS.fullmatch(name))}
    for (name, whole), (other, part) in permutations(matches.items(), 2):
        if whole["base"] == part["base"] and not whole["fraction"] and part["fraction"]:
            unit = f"{part['fraction'][0].lower()}s"
            fraction_s = table.numbers(other) * TIMES_S[unit]
            # Else it is the same time in another unit.
            if not (np.abs(fraction_s) >= 1.0).any():
                text = f"{_quoted(table, name)}:s+{_quoted(table, other)}:{unit}"
                return text, table.numbers(name) + fraction_s, []
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
