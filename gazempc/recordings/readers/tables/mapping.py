"""Meaning of the columns of a table: a mapping, from text on the command line or from a TOML file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gazempc.errors import SettingsError
from gazempc.files.documents import read_settings
from gazempc.recordings.readers.tables.raw_table import Layout
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
