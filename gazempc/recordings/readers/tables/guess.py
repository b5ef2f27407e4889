"""Guess of the meaning of columns, by their names, then by their values."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from gazempc.errors import RecordingError
from gazempc.recordings.readers.tables.mapping import ColumnMapping
from gazempc.recordings.readers.tables.people import person_column
from gazempc.recordings.readers.tables.raw_table import RawTable, is_number, split_unit
from gazempc.recordings.readers.tables.values import LENGTHS_M, TIMES_S, seconds_since_1970
from gazempc.types import BoolArray, FloatArray

_TYPICAL_INTERVAL_S = 1.0 / 30.0
_INTERVALS_S = (1.0 / 1000.0, 1.0)
# Seconds since 1970, from 2001 to 2100.
_CLOCK_S = (1e9, 4.1e9)
_TYPICAL_RANGE_M, _TYPICAL_SPEED_M_S, _HEAD_TO_PELVIS_M = 3.0, 1.0, 0.6
_STANDING_M_S = 0.05
# Heads of people who stand or sit, above the floor.
_HEIGHTS_M = (1.0, 2.2)


def likely_time_unit(values: FloatArray) -> str:
    """Unit of time stamps: by the clock they show, else by the interval between frames.

    Args:
        values: Shape (N,), of one person.

    Returns:
        A unit of `gazempc.recordings.readers.tables.values.TIMES_S`.
    """
    known = values[np.isfinite(values)]
    for unit in ("s", "ms", "us", "ns"):
        if known.size and _CLOCK_S[0] < known[0] * TIMES_S[unit] < _CLOCK_S[1]:
            return unit
    steps = np.diff(known)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else _TYPICAL_INTERVAL_S
    fitting = [u for u in ("s", "ms", "us", "ns") if _INTERVALS_S[0] <= step * TIMES_S[u] <= _INTERVALS_S[1]]
    return min(fitting or ["s"], key=lambda u: abs(np.log(step * TIMES_S[u] / _TYPICAL_INTERVAL_S)))


def likely_length(times_s: FloatArray, head: FloatArray, pelvis: FloatArray | None) -> str:
    """Unit of positions: by the distance from pelvis to head, else by distance and speed.

    Args:
        times_s: Shape (N,), seconds.
        head: Shape (N, 3), in the file's unit.
        pelvis: Likewise, or None.

    Returns:
        ``m``, ``mm`` or ``cm``.
    """
    known = np.isfinite(head).all(axis=1) & np.isfinite(times_s)
    head, times_s = head[known], times_s[known]
    if len(head) < 2:
        return "m"
    if pelvis is not None:
        apart = float(np.nanmedian(np.linalg.norm(head - pelvis[known], axis=1)))
        return min(("m", "mm", "cm"), key=lambda u: abs(np.log(max(apart, 1e-9) * LENGTHS_M[u] / _HEAD_TO_PELVIS_M)))
    away = float(np.median(np.linalg.norm(head, axis=1)))
    duration_s = max(float(times_s[-1] - times_s[0]), 1e-3)
    speed = float(np.linalg.norm(np.ptp(head, axis=0))) / duration_s

    def strangeness(unit: str) -> float:
        size_m = LENGTHS_M[unit]
        slow = speed * size_m < _STANDING_M_S and unit == "m"
        pace = 0.0 if slow else abs(np.log(max(speed * size_m, _STANDING_M_S) / _TYPICAL_SPEED_M_S))
        return float(abs(np.log(max(away, 1e-9) * size_m / _TYPICAL_RANGE_M)) + 0.5 * pace)

    return min(("m", "mm", "cm"), key=strangeness)


def likely_axes(head_m: FloatArray, pelvis_m: FloatArray | None) -> str:
    """Axes of positions: by where the head is above the pelvis, else by heights and by what is far away.

    Args:
        head_m: Shape (N, 3), metres.
        pelvis_m: Likewise, or None.

    Returns:
        A name of `gazempc.recordings.readers.tables.body_poses.AXES`.
    """
    if pelvis_m is not None:
        x, y, z = np.nanmedian(head_m - pelvis_m, axis=0)
        if abs(z) >= max(abs(x), abs(y)):
            return "z-up"
        return "y-up" if y > 0 else "optical"
    middle = np.nanmedian(head_m, axis=0)
    spread = np.nanmax(head_m, axis=0) - np.nanmin(head_m, axis=0)
    tall = [k for k in (2, 1) if _HEIGHTS_M[0] < middle[k] < _HEIGHTS_M[1] and spread[k] < _HEIGHTS_M[0]]
    if tall:
        return "z-up" if min(tall, key=lambda k: (spread[k] > 0.3, k != 2)) == 2 else "y-up"
    # Seen from a sensor: what is far is forward, x or the z of a camera.
    return "optical" if middle[2] > max(abs(middle[0]), abs(middle[1])) else "z-up"


_HEIGHT_M = 1.6
_RATE_HZ = 30
_TIME = re.compile(r"(.*[._ /%])?%?(t|s|secs?|seconds|time|time_?stamps?|stamp|ts|date|date_?time|clock)", re.I)
_SECONDS = re.compile(r"(?P<base>.*?)(secs?|seconds|stamp_sec)", re.I)
_NANOSECONDS = re.compile(r"(?P<base>.*?)(nanosecs?|nsecs?|nanoseconds|stamp_nanosec)", re.I)
_FRAME = re.compile(r"(.*[._ /])?(frame|frame_?(id|no|nr|num|number|index)|index|sample)", re.I)
_ENDS_IN_AXIS = re.compile(r"(?P<base>.*?)[._ ,/:\[-]*(?P<axis>[xyzw])\]?", re.I)
_BEGINS_WITH_AXIS = re.compile(r"(?P<axis>[xyzw])[._ ](?P<base>.+)", re.I)
_GOOD = {"head": 10, "face": 8, "skull": 8, "nose": 7, "eyes": 6, "eye": 5}
_GOOD |= {"person": 3, "neck": 3}
_POSITION = {"position": 2, "pos": 2, "translation": 2, "pose": 2, "point": 2, "location": 2, "p": 1, "t": 1}
_BAD = re.compile(
    r"vel|acc|rot|orient|quat|angle|angular|euler|gyro|mag|twist|std|cov|var|gaze|dir|hand|foot|knee|hip|pelvis|wrist|"
    r"elbow|ankle|shoulder|toe|robot|camera|target|pixel|bbox|image|scale|size",
    re.I,
)
_PELVIS = re.compile(r"(pelvis|hips?|waist|mid_?hip|spine_?base|root)$", re.I)


@dataclass(frozen=True)
class Guess:
    """A mapping that may be right.

    Attributes:
        mapping: It.
        remarks: What in it is not known from the file.
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
    groups = _groups(table) if table.layout != "no header" else _first_three(table)
    head = _head(groups)
    person = person_column(table)
    timing = _time(table, person)
    if head is None or timing is None:
        return None
    time_text, times_s, remarks = timing
    columns = groups[head]
    heights = "z" in columns
    of_one = _rows_of_first(table, person)
    head_values = _values(table, columns)[of_one]
    pelvis = next((b for b in groups if _PELVIS.search(b.rstrip("._ ")) and "z" in groups[b]), None)
    pelvis_values = None if pelvis is None else _values(table, groups[pelvis])[of_one]
    unit = table.unit(columns["x"])
    if unit not in LENGTHS_M:
        unit = likely_length(times_s[of_one], head_values, pelvis_values)
    size_m = LENGTHS_M[unit]
    axes = "z-up"
    if heights:
        axes = likely_axes(head_values * size_m, None if pelvis_values is None else pelvis_values * size_m)
    else:
        remarks.append(f"the file has no height: {_HEIGHT_M} m stands in")
    if axes == "y-up":
        remarks.append("that y-up axes are right-handed is a guess: else say axes=unity")
    if table.layout == "no header":
        remarks.append("without a header the order t, x, y, z is a guess")
    found = {"t": time_text, "head": _text(table, columns, unit)}
    if pelvis is not None:
        found["pelvis"] = _text(table, groups[pelvis], unit)
    if quaternion := _quaternion(table, groups, head):
        found["head_q"] = quaternion
        remarks.append("that the head's own axes are as the frame's is a guess: else say head_axes")
    elif axes == "z-up" and (angles := _angles(table)):
        found |= angles
    if axes != "z-up":
        found["axes"] = axes
    if person:
        found["person"] = person
    return Guess(ColumnMapping.model_validate(found), tuple(remarks))


