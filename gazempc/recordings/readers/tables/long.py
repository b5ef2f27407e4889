"""Tables with a row for each landmark in each frame, turned into tables with a row a frame."""

from __future__ import annotations

import re
from dataclasses import replace

from gazempc.recordings.readers.tables.raw_table import RawTable, split_unit

_LANDMARK = re.compile(
    r"(landmark|joint|key_?point|body_?part|marker|bone|segment)(_?(id|name|index|no|nr|number))?", re.I
)
_AXIS = re.compile(r"(?P<kind>pos|position)?[._ ]?(?P<axis>[xyz])", re.I)
# Of one landmark only: what else stands in a row, such as a time, is the frame's.
_OF_LANDMARK = re.compile(r"(visibility|presence|confidence|score|likelihood|type)", re.I)


def wide(table: RawTable) -> RawTable:
    """A table with columns ``NOSE_x``, ``NOSE_y`` and so on, a row a frame.

    Args:
        table: A table; one without a column of landmarks, and x, y, z beside it, is returned as it is.

    Returns:
        The table; a landmark without a row in a frame has blank cells there.
    """
    named = [name for name in table.names if _LANDMARK.fullmatch(name)]
    axes = {m["axis"].lower(): name for name in table.names if (m := _AXIS.fullmatch(split_unit(name)[0]))}
    if not named or set(axes) != {"x", "y", "z"}:
        return table
    label, places = named[0], table.texts(named[0])
    about_frame = [
        n for n in table.names if n not in named and n not in axes.values() and not _OF_LANDMARK.fullmatch(n)
    ]
    whose = list(zip(*(table.texts(name) for name in about_frame), strict=True)) or [()] * len(places)
    # A frame's rows stand together; of a frame without a time or a number nothing else tells where it ends.
    rows: dict[tuple[str, ...], int] = {}
    for frame in whose:
        rows.setdefault(frame, len(rows))
    landmarks = list(dict.fromkeys(places))
    prefix = "" if not all(mark.isdigit() for mark in landmarks) else f"{label.partition('_')[0].lower()}_"
    found = {name: [""] * len(rows) for mark in landmarks for name in (f"{prefix}{mark}_{axis}" for axis in "xyz")}
    cells = {axis: table.texts(name) for axis, name in axes.items()}
    first = [0] * len(rows)
    for index in range(len(places) - 1, -1, -1):
        row = rows[whose[index]]
        first[row] = index
        for axis in "xyz":
            found[f"{prefix}{places[index]}_{axis}"][row] = cells[axis][index]
    unit = table.unit(axes["x"])
    return replace(
        table,
        names=(*about_frame, *found),
        columns=[*([frame[k] for frame in rows] for k in range(len(about_frame))), *found.values()],
        places=[table.places[index] for index in first],
        units={**table.units, **(dict.fromkeys(found, unit) if unit else {})},
        notes=(*table.notes, f"rows of {len(landmarks)} landmarks are put together, a row a frame"),
    )
