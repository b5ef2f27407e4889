"""Time, head and pelvis of all rows of a table by its mapping, turned to x forward, y left, z up."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError, SettingsError
from gazempc.recordings.readers.bag_frames import Poses, composed, optical_axes, person_axes
from gazempc.recordings.readers.checks import check_unit_quaternions
from gazempc.recordings.readers.tables.mapping import ColumnMapping
from gazempc.recordings.readers.tables.values import (
    ANGLES_RAD,
    EULER,
    QUATERNION,
    Columns,
    direction,
    in_metres,
    listed,
    seconds,
    split_options,
    vector,
)
from gazempc.types import BoolArray, FloatArray

# Of which axes of a file x forward, y left and z up are made.
AXES = {
    "z-up": "[x,y,z]",
    "y-up": "[z,x,y]",  # x to the left of a person who faces +z: OptiTrack, BVH
    "optical": "[z,-x,-y]",  # cameras: x right, y down, z forward
    "unity": "[z,-x,y]",  # left-handed: x right, y up, z forward
}
_AXIS = re.compile(r"([+-]?)([xyz])")
_ORDERS = ("wxyz", "xyzw")
_ROTATION_VECTOR = "rotvec"
_SEQUENCE = re.compile(r"(.*):\s*([xyz]{3}|[XYZ]{3}|rotvec|rad|deg)\s*")


@dataclass(frozen=True)
class Parts:
    """Values of N rows; NaN where unknown. Axes are x forward, y left, z up.

    Attributes:
        times_s: Shape (N,), seconds.
        head_m: Shape (N, 3), metres.
        head_quat: Shape (N, 4), w, x, y, z.
        pelvis_m: As of the head.
        pelvis_quat: As of the head.
    """

    times_s: FloatArray
    head_m: FloatArray
    head_quat: FloatArray
    pelvis_m: FloatArray
    pelvis_quat: FloatArray

    def rows(self, chosen: BoolArray) -> Parts:
        """Some rows."""
        return Parts(*(values[chosen] for values in vars(self).values()))


def read_parts(columns: Columns, mapping: ColumnMapping) -> Parts:
    """Read all rows.

    Args:
        columns: Columns of the table.
        mapping: Their meaning, with `t` and `head`.

    Returns:
        The parts.

    Raises:
        RecordingError: If a column is missing, or a cell holds no such value.
        SettingsError: If axes or orders are invalid.
    """
    assert mapping.t is not None
    assert mapping.head is not None
    head_m = in_metres(columns, mapping.head, "head")
    unknown = np.full((len(head_m), 4), np.nan)
    axes = mapping.axes or "z-up"
    frame_id = ros_frame(columns, mapping)
    if mapping.axes is None and frame_id is not None:
        optical = optical_axes(frame_id, head_m[np.isfinite(head_m).all(axis=1)])
        axes = "optical" if optical else "z-up"
    frame = _axes_matrix(axes, "axes")
    pelvis_m = unknown[:, :3] if mapping.pelvis is None else in_metres(columns, mapping.pelvis, "pelvis") @ frame.T
    # A position that is known in part is unknown.
    pelvis_m = np.where(np.isfinite(pelvis_m).all(axis=1, keepdims=True), pelvis_m, np.nan)
    quats = []
    for part in ("head", "pelvis"):
        found = orientations(columns, mapping, part, axes)
        quats.append(
            unknown if found is None else _quats(found, lambda known: Rotation.from_quat(known, scalar_first=True))
        )
    return Parts(seconds(columns, mapping.t), head_m @ frame.T, quats[0], pelvis_m, quats[1])


def facing(parts: Parts, from_sensor: bool, is_face: bool) -> tuple[Parts, list[str]]:
    """Orientations of a ROS tracker's person, turned to x out of the face and z up.

    Args:
        parts: Rows of one person.
        from_sensor: Whether the frame's origin is the sensor.
        is_face: Whether faces alone are seen.

    Returns:
        The parts, orientations NaN where the axes are undetermined; and notes.
    """
    if not np.isfinite(parts.head_quat).all(axis=1).any():
        return parts, []
    poses = Poses(parts.times_s, np.zeros_like(parts.times_s), parts.head_m, parts.head_quat)
    turn, note = person_axes(poses, from_sensor, is_face)
    return replace(parts, head_quat=composed(parts.head_quat, turn)), [note] if note else []


def ros_frame(columns: Columns, mapping: ColumnMapping) -> str | None:
    """Name of the ROS frame that the positions are in; None where the mapping names no column with it."""
    names = [] if mapping.frame_id is None else columns.table.texts(columns.one(mapping.frame_id))
    return names[0] if names else None


def orientations(columns: Columns, mapping: ColumnMapping, part: str, axes: str) -> FloatArray | None:
    """Orientations of head or pelvis.

    Args:
        columns: Columns of the table.
        mapping: Their meaning.
        part: ``head`` or ``pelvis``.
        axes: Axes of the table's frame.

    Returns:
        Shape (N, 4), w, x, y, z; NaN where unknown; None if the mapping has none.

    Raises:
        RecordingError: If a column is missing or holds no such values.
        SettingsError: If axes or an order are invalid.
    """
    given = mapping.texts()
    frame = _axes_matrix(axes, "axes")
    # The axes that a ROS tracker gives a person are inferred from where they face.
    own = _axes_matrix(given.get(f"{part}_axes", "z-up" if "frame_id" in given else axes), f"{part}_axes")

    def turned(quats: FloatArray) -> Rotation:
        matrices = frame @ Rotation.from_quat(quats, scalar_first=True).as_matrix() @ own.T
        if np.linalg.det(matrices[0]) < 0:
            raise SettingsError("axes: of the frame's and the head's own axes, only one are left-handed")
        return Rotation.from_matrix(matrices)

    if text := given.get(f"{part}_q"):
        return _quats(_from_quaternions(columns, text, f"{part}_q"), turned)
    if text := given.get(f"{part}_euler"):
        return _quats(_from_angles(columns, text, f"{part}_euler"), turned)
    if text := given.get(f"{part}_yaw"):
        body, words = split_options(text, tuple(ANGLES_RAD))
        name = columns.one(body)
        yaw = columns.table.numbers(name) * _radians(columns, words, columns.table.unit(name), f"{part}_yaw")
        return _quats(yaw[:, None], lambda known: Rotation.from_euler("z", known))
    ways = [given.get(f"{part}_{way}") for way in ("forward", "left")]
    if ways == [None, None]:
        return None
    forward, left = (None if way is None else direction(columns, way, part) @ frame.T for way in ways)
    return _from_directions(forward, left)


def _axes_matrix(text: str, source: str) -> FloatArray:
    """The matrix that turns vectors of a file to x forward, y left, z up, shape (3, 3)."""
    parts = listed(AXES.get(text.strip().lower(), text.strip())) or []
    found = [match for part in parts if (match := _AXIS.fullmatch(part.lower()))]
    if len(parts) != 3 or len({match[2] for match in found}) != 3:
        raise SettingsError(
            f"{source}: axes {text!r}: expected one of {', '.join(AXES)}, or the file's axes that point forward, left "
            "and up, such as [z,-x,-y]"
        )
    matrix = np.zeros((3, 3))
    for row, match in enumerate(found):
        matrix[row, "xyz".index(match[2])] = -1.0 if match[1] == "-" else 1.0
    return matrix


def _from_quaternions(columns: Columns, text: str, what: str) -> FloatArray:
    body, words = split_options(text, _ORDERS)
    if listed(body) is not None and not words:
        raise RecordingError(columns.table.path, f"mapping of {what}", f"{text!r}", "an order: [...]:wxyz or :xyzw")
    values, _ = vector(columns, body, QUATERNION, what)
    if words and words[-1] == "xyzw" and listed(body) is not None:
        values = values[:, [3, 0, 1, 2]]
    # Programs write zeros for what they do not see.
    values = np.where((values == 0.0).all(axis=1, keepdims=True), np.nan, values)
    check_unit_quaternions(columns.table.path, values, f"{what}{{w,x,y,z}}", columns.table.place)
    return values


def _from_angles(columns: Columns, text: str, what: str) -> FloatArray:
    units, order = [], "xyz"
    while found := _SEQUENCE.fullmatch(text):
        text = found[1].strip()
        if found[2] in ANGLES_RAD:
            units.append(found[2])
        else:
            order = found[2]
    values, unit = vector(columns, text, EULER, what)
    angles = values * _radians(columns, units, unit, what)
    if order == _ROTATION_VECTOR:
        return _quats(angles, Rotation.from_rotvec)
    return _quats(angles, lambda known: Rotation.from_euler(order, known))


def _radians(columns: Columns, words: list[str], of_column: str | None, what: str) -> float:
    unit = (words or [of_column or ""])[-1]
    if unit not in ANGLES_RAD:
        raise RecordingError(columns.table.path, f"mapping of {what}", "angles without a unit", "a unit: :deg or :rad")
    return ANGLES_RAD[unit]


def _from_directions(forward: FloatArray | None, left: FloatArray | None) -> FloatArray:
    """Orientations by the forward direction, the left one, or both; upright where only one is known."""
    up = np.array([0.0, 0.0, 1.0])
    if forward is None:
        assert left is not None
        forward = np.cross(left, up)
    x, y = forward, np.cross(up, forward) if left is None else left
    with np.errstate(invalid="ignore", divide="ignore"):
        z = np.cross(x, y)
        z /= np.linalg.norm(z, axis=1, keepdims=True)
        x = x / np.linalg.norm(x, axis=1, keepdims=True)
    matrices = np.stack([x, np.cross(z, x), z], axis=2).reshape(-1, 9)
    return _quats(matrices, lambda known: Rotation.from_matrix(known.reshape(-1, 3, 3)))


def _quats(values: FloatArray, rotation: Callable[[FloatArray], Rotation]) -> FloatArray:
    """Quaternions of the rows that are known throughout, shape (N, 4), w, x, y, z; NaN in the others."""
    result, known = np.full((len(values), 4), np.nan), np.isfinite(values).all(axis=1)
    if known.any():
        result[known] = rotation(values[known]).as_quat(scalar_first=True)
    return result
