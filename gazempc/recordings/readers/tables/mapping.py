"""Meaning of the columns of a table: a mapping, given as text or TOML, or found in the header."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gazempc.errors import RecordingError, SettingsError, shown, suggest
from gazempc.files.documents import read_settings
from gazempc.recordings.readers.tables.raw_table import Layout, RawTable, is_number, split_unit
from gazempc.recordings.readers.tables.values import LENGTHS_M, POSITION, TIMES_S, seconds_since_1970, split_options
from gazempc.specfiles import explain, parse_spec


class ColumnMapping(BaseModel):
    """Which columns are time, head, pelvis and person; each value is columns and, after a colon, their unit or order.

    None: not in the table. See the page *Tables as exported* for the values.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    t: str | None = Field(default=None, description="Capture time")
    head: str | None = Field(default=None, description="Position of the head")
    head_q: str | None = Field(default=None, description="Orientation of the head, as quaternions")
    head_euler: str | None = Field(default=None, description="Orientation of the head, as three angles")
    head_yaw: str | None = Field(default=None, description="Orientation of the head, by yaw only")
    head_forward: str | None = Field(default=None, description="Points whose difference is forward of the head")
    head_left: str | None = Field(default=None, description="Points whose difference is to the left of the head")
    head_axes: str | None = Field(default=None, description="Axes of the head, if they differ from the frame's")
    pelvis: str | None = Field(default=None, description="Position of the pelvis")
    pelvis_q: str | None = Field(default=None, description="Orientation of the pelvis, as quaternions")
    pelvis_euler: str | None = Field(default=None, description="Orientation of the pelvis, as three angles")
    pelvis_yaw: str | None = Field(default=None, description="Orientation of the pelvis, by yaw only")
    pelvis_forward: str | None = Field(default=None, description="Points whose difference is forward of the pelvis")
    pelvis_left: str | None = Field(default=None, description="Points whose difference is to the left of the pelvis")
    pelvis_axes: str | None = Field(default=None, description="Axes of the pelvis, if they differ from the frame's")
    axes: str | None = Field(default=None, description="Axes of the table's frame; default: z up")
    frame_id: str | None = Field(default=None, description="Column of the ROS frame; its name identifies optical axes")
    person: str | None = Field(default=None, description="Column of the person's id")
    origin: Literal["sensor", "floor", "hips"] | None = Field(
        default=None, description="Origin of the frame: the robot's sensor, a point of the floor, or the hips"
    )

    kind: Literal["motion capture", "tracked"] | None = Field(
        default=None,
        description="Whether the positions are the truth (motion capture, the default) or measured by a tracker",
    )

    def texts(self) -> dict[str, str]:
        """The given values, by key."""
        return {key: value for key in ColumnMapping.model_fields if (value := getattr(self, key)) is not None}

    def over(self, base: ColumnMapping) -> ColumnMapping:
        """This mapping, completed by another one."""
        return ColumnMapping.model_validate({**base.texts(), **self.texts()})

    def as_option(self) -> str:
        """The mapping as `--reading.columns` takes it."""
        return ", ".join(f"{key}={value}" for key, value in self.texts().items())


class ShippedMapping(ColumnMapping):
    """A shipped mapping, and the tables to which it applies.

    A value may list alternatives, ``a|b``: the first one in the table is used.

    Attributes:
        source: Program that writes such tables, and where its columns are described.
        layout: Layouts of the table.
        columns: Number of columns of a table without a header.
        integers: Numbers of its columns of integers.
        words: Numbers of its columns of text.
        needs: Required keys besides `t`, `head` and `person`.
        note: Shown with the results.
    """

    t: str
    head: str
    source: str
    layout: tuple[Layout, ...]
    columns: int | None = None
    integers: tuple[int, ...] = ()
    words: tuple[int, ...] = ()
    needs: tuple[str, ...] = ()
    note: str = ""


def parse_columns(text: str, source: str = "--reading.columns") -> ColumnMapping:
    """Read a mapping from text such as ``t=stamp:ns, head=[px,py,pz]:mm, axes=y-up``.

    Args:
        text: Items ``key=value``, separated by commas; commas in brackets do not separate.
        source: Origin of the text, for messages.

    Returns:
        The mapping.

    Raises:
        SettingsError: If an item is not ``key=value``, or keys are unknown; names all of them.
    """
    values: dict[str, str] = {}
    # Other commas separate columns.
    for item in re.split(r",(?=\s*\w+\s*=)", text):
        key, equals, value = (part.strip() for part in item.partition("="))
        if item.strip() and not (equals and key and value):
            raise SettingsError(f"{source}: {item.strip()!r} is not key=value; expected t=stamp:ns, head=pos:mm")
        if key in values:
            raise SettingsError(f"{source}: duplicate key {key}")
        values |= {key: value} if key else {}
    try:
        return ColumnMapping.model_validate(values)
    except ValidationError as error:
        raise SettingsError(explain(error, source, ColumnMapping)) from None


