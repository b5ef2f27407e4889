"""Reads time, head and pelvis of all rows of a table by its mapping."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.recordings.readers.bag_axes import person_axes
from gazempc.recordings.readers.bag_frames import Poses
from gazempc.recordings.readers.tables.columns import Columns
from gazempc.recordings.readers.tables.frames import axes_matrix, axes_of, orientations
from gazempc.recordings.readers.tables.mapping import ColumnMapping
from gazempc.recordings.readers.tables.times import seconds
from gazempc.recordings.readers.tables.values import in_metres
from gazempc.types import BoolArray, FloatArray


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
