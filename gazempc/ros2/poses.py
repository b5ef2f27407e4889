"""Poses of frames in other frames, as homogeneous matrices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from gazempc.types import FloatArray

# Drivers round quaternions off; what is farther from unit length is none.
_NORM_ERROR = 0.05
# Maps have their origin at the equator at most.
_FARTHEST_M = 1e8


def poses_of(transforms: Sequence[Any]) -> FloatArray:
    """Poses of all, shape (T, 4, 4); NaN where the numbers are none."""
    rows = [
        (p.x, p.y, p.z, q.w, q.x, q.y, q.z)
        for p, q in ((t.transform.translation, t.transform.rotation) for t in transforms)
    ]
    numbers = np.array(rows, dtype=np.float64).reshape(-1, 7)
    near = np.all(np.abs(numbers[:, :3]) <= _FARTHEST_M, axis=1) & np.all(np.abs(numbers[:, 3:]) <= 2.0, axis=1)
    norms = np.linalg.norm(np.where(near[:, None], numbers[:, 3:], 0.0), axis=1)
    good = np.flatnonzero(np.abs(norms - 1.0) <= _NORM_ERROR)
    poses = np.full((len(numbers), 4, 4), np.nan)
    poses[good] = np.eye(4)
    poses[good, :3, 3] = numbers[good, :3]
    if good.size:
        poses[good, :3, :3] = Rotation.from_quat(numbers[good, 3:], scalar_first=True).as_matrix()
    return poses


def inverse_of(pose: FloatArray) -> FloatArray:
    """The pose of the other frame in this one, shape (4, 4)."""
    inverse = np.eye(4)
    inverse[:3, :3] = pose[:3, :3].T
    inverse[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return inverse


def between(early: FloatArray, late: FloatArray, share: float) -> FloatArray:
    """The pose between two, straight on and turning steadily.

    Args:
        early: The one, shape (4, 4).
        late: The other.
        share: Of the way from the one to the other, 0 to 1.

    Returns:
        The pose, shape (4, 4).
    """
    pose: FloatArray = early + share * (late - early)
    turns = Slerp([0.0, 1.0], Rotation.from_matrix(np.stack([early[:3, :3], late[:3, :3]])))
    pose[:3, :3] = turns(share).as_matrix()
    return pose
