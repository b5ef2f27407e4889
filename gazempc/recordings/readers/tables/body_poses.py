"""Poses of head and pelvis from the columns of a mapping, in the person's axes."""

from __future__ import annotations

import re
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError, SettingsError
from gazempc.recordings.readers.bag_frames import optical_axes
from gazempc.recordings.readers.checks import check_unit_quaternions
from gazempc.recordings.readers.tables.mapping import ColumnMapping
from gazempc.recordings.readers.tables.raw_table import RawTable
from gazempc.recordings.readers.tables.values import (
    ANGLES_RAD,
    EULER,
    QUATERNION,
    direction,
    in_metres,
    listed,
    seconds,
    split_options,
    vector,
)
from gazempc.recordings.recording import Track, quats_of
from gazempc.types import FloatArray

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
