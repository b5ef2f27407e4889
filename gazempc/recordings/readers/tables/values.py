"""Values of a mapping from the columns of a table: times, points, directions, and poses of head and pelvis."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError, SettingsError, shown
from gazempc.recordings.readers.bag_frames import optical_axes
from gazempc.recordings.readers.checks import check_finite, check_unit_quaternions
from gazempc.recordings.readers.tables.mapping import ColumnMapping
from gazempc.recordings.readers.tables.raw_table import RawTable
from gazempc.recordings.recording import Track, quats_of
from gazempc.types import FloatArray


def split_options(text: str, known: Sequence[str]) -> tuple[str, list[str]]:
    """Split units and orders off the end of a value.

    Args:
        text: Such as ``pose.position:mm``.
        known: Accepted words.

    Returns:
        The rest, and the words.
    """
    words: list[str] = []
    while ":" in text:
        rest, _, word = text.rpartition(":")
        if word.strip() not in known:
            break
        words.insert(0, word.strip())
        text = rest
    return text.strip(), words


def listed(text: str) -> list[str] | None:
    """Elements of ``[a, b, c]``; None if the text is not a list."""
    if text[:1] in "[(" and text[-1:] in "])":
        return [part.strip() for part in text[1:-1].split(",")]
    return None


LENGTHS_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
ANGLES_RAD = {"rad": 1.0, "deg": np.pi / 180.0}
# Letters of the columns of a group.
POSITION = (("x", "y", "z"), ("0", "1", "2"))
QUATERNION = (("w", "x", "y", "z"), ("0", "1", "2", "3"))
EULER = (("roll", "pitch", "yaw"), ("x", "y", "z"))
_CONSTANT = re.compile(r"=\s*([-+]?[\d.]+)")


def vector(table: RawTable, text: str, alphabets: Sequence[Sequence[str]], what: str) -> tuple[FloatArray, str | None]:
    """Numbers of several columns as one array.

    Args:
        table: The table.
        text: A group's name, or a list of columns and constants such as ``=1.6``.
        alphabets: Letters of the columns of a group.
        what: Name of the quantity, for messages.

    Returns:
        Shape (N, C), and the unit in the table, or None.

    Raises:
        RecordingError: If a column is missing or not numeric, or the list has another length.
    """
    parts = listed(text) or table.group(text, alphabets)
    if parts is None:
        raise table.missing(f"columns {text!r} with {', '.join(alphabets[0])} for the {what}", text)
    if len(parts) != len(alphabets[0]):
        raise RecordingError(table.path, f"mapping of the {what}", f"{text!r}", f"{len(alphabets[0])} columns")
    constants = [_CONSTANT.fullmatch(part) for part in parts]
    units = {table.unit(table.one(part)) for part, constant in zip(parts, constants, strict=True) if not constant}
    unit = units.pop() if len(units) == 1 else None
    if any(constants) and unit not in (None, "m"):
        problem = f"a constant with columns in {unit}"
        raise RecordingError(table.path, f"mapping of the {what}", problem, "columns in metres")
    values = [
        np.full(len(table.places), float(constant[1])) if constant else _finite_or_nan(table, table.one(part))
        for part, constant in zip(parts, constants, strict=True)
    ]
    return np.column_stack(values), unit


def _finite_or_nan(table: RawTable, name: str) -> FloatArray:
    """Numbers of a column, infinite ones as NaN; raises an error for numbers whose square would overflow."""
    values = table.numbers(name)
    values = np.where(np.isfinite(values), values, np.nan)
    check_finite(table.path, np.nan_to_num(values)[:, None], [name], table.place)
    return values


def points(table: RawTable, text: str, what: str) -> tuple[list[FloatArray], list[FloatArray], str | None]:
    """Signed points: ``A+B-C``; a name in the table is not split.

    Args:
        table: The table.
        text: The value without its unit.
        what: Name of the quantity, for messages.

    Returns:
        Positions of the points with plus and of those with minus, each of shape (N, 3), and the unit in the table, or
        None.
    """
    whole = listed(text) is not None or table.group(text, POSITION) is not None
    parts = [text] if whole else re.split(r"([+-])", text)
    terms = zip(["+", *parts[1::2]], parts[0::2], strict=True)
    read = [(sign, *vector(table, name.strip(), POSITION, what)) for sign, name in terms if name.strip()]
    units = {unit for _, _, unit in read}
    plus, minus = ([values for sign, values, _ in read if sign == wanted] for wanted in "+-")
    return plus, minus, units.pop() if len(units) == 1 else None


def in_metres(table: RawTable, text: str, what: str) -> FloatArray:
    """A position of a mapping: one point, or the mean of several.

    Args:
        table: The table.
        text: The value, with its unit or without.
        what: Name of the quantity, for messages.

    Returns:
        Shape (N, 3), metres, in the table's axes; NaN where a point is unknown.
    """
    body, words = split_options(text, tuple(LENGTHS_M))
    plus, minus, unit = points(table, body, what)
    if minus or not plus:
        raise RecordingError(table.path, f"mapping of the {what}", f"{text!r}", "a sum of points: A+B")
    unit = (words or [unit or "m"])[-1]
    if unit not in LENGTHS_M:
        raise RecordingError(table.path, f"columns of the {what}", f"their unit is {unit}", "a unit of length")
    return np.asarray(np.mean(plus, axis=0) * LENGTHS_M[unit])


def direction(table: RawTable, text: str, what: str) -> FloatArray:
    """Difference vector from the points with minus to those with plus.

    Args:
        table: The table.
        text: Such as ``LEFT_EAR-RIGHT_EAR``.
        what: Name of the quantity, for messages.

    Returns:
        Shape (N, 3), of any length, in the table's axes.
    """
    plus, minus, _ = points(table, text, what)
    if not plus or not minus:
        raise RecordingError(table.path, f"mapping of the {what}", f"{text!r}", "a difference of points: A-B")
    return np.asarray(np.mean(plus, axis=0) - np.mean(minus, axis=0))


TIMES_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}
_RATE = re.compile(r"(?P<rate>[\d.]*)\s*hz", re.IGNORECASE)
_WAYS = (*TIMES_S, "date")


def seconds(table: RawTable, text: str) -> FloatArray:
    """Capture times of a mapping.

    Args:
        table: The table.
        text: ``stamp:ns``; a sum such as ``sec:s+nanosec:ns``; ``frame:100hz`` for frame numbers; ``:30hz`` for
            consecutive rows; ``when:date`` for dates or clock times.

    Returns:
        Shape (N,), seconds; NaN where the file has none.

    Raises:
        RecordingError: If a column is missing, a cell is not a time, or a rate is missing.
    """
    head, _, last = text.rpartition(":")
    rate = _RATE.fullmatch(last.strip())
    if rate:
        return _frames(table, head.strip(), rate["rate"])
    total = np.zeros(len(table.places))
    for term in [text] if table.find(split_options(text, _WAYS)[0]) else text.split("+"):
        body, words = split_options(term, _WAYS)
        name = table.one(body)
        unit = (words or [table.unit(name) or "s"])[-1]
        if unit == "date":
            total += _dates(table, name)
        elif unit in TIMES_S:
            total += table.numbers(name) * TIMES_S[unit]
        else:
            raise RecordingError(table.path, f"column {name}", f"its unit is {unit}", "a unit of time")
    return total


def seconds_since_1970(cell: str) -> float | None:
    """A date or clock time in ISO 8601 as seconds, in UTC if it has no time zone; None for any other text."""
    cell = cell.strip().replace(",", ".")
    try:
        found = datetime.fromisoformat(f"1970-01-01T{cell}" if cell[2:3] == ":" else cell)
        return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()
    except (ValueError, OverflowError):
        return None


def _dates(table: RawTable, name: str) -> FloatArray:
    cells = table.texts(name)
    found = [seconds_since_1970(cell) if cell else float("nan") for cell in cells]
    if None in found:
        row = found.index(None)
        problem = f"{shown(cells[row])} is neither a date nor a clock time"
        expected = "ISO 8601, such as 2024-05-01T12:00:00.25 or 12:00:00.25"
        raise RecordingError(table.path, f"{table.place(row)}, column {name}", problem, expected)
    return np.array(found, dtype=np.float64)


def _frames(table: RawTable, column: str, rate: str) -> FloatArray:
    """Frame numbers as seconds; the smallest step between numbers is one frame."""
    numbers = table.numbers(table.one(column)) if column else np.arange(float(len(table.places)))
    rate_hz = float(rate) if rate else table.rate_hz
    if not rate_hz:
        expected = f"the rate, such as --reading.columns 't={column}:60hz'"
        raise RecordingError(table.path, "time stamps", "the file has frame numbers and no frame rate", expected)
    steps = np.diff(np.unique(numbers[np.isfinite(numbers)]))
    return numbers / (float(steps.min()) if steps.size else 1.0) / rate_hz


# Axes of a file that point forward, left and up.
AXES = {
    "z-up": "[x,y,z]",
    "y-up": "[z,x,y]",  # x to the left of a person who faces +z: OptiTrack, BVH
    "optical": "[z,-x,-y]",  # cameras: x right, y down, z forward
    "unity": "[z,-x,y]",  # left-handed: x right, y up, z forward
}
_AXIS = re.compile(r"([+-]?)([xyz])")
_ORDERS = ("wxyz", "xyzw")
_ROTATION_VECTOR = "rotvec"
# Fixed axes in lower case, axes of the body in capitals.
_SEQUENCES = tuple("".join(axes) for letters in ("xyz", "XYZ") for axes in product(letters, repeat=3))


def read_parts(table: RawTable, mapping: ColumnMapping) -> tuple[FloatArray, Track]:
    """Read all rows.

    Args:
        table: The table.
        mapping: Their meaning, with `t` and `head`.

    Returns:
        Times, shape (N,), seconds; and the track, whose `valid` rows have a time and a head.

    Raises:
        RecordingError: If a column is missing, or a cell is invalid.
        SettingsError: If axes or orders are invalid.
    """
    given = mapping.texts()
    head_m = in_metres(table, given["head"], "head")
    axes = mapping.axes or "z-up"
    frame_id = ros_frame(table, mapping)
    if mapping.axes is None and frame_id is not None:
        axes = "optical" if optical_axes(frame_id, head_m[np.isfinite(head_m).all(axis=1)]) else "z-up"
    frame = _axes_matrix(axes, "axes")
    unknown = np.full_like(head_m, np.nan)
    pelvis_m = unknown if mapping.pelvis is None else in_metres(table, mapping.pelvis, "pelvis") @ frame.T
    # A position with a missing coordinate is unknown.
    pelvis_m = np.where(np.isfinite(pelvis_m).all(axis=1, keepdims=True), pelvis_m, np.nan)
    head_quat, pelvis_quat = (orientations(table, mapping, part, axes) for part in ("head", "pelvis"))
    return seconds(table, given["t"]), Track(head_m @ frame.T, head_quat, pelvis_m, pelvis_quat)


def ros_frame(table: RawTable, mapping: ColumnMapping) -> str | None:
    """ROS frame of the positions; None if the mapping has no such column."""
    names = [] if mapping.frame_id is None else table.texts(table.one(mapping.frame_id))
    return names[0] if names else None


def orientations(table: RawTable, mapping: ColumnMapping, part: str, axes: str) -> FloatArray:
    """Orientations of head or pelvis.

    Args:
        table: The table.
        mapping: Their meaning.
        part: ``head`` or ``pelvis``.
        axes: Axes of the table's frame.

    Returns:
        Shape (N, 4), w, x, y, z; NaN if unknown.

    Raises:
        RecordingError: If a column is missing or has invalid values.
        SettingsError: If axes or an order are invalid.
    """
    given = mapping.texts()
    frame = _axes_matrix(axes, "axes")
    # A ROS tracker's axes of a person are inferred from the facing.
    own = _axes_matrix(given.get(f"{part}_axes", "z-up" if "frame_id" in given else axes), f"{part}_axes")

    def in_our_axes(turns: Rotation) -> Rotation:
        matrices = frame @ turns.as_matrix() @ own.T
        if np.linalg.det(matrices[0]) < 0:
            raise SettingsError("axes: the frame's and the head's own axes differ in handedness")
        return Rotation.from_matrix(matrices)

    if text := given.get(f"{part}_q"):
        quats = _quaternions(table, text, f"{part}_q")
        return quats_of(quats, lambda known: in_our_axes(Rotation.from_quat(known, scalar_first=True)))
    if text := given.get(f"{part}_euler"):
        body, words = split_options(text, (*ANGLES_RAD, _ROTATION_VECTOR, *_SEQUENCES))
        values, unit = vector(table, body, EULER, f"{part}_euler")
        units = [word for word in words if word in ANGLES_RAD]
        order = next((word for word in words if word not in ANGLES_RAD), "xyz")
        values = values * _radians(table, units, unit, f"{part}_euler")
        if order == _ROTATION_VECTOR:
            return quats_of(values, lambda known: in_our_axes(Rotation.from_rotvec(known)))
        return quats_of(values, lambda known: in_our_axes(Rotation.from_euler(order, known)))
    if text := given.get(f"{part}_yaw"):
        body, words = split_options(text, tuple(ANGLES_RAD))
        name = table.one(body)
        yaw = table.numbers(name) * _radians(table, words, table.unit(name), f"{part}_yaw")
        return quats_of(yaw[:, None], lambda known: Rotation.from_euler("z", known))
    ways = [given.get(f"{part}_{way}") for way in ("forward", "left")]
    if ways == [None, None]:
        return np.full((len(table.places), 4), np.nan)
    return _from_directions(*(None if way is None else direction(table, way, part) @ frame.T for way in ways))


def _axes_matrix(text: str, source: str) -> FloatArray:
    """Matrix from a file's axes to x forward, y left, z up, shape (3, 3)."""
    parts = listed(AXES.get(text.strip().lower(), text.strip())) or []
    found = [match for part in parts if (match := _AXIS.fullmatch(part.lower()))]
    if len(parts) != 3 or len({match[2] for match in found}) != 3:
        expected = f"one of {', '.join(AXES)}, or the file's axes for forward, left and up, such as [z,-x,-y]"
        raise SettingsError(f"{source}: axes {text!r}: expected {expected}")
    return np.array([(-1.0 if match[1] == "-" else 1.0) * np.eye(3)["xyz".index(match[2])] for match in found])