def _groups(table: RawTable) -> dict[str, dict[str, str]]:
    """Columns that differ in an axis only: for each group's name the column of each axis."""
    found: dict[str, dict[str, str]] = {}
    for name in table.names:
        stem = split_unit(name)[0]
        match = _ENDS_IN_AXIS.fullmatch(stem) or _BEGINS_WITH_AXIS.fullmatch(stem)
        if match and all(is_number(c) or not c.strip() for c in map(str, table.texts(name)[:5])):
            found.setdefault(match["base"], {}).setdefault(match["axis"].lower(), name)
    return {base: axes for base, axes in found.items() if {"x", "y"} <= axes.keys()}


def _first_three(table: RawTable) -> dict[str, dict[str, str]]:
    """The columns after the first one, of a table of numbers without a header."""
    if len(table.names) < 4 or not all(is_number(cell) for name in table.names[:4] for cell in table.texts(name)[:5]):
        return {}
    return {"": dict(zip("xyz", table.names[1:4], strict=True))}


def _head(groups: dict[str, dict[str, str]]) -> str | None:
    """The group that is most likely the head's position; None if none is, or several are alike."""
    scores: dict[str, float] = {}
    for base, axes in groups.items():
        words = re.findall(r"[a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", base).lower())
        if "w" in axes or _BAD.search(base) or (words and words[-1] in ("q", "v", "a", "w")):
            continue
        scores[base] = 1.0 + max((_GOOD.get(w, 0) for w in words), default=0) + sum(_POSITION.get(w, 0) for w in words)
        scores[base] += 0.5 * ("z" in axes)
    if not scores:
        return None
    best = max(scores.values())
    likely = [base for base, score in scores.items() if score == best]
    return likely[0] if len(likely) == 1 else None


