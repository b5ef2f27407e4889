"""Headers of several lines, as OptiTrack Motive and Vicon write them, as one name a column.

Motive (format 1.2x): a line of pairs of fact and value; then, over each column, the kind of object, its name, its id,
``Rotation`` or ``Position``, and the axis. Vicon: a line that says what follows, such as ``Trajectories``; the rate;
the objects' names over the first of their columns; the axes; the units.
"""

from __future__ import annotations

from pathlib import Path

from gazempc.errors import RecordingError
from gazempc.recordings.readers.tables.raw_table import UNIT_WORDS, RawTable, is_number

# Where Vicon's programs put poses; a file may hold several sections, and devices before them.
_VICON_SECTIONS = ("Trajectories", "Segments", "Objects", "Model Outputs")
_MOTIVE_AXES = "Frame"
Row = tuple[int, tuple[str, ...]]


def motive_table(path: Path, rows: list[Row]) -> RawTable:
    """A table exported by OptiTrack Motive, columns named ``object.Position.X``.

    Args:
        path: File it is from.
        rows: All rows that are not blank, with their lines.

    Returns:
        The table, with the file's unit of length and frame rate.

    Raises:
        RecordingError: If the header has another form, or no rows follow it.
    """
    facts = dict(zip(rows[0][1][0::2], rows[0][1][1::2], strict=False))
    axes = next((k for k, (_, row) in enumerate(rows) if row[0].strip() == _MOTIVE_AXES), None)
    if axes is None or axes < 4:
        raise RecordingError(path, "header", "no line that begins with 'Frame'", "a CSV export of Motive with headers")
    # Above the axes stand Rotation or Position; above these names and ids, in an order that versions change.
    things = rows[axes - 1][1]
    above = [row for _, row in rows[1 : axes - 1] if any(cell.strip() for cell in row)]
    if len(above) < 2:
        raise RecordingError(path, "header", "no lines with kinds and names of objects", "a CSV export with headers")
    names = []
    for k, axis in enumerate(rows[axes][1]):
        kind, name, thing = (line[k].strip() if k < len(line) else "" for line in (above[0], above[1], things))
        # A body's markers must not pass for bodies.
        thing = "Marker" if "Marker" in kind and thing == "Position" else thing
        names.append(".".join(part for part in (*((name, thing) if k > 1 else ()), axis.strip()) if part))
    length = UNIT_WORDS.get(facts.get("Length Units", "").strip().lower())
    units = {name: length for name in names if length and (".Position." in name or ".Marker." in name)}
    notes = []
    rotation = facts.get("Rotation Type", "Quaternion").strip()
    if rotation != "Quaternion":
        notes.append(
            f"orientations are Euler angles in the order {rotation}, which is not read by itself: export quaternions, "
            "or say head_euler=NAME.Rotation:ORDER:deg"
        )
    if facts.get("Coordinate Space", "Global").strip() not in ("Global", ""):
        raise RecordingError(path, "header", f"Coordinate Space {facts['Coordinate Space']!r}", "an export in Global")
    return _table(path, "motive", names, rows[axes + 1 :], units, _rate(facts.get("Export Frame Rate", "")), notes)


def vicon_table(path: Path, rows: list[Row]) -> RawTable | None:
    """A table exported by Vicon Nexus, Tracker or Shogun, columns named ``object.X``.

    Args:
        path: File it is from.
        rows: All rows that are not blank, with their lines.

    Returns:
        The first section that holds poses, with its units and rate; None if the file has none.

    Raises:
        RecordingError: If the section's header has another form, or no rows follow it.
    """
    starts = {
        row[0].strip(): k
        for k, (_, row) in enumerate(rows[:-1])
        if row[0].strip() in _VICON_SECTIONS and is_number(rows[k + 1][1][0])
    }
    section = next((name for name in _VICON_SECTIONS if name in starts), None)
    if section is None:
        return None
    first = starts[section]
    if len(rows) < first + 5 or rows[first + 3][1][0].strip() != "Frame":
        raise RecordingError(
            path, f"row {rows[first][0]}", "no line that begins with 'Frame' under it", "a CSV export of Vicon"
        )
    objects, axes, units = (rows[first + k][1] for k in (2, 3, 4))
    names, name = [], ""
    for k, axis in enumerate(axes):
        name = (objects[k].strip() if k < len(objects) else "") or name
        # Vicon Tracker writes "Global Angle Anna:Anna" over the angles.
        name = name.removeprefix("Global Angle ")
        names.append(f"{name}.{axis.strip()}" if k > 1 else axis.strip())
    found = {n: UNIT_WORDS.get(unit.strip().lower()) for n, unit in zip(names, units, strict=False)}
    body = rows[first + 5 :]
    end = next((k for k, (_, row) in enumerate(body) if not is_number(row[0]) or len(row) == 1), len(body))
    rate_hz = _rate(rows[first + 1][1][0])
    return _table(path, "vicon", names, body[:end], {n: u for n, u in found.items() if u}, rate_hz, [])


def _table(
    path: Path,
    layout: str,
    names: list[str],
    rows: list[Row],
    units: dict[str, str],
    rate_hz: float | None,
    notes: list[str],
) -> RawTable:
    if not rows:
        raise RecordingError(path, "", "a header and no rows", "a row a frame after the header")
    width = len(names)
    # Programs leave out the blank cells of what is not seen at the end of a row.
    padded = [[*row[:width], *[""] * (width - len(row))] for _, row in rows]
    return RawTable(
        path=path,
        layout="motive" if layout == "motive" else "vicon",
        names=tuple(names),
        columns=list(zip(*padded, strict=True)),
        places=[f"row {line}" for line, _ in rows],
        units=units,
        rate_hz=rate_hz,
        notes=tuple(notes),
    )


def _rate(text: str) -> float | None:
    return float(text) if is_number(text) and float(text) > 0 else None