def read_mapping(path: Path) -> ColumnMapping:
    """Read a mapping from a TOML file.

    Raises:
        SettingsError: If there is no such file, or it is not a mapping.
    """
    return parse_spec(ColumnMapping, read_settings(path), str(path))


def saved_places(path: Path) -> tuple[Path, Path]:
    """Candidate files of a table's mapping: its own beside it, then one for all tables of the folder."""
    return path.with_name(f"{path.name}.columns.toml"), path.with_name("columns.toml")


_COLUMN = re.compile(r"((person|track|face|body|pedestrian)_?)?id", re.I)


def person_column(table: RawTable) -> str | None:
    """Column of person ids: a known name, and few distinct values."""
    named = (name for name in table.names if _COLUMN.fullmatch(name))
    return next((name for name in named if len(set(table.texts(name))) <= max(1, len(table.places) // 4)), None)


def people_in_header(table: RawTable, head: str) -> list[str]:
    """Names of people or bodies with columns for the head.

    Args:
        table: The table.
        head: Value of the mapping, with ``{person}`` in it.

    Returns:
        Names, in the order of the columns; "" for columns without a name.
    """
    body, _ = split_options(head, tuple(LENGTHS_M))
    # The whole value first: names may contain a sign.
    for first in (body, re.split(r"[+-]", body)[0].strip()):
        # Columns without a name have no colon either.
        pattern = re.escape(first).replace(r"\{person\}:", "(?:(?P<person>.+):)?", 1)
        pattern = pattern.replace(r"\{person\}", "(?P=person)" if "P<person>" in pattern else "(?P<person>.+)")
        expression = re.compile(rf"{pattern}[._ ]?{POSITION[0][0]}", re.IGNORECASE)
        if found := [match["person"] or "" for name in table.names if (match := expression.fullmatch(name))]:
            return list(dict.fromkeys(found))
    return []


def choose_from_header(table: RawTable, names: list[str], wanted: str | None) -> tuple[str, list[str]]:
    """Select the person by names in the header.

    Args:
        table: The table.
        names: People or bodies with columns.
        wanted: The user's choice, or None.

    Returns:
        The name, and a note if there are others.

    Raises:
        SettingsError: If the wanted person is not in the table.
        RecordingError: If there are several heads.
    """
    if wanted is not None:
        found = [name for name in names if name.casefold() == wanted.casefold()]
        if not found:
            raise SettingsError(f"--reading.person {wanted}: not in {table.path}; {suggest(wanted, names)}")
        return found[0], []
    if len(names) == 1:
        return names[0], []
    likely = [name for name in names if "head" in name.casefold()]
    if len(likely) == 1:
        others = ", ".join(name for name in names if name != likely[0])
        return likely[0], [f"the head is {likely[0]!r}; also in the file: {others}; choose by --reading.person"]
    problem = f"several candidates for the head: {', '.join(likely or names)}"
    raise RecordingError(table.path, "header", problem, f"a choice, such as --reading.person {(likely or names)[0]!r}")


NEEDED = ("t", "head_x", "head_y", "head_z")
# By key of the mapping; each requires all of its columns.
_OPTIONAL = {
    "head_q": tuple(f"head_q{part}" for part in "wxyz"),
    "pelvis": tuple(f"pelvis_{axis}" for axis in "xyz"),
    "pelvis_q": tuple(f"pelvis_q{part}" for part in "wxyz"),
}
COLUMNS = (*NEEDED, *(name for names in _OPTIONAL.values() for name in names))


def own_mapping(table: RawTable) -> ColumnMapping:
    """Mapping of the package's own columns.

    Raises:
        RecordingError: If an optional part is incomplete.
    """
    begun = {key: names for key, names in _OPTIONAL.items() if any(name in table.names for name in names)}
    if missing := [name for names in begun.values() for name in names if name not in table.names]:
        problem = f"missing column(s) {', '.join(missing)}; found {shown(', '.join(table.names), 200)}"
        optional = "head_q{w,x,y,z}, pelvis_{x,y,z}, pelvis_q{w,x,y,z}"
        expected = f"the columns {', '.join(NEEDED)}, and all or none of the columns of each of {optional}"
        raise RecordingError(table.path, "header", problem, expected)
    person = person_column(table)
    several = person is not None and len(set(table.texts(person))) > 1
    parts = {"t": "t:s", "head": "head:m"} | {key: key for key in begun} | ({"person": person} if several else {})
    return ColumnMapping.model_validate(parts)


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