def _values(table: RawTable, columns: dict[str, str]) -> FloatArray:
    """Positions in the file's unit, shape (N, 3); without a height one stands in."""
    height = np.full(len(table.places), _HEIGHT_M)
    return np.column_stack([table.numbers(columns[axis]) if axis in columns else height for axis in "xyz"])


def _text(table: RawTable, columns: dict[str, str], unit: str) -> str:
    """The value of a mapping for the columns of a position."""
    parts = [_quoted(table, columns[axis]) if axis in columns else f"={_HEIGHT_M:g}" for axis in "xyz"]
    return f"[{','.join(parts)}]" + (f":{unit}" if unit != "m" else "")


def _quoted(table: RawTable, name: str) -> str:
    """A column's name, or its number where the name holds what separates."""
    return f"#{table.names.index(name) + 1}" if re.search(r"[,\"'$`]|[\[(][^\])]*$", name) else name


def _quaternion(table: RawTable, groups: dict[str, dict[str, str]], head: str) -> str | None:
    """Four columns of unit norm, the head's if others have some, too."""
    whole = {b: c for b, c in groups.items() if len(c) == 4}
    begin = head[: re.search(r"[._ /]?(pos\w*|translation|p|t)?$", head, re.I).start()]  # type: ignore[union-attr]
    likely = [b for b in whole if begin and b.startswith(begin)] or (list(whole) if len(whole) == 1 else [])
    for base in likely:
        values = np.column_stack([table.numbers(whole[base][c]) for c in "wxyz"])
        norms = np.linalg.norm(values[np.isfinite(values).all(axis=1)], axis=1)
        if norms.size and abs(float(np.median(norms)) - 1.0) < 0.01:
            return f"[{','.join(_quoted(table, whole[base][c]) for c in 'wxyz')}]:wxyz"
    return None


def _angles(table: RawTable) -> dict[str, str]:
    """Columns of roll, pitch and yaw, or of yaw alone, as values of a mapping; empty if there are none or several."""
    columns = {}
    for word in ("roll", "pitch", "yaw"):
        named = [name for name in table.names if re.fullmatch(rf"(head|face)?[._ ]?{word}", split_unit(name)[0], re.I)]
        if len(named) == 1:
            columns[word] = named[0]
    if "yaw" not in columns:
        return {}
    values = np.abs(np.column_stack([table.numbers(name) for name in columns.values()]))
    unit = table.unit(columns["yaw"]) or ("deg" if float(np.nanmax(values)) > 2.0 * np.pi else "rad")
    if len(columns) == 3:
        return {"head_euler": f"[{columns['roll']},{columns['pitch']},{columns['yaw']}]:{unit}"}
    return {"head_yaw": f"{columns['yaw']}:{unit}"}


def _time(table: RawTable, person: str | None) -> tuple[str, FloatArray, list[str]] | None:
    """The value of a mapping for the times, the times in seconds, and what is not known of them."""
    stems = {name: split_unit(name)[0] for name in table.names}
    for name in table.names:
        base = (_SECONDS.fullmatch(name) or {"base": None})["base"]
        other = next((n for n in table.names if (m := _NANOSECONDS.fullmatch(n)) and m["base"] == base), None)
        if base is not None and other:
            times = table.numbers(name) + table.numbers(other) * 1e-9
            return f"{name}:s+{other}:ns", times, []
    for name in (n for n in table.names if _TIME.fullmatch(stems[n]) or (table.layout, n) == ("no header", "1")):
        cells = table.texts(name)
        if not is_number(cells[0]):
            if seconds_since_1970(cells[0]) is not None:
                times = np.array([seconds_since_1970(cell) or np.nan for cell in cells])
                return f"{_quoted(table, name)}:date", times, []
            continue
        values = table.numbers(name)
        unit = table.unit(name) or likely_time_unit(values[_rows_of_first(table, person)])
        if unit in TIMES_S:
            return f"{_quoted(table, name)}:{unit}", values * TIMES_S[unit], []
    for name in (n for n in table.names if _FRAME.fullmatch(stems[n])):
        try:
            values = table.numbers(name)
        except RecordingError:
            continue
        rate_hz = table.rate_hz or _RATE_HZ
        remark = [] if table.rate_hz else [f"{_RATE_HZ} frames a second is a guess"]
        return f"{_quoted(table, name)}:{rate_hz:g}hz", values / rate_hz, remark
    return None


def _rows_of_first(table: RawTable, person: str | None) -> BoolArray:
    """Rows of the person in the first row, shape (N,)."""
    ids = np.array(table.texts(person) if person else [""] * len(table.places))
    return np.asarray(ids == ids[0])
