"""Yaw from quaternions."""

from __future__ import annotations

import math

import numpy as np

from predictors.types import FloatArray


def wrap_rad(angle_rad: float) -> float:
    """Wrap an angle to (-pi, pi].

    Args:
        angle_rad: Any angle, radians.

    Returns:
        The same angle in (-pi, pi].
    """
    return float(np.pi - (np.pi - angle_rad) % (2.0 * np.pi))


def yaw_rad(quat_wxyz: FloatArray) -> float:
    """Horizontal direction in which a person's forward axis (+x of the body frame) points.

    Args:
        quat_wxyz: Unit quaternion, shape (4,).

    Returns:
        The angle about the vertical from +x towards +y, radians, in (-pi, pi].
    """
    w, x, y, z = map(float, quat_wxyz)  # plain numbers: several times as fast as array scalars
    return math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
