"""Axes and orientations of a table, turned to this package's: x forward, y left, z up."""

from __future__ import annotations

import re

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError, SettingsError
from gazempc.recordings.readers.bag_axes import optical_axes
from gazempc.recordings.readers.checks import check_unit_quaternions
from gazempc.recordings.readers.tables.columns import Columns, listed, split_options
from gazempc.recordings.readers.tables.mapping import ColumnMapping
from gazempc.recordings.readers.tables.values import ANGLES_RAD, EULER, QUATERNION, direction, vector
from gazempc.types import FloatArray

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