def _quaternions(table: RawTable, text: str, what: str) -> FloatArray:
    body, words = split_options(text, _ORDERS)
    if listed(body) is not None and not words:
        raise RecordingError(table.path, f"mapping of {what}", f"{text!r}", "an order: [...]:wxyz or :xyzw")
    values, _ = vector(table, body, QUATERNION, what)
    if words and words[-1] == "xyzw" and listed(body) is not None:
        values = values[:, [3, 0, 1, 2]]
    # Programs write zeros for missing orientations.
    values = np.where((values == 0.0).all(axis=1, keepdims=True), np.nan, values)
    check_unit_quaternions(table.path, values, f"{what}{{w,x,y,z}}", table.place)
    return values


def _radians(table: RawTable, words: list[str], of_column: str | None, what: str) -> float:
    unit = (words or [of_column or ""])[-1]
    if unit not in ANGLES_RAD:
        raise RecordingError(table.path, f"mapping of {what}", "angles without a unit", "a unit: :deg or :rad")
    return ANGLES_RAD[unit]


def _from_directions(forward: FloatArray | None, left: FloatArray | None) -> FloatArray:
    """Orientations from the forward direction, the left one, or both; upright if only one is known."""
    up = np.array([0.0, 0.0, 1.0])
    if forward is None:
        assert left is not None
        forward = np.cross(left, up)
    z = np.cross(forward, np.cross(up, forward) if left is None else left)
    with np.errstate(invalid="ignore", divide="ignore"):
        x, z = (axis / np.linalg.norm(axis, axis=1, keepdims=True) for axis in (forward, z))
    matrices = np.stack([x, np.cross(z, x), z], axis=2).reshape(-1, 9)
    return quats_of(matrices, lambda known: Rotation.from_matrix(known.reshape(-1, 3, 3)))
