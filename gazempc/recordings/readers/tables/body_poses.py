"""Time, head and pelvis of all rows of a table by its mapping, turned to x forward, y left, z up."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError, SettingsError
from gazempc.recordings.readers.bag_frames import Poses, optical_axes, person_axes
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
_TURNS = ("rotvec",)
_SEQUENCE = re.compile(r"[xyz]{3}|[XYZ]{3}")


def axes_matrix(text: str, source: str) -> FloatArray:
    """The matrix that turns vectors of a file to x forward, y left, z up.

    Args:
        text: ``z-up``, ``y-up``, ``optical``, ``unity``, or a list such as ``[z,-x,-y]``.
        source: Where it is said, for messages.

    Returns:
        Shape (3, 3), of ones, minus ones and zeros.

    Raises:
        SettingsError: If the text names no axes.
    """
    parts = listed(AXES.get(text.strip().lower(), text.strip())) or []
    found = [_AXIS.fullmatch(part.lower()) for part in parts]
    if len(found) != 3 or None in found or len({m[2] for m in found if m}) != 3:
        raise SettingsError(
            f"{source}: axes {text!r}: expected one of {', '.join(AXES)}, or the file's axes that point forward, left "
            "and up, such as [z,-x,-y]"
        )
    matrix = np.zeros((3, 3))
    for row, match in enumerate(m for m in found if m):
        matrix[row, "xyz".index(match[2])] = -1.0 if match[1] == "-" else 1.0
    return matrix


def ros_frame(columns: Columns, mapping: ColumnMapping) -> str | None:
    """Name of the ROS frame that the positions are in; None where the mapping names no column with it."""
    if mapping.frame_id is None:
        return None
    names = columns.table.texts(columns.one(mapping.frame_id))
    return names[0] if names else None


def axes_of(columns: Columns, mapping: ColumnMapping, head_m: FloatArray) -> str:
    """Axes of the table's frame: those of the mapping; of a ROS frame those that its name or the people in it tell.

    Args:
        columns: Columns of the table.
        mapping: Their meaning.
        head_m: Heads in the table's axes, shape (N, 3), metres.

    Returns:
        A name or list as for `axes_matrix`.
    """
    frame = ros_frame(columns, mapping)
    if mapping.axes is not None or frame is None:
        return mapping.axes or "z-up"
    return "optical" if optical_axes(frame, head_m[np.isfinite(head_m).all(axis=1)]) else "z-up"


def orientations(columns: Columns, mapping: ColumnMapping, part: str, axes: str) -> FloatArray | None:
    """Orientations of head or pelvis.

    Args:
        columns: Columns of the table.
        mapping: Their meaning.
        part: ``head`` or ``pelvis``.
        axes: Axes of the table's frame.

    Returns:
        Shape (N, 4), w, x, y, z; NaN where not known; None if the mapping says nothing of them.

    Raises:
        RecordingError: If a column is missing or holds no such values.
        SettingsError: If axes or an order are no such.
    """
    given = mapping.texts()
    frame = axes_matrix(axes, "axes")
    # What a ROS tracker gives a person for axes is found out from where they face.
    own = axes_matrix(given.get(f"{part}_axes", "z-up" if "frame_id" in given else axes), f"{part}_axes")
    if f"{part}_q" in given:
        return _turned(_from_quaternions(columns, given[f"{part}_q"], f"{part}_q"), frame, own)
    if f"{part}_euler" in given:
        return _turned(_from_angles(columns, given[f"{part}_euler"], f"{part}_euler"), frame, own)
    if f"{part}_yaw" in given:
        body, words = split_options(given[f"{part}_yaw"], tuple(ANGLES_RAD))
        name = columns.one(body)
        yaw = columns.table.numbers(name) * _radians(columns, words, columns.table.unit(name), f"{part}_yaw")
        half = 0.5 * yaw
        return np.column_stack([np.cos(half), np.zeros((len(half), 2)), np.sin(half)])
    forward, left = (given.get(f"{part}_{way}") for way in ("forward", "left"))
    if forward is None and left is None:
        return None
    ways = [None if way is None else direction(columns, way, part) @ frame.T for way in (forward, left)]
    return _from_directions(*ways)


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
    body: str = text
    words: list[str] = []
    while (
        ":" in body
        and (word := body.rpartition(":")[2].strip())
        and (word in (*ANGLES_RAD, *_TURNS) or _SEQUENCE.fullmatch(word))
    ):
        body, words = body.rpartition(":")[0].strip(), [word, *words]
    values, unit = vector(columns, body, EULER, what)
    way = next((word for word in words if word not in ANGLES_RAD), "xyz")
    angles = values * _radians(columns, [word for word in words if word in ANGLES_RAD], unit, what)
    known = np.isfinite(angles).all(axis=1)
    result = np.full((len(angles), 4), np.nan)
    turn = Rotation.from_rotvec(angles[known]) if way in _TURNS else Rotation.from_euler(way, angles[known])
    result[known] = turn.as_quat(scalar_first=True)
    return result


def _radians(columns: Columns, words: list[str], said: str | None, what: str) -> float:
    unit = (words or [said or ""])[-1]
    if unit not in ANGLES_RAD:
        raise RecordingError(columns.table.path, f"mapping of {what}", "angles without a unit", "a unit: :deg or :rad")
    return ANGLES_RAD[unit]


def _turned(quats_wxyz: FloatArray, frame: FloatArray, own: FloatArray) -> FloatArray:
    """Orientations whose frame and own axes are the file's, with this package's."""
    result = np.full(quats_wxyz.shape, np.nan)
    known = np.isfinite(quats_wxyz).all(axis=1)
    if known.any():
        matrices = Rotation.from_quat(quats_wxyz[known], scalar_first=True).as_matrix()
        turned = frame @ matrices @ own.T
        if np.linalg.det(turned[0]) < 0:
            raise SettingsError("axes: of the frame's and the head's own axes, only one are left-handed")
        result[known] = Rotation.from_matrix(turned).as_quat(scalar_first=True)
    return result


def _from_directions(forward: FloatArray | None, left: FloatArray | None) -> FloatArray:
    """Orientations by the forward direction, the left one, or both; upright where only one is known."""
    up = np.array([0.0, 0.0, 1.0])
    if forward is None:
        assert left is not None
        forward = np.cross(left, up)
        x, y = forward, left
    else:
        x, y = forward, np.cross(up, forward) if left is None else left
    with np.errstate(invalid="ignore", divide="ignore"):
        z = np.cross(x, y)
        z /= np.linalg.norm(z, axis=1, keepdims=True)
        x = x / np.linalg.norm(x, axis=1, keepdims=True)
    matrices = np.stack([x, np.cross(z, x), z], axis=2)
    result = np.full((len(x), 4), np.nan)
    known = np.isfinite(matrices).all(axis=(1, 2))
    if known.any():
        result[known] = Rotation.from_matrix(matrices[known]).as_quat(scalar_first=True)
    return result


@dataclass(frozen=True)
class Parts:
    """What a mapping finds in N rows; NaN where not known. Axes are x forward, y left, z up.

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
        SettingsError: If axes or orders are no such.
    """
    assert mapping.t is not None
    assert mapping.head is not None
    head_m = in_metres(columns, mapping.head, "head")
    axes = axes_of(columns, mapping, head_m)
    frame = axes_matrix(axes, "axes")
    pelvis_m = None if mapping.pelvis is None else in_metres(columns, mapping.pelvis, "pelvis") @ frame.T
    quats = [_known(orientations(columns, mapping, part, axes), len(head_m), 4) for part in ("head", "pelvis")]
    unit = [np.asarray(values / np.linalg.norm(values, axis=1, keepdims=True)) for values in quats]
    return Parts(seconds(columns, mapping.t), head_m @ frame.T, unit[0], _known(pelvis_m, len(head_m), 3), unit[1])


def facing(parts: Parts, from_sensor: bool, is_face: bool) -> tuple[Parts, list[str]]:
    """Orientations of a ROS tracker's person, turned to x out of the face and z up.

    Args:
        parts: Rows of one person.
        from_sensor: Whether the frame's origin is the sensor.
        is_face: Whether faces alone are seen.

    Returns:
        The parts; orientations are NaN where nothing tells the axes. And what is to be said of it.
    """
    poses = Poses(parts.times_s, np.zeros_like(parts.times_s), parts.head_m, parts.head_quat)
    known = np.isfinite(parts.head_quat).all(axis=1)
    turn, note = person_axes(poses, from_sensor, is_face)
    quats = np.full_like(parts.head_quat, np.nan)
    if turn is not None and known.any():
        turned = Rotation.from_quat(parts.head_quat[known], scalar_first=True) * turn
        quats[known] = turned.as_quat(scalar_first=True)
    return replace(parts, head_quat=quats), [note] if note and known.any() else []


def _known(values: FloatArray | None, count: int, width: int) -> FloatArray:
    """Values of shape (N, C); what is known in part is not known."""
    if values is None:
        return np.full((count, width), np.nan)
    return np.where(np.isfinite(values).all(axis=1, keepdims=True), values, np.nan)
