"""Proposal of a mapping for a table of unknown names: a time, and one point with x, y and z as the head."""

from __future__ import annotations

import re

import numpy as np

from gazempc.recordings.readers.tables.mapping import ColumnMapping
from gazempc.recordings.readers.tables.people import person_column
from gazempc.recordings.readers.tables.raw_table import RawTable, is_number, split_unit
from gazempc.recordings.readers.tables.values import LENGTHS_M, TIMES_S, seconds_since_1970

_TIME = re.compile(r"(.*[._ ])?(t|s|secs?|seconds|time|time_?stamps?|stamp|date|date_?time)", re.I)
_FRAME = re.compile(r"frame(_?(id|no|number|index))?|index", re.I)
_RATE_HZ = 30
_POINT = re.compile(r"(?P<base>.*?)[._ :/,\[-]*(?P<axis>[xyz])\]?", re.I)
_HEAD = re.compile(r"head|face|nose|eye", re.I)
_NO_POINT = re.compile(r"rot|orient|quat|angle|euler|(^|[._ /])[qr]$|vel|acc|robot|camera|target|pixel", re.I)
_HEIGHT_M = 1.6
# Typical interval between frames, and distance of a head from the origin.
_INTERVAL_S, _RANGE_M = 1.0 / 30.0, 2.0


def guess(table: RawTable) -> tuple[ColumnMapping, list[str]] | None:
    """Propose a mapping of time and head; the user adds orientations, axes and pelvis.

    Args:
        table: The table.

    Returns:
        The mapping, and remarks on its undetermined parts; None without a column of times or a unique point for the
        head.

    Raises:
        RecordingError: If a cell of the chosen columns is not a number.
    """
    points: dict[str, dict[str, str]] = {}
    if table.layout == "no header":
        points = {"": dict(zip("xyz", table.names[1:4], strict=False))}
    for name in table.names:
        if match := _POINT.fullmatch(split_unit(name)[0]):
            points.setdefault(match["base"], {})[match["axis"].lower()] = name
    heads = [base for base, axes in points.items() if {"x", "y"} <= axes.keys() and not _NO_POINT.search(base)]
    heads = [base for base in heads if _HEAD.search(base)] or heads
    timing = _time(table)
    if len(heads) != 1 or timing is None:
        return None
    time, remarks = timing
    columns = points[heads[0]]
    head = ",".join(_quoted(table, columns[axis]) if axis in columns else f"={_HEIGHT_M:g}" for axis in "xyz")
    found = {"t": time, "head": f"[{head}]"}
    unit = table.unit(columns["x"])
    if unit not in LENGTHS_M:
        away = float(np.nanmedian(np.linalg.norm([table.numbers(name) for name in columns.values()], axis=0)))
        unit = min(("m", "cm", "mm"), key=lambda unit: abs(np.log(away * LENGTHS_M[unit] / _RANGE_M + 1e-9)))
    found["head"] += f":{unit}" if unit != "m" else ""
    if table.layout == "no header":
        remarks.append("without a header the order t, x, y, z is a guess")
    if "z" not in columns:
        remarks.append(f"the file has no height: {_HEIGHT_M} m is assumed")
    if person := person_column(table):
        found["person"] = person
    return ColumnMapping.model_validate(found), remarks


def _quoted(table: RawTable, name: str) -> str:
    """A column's name, or its number if the name contains separators."""
    return f"#{table.names.index(name) + 1}" if re.search(r"[,\"'$`]|[\[(][^\])]*$", name) else name


def _time(table: RawTable) -> tuple[str, list[str]] | None:
    """The value of a mapping for the times, and remarks; None without a column of times."""
    for name in table.names:
        cell = table.texts(name)[0]
        if not _TIME.fullmatch(split_unit(name)[0]) and (table.layout, name) != ("no header", "1"):
            continue
        if is_number(cell):
            return f"{_quoted(table, name)}:{table.unit(name) or _time_unit(table, name)}", []
        if seconds_since_1970(cell) is not None:
            return f"{_quoted(table, name)}:date", []
    for name in table.names:
        if _FRAME.fullmatch(split_unit(name)[0]) and is_number(table.texts(name)[0]):
            remarks = [] if table.rate_hz else [f"{_RATE_HZ} frames per second is a guess"]
            return f"{_quoted(table, name)}:{table.rate_hz or _RATE_HZ:g}hz", remarks
    return None


def _time_unit(table: RawTable, name: str) -> str:
    """Unit of time stamps, by the median interval between frames."""
    steps = np.diff(np.unique(table.numbers(name)))
    step = float(np.nanmedian(steps)) if steps.size else _INTERVAL_S
    return min(("s", "ms", "us", "ns"), key=lambda unit: abs(np.log(step * TIMES_S[unit] / _INTERVAL_S)))
