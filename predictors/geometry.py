"""Yaw angles, rotations about the vertical, and factorisation of symmetric 3x3 matrices in plain floats."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from predictors.types import FloatArray, check_positive


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
    w, x, y, z = map(float, quat_wxyz)  # plain floats: several times as fast as array scalars
    return math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))


def rotation_about_vertical(angle_rad: float) -> FloatArray:
    """Rotation matrix about z.

    Args:
        angle_rad: Angle, radians, positive to the left.

    Returns:
        R, shape (3, 3).
    """
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def bearing_covariance(position_m: ArrayLike, bearing_sd_rad: float, range_sd_m: float) -> FloatArray:
    """Covariance from the standard deviations of bearing and range.

    For a bearing without a range, place the head at a likely range and state the uncertainty of that range.

        covariance_m2 = bearing_covariance(head_m, bearing_sd_rad=0.002, range_sd_m=1.0)

    Args:
        position_m: Head relative to the sensor, shape (3,), metres. The covariance is in the same frame.
        bearing_sd_rad: Standard deviation of the direction on both axes across it, radians, positive.
        range_sd_m: Standard deviation of the range, metres, positive.

    Returns:
        The covariance, shape (3, 3), square metres.

    Raises:
        ValueError: If the position is not three finite numbers or at the sensor itself, or a standard deviation is not
            a positive number.
    """
    position = np.asarray(position_m, dtype=np.float64)
    if position.shape != (3,) or not np.isfinite(position).all():
        raise ValueError(f"position_m is {position_m!r}, expected three finite numbers in metres")
    range_m = float(np.linalg.norm(position))
    if range_m == 0.0:
        raise ValueError("position_m is at the sensor itself, where there is no direction")
    check_positive(bearing_sd_rad=bearing_sd_rad, range_sd_m=range_sd_m)
    sight = position / range_m
    along = np.outer(sight, sight)
    across_m = range_m * bearing_sd_rad
    return np.asarray(range_sd_m**2 * along + across_m**2 * (np.eye(3) - along))


def mahalanobis2(difference: FloatArray, covariance: FloatArray, allowance: float = 0.0) -> float:
    """Squared Mahalanobis distance, by LDL' factorisation.

    Args:
        difference: Shape (3,).
        covariance: Positive definite, shape (3, 3); its lower triangle is not read.
        allowance: Variance that is added on each axis.

    Returns:
        The squared distance; NaN on overflow.
    """
    x, y, z = difference.tolist()
    d_x, d_y, d_z, l_yx, l_zx, l_zy = _factors(covariance, allowance)
    y -= l_yx * x
    z -= l_zx * x + l_zy * y
    distance2: float = x * x / d_x + y * y / d_y + z * z / d_z
    return distance2


def inverse(matrix: FloatArray, floor: float = 0.0) -> FloatArray:
    """Inverse, by LDL' factorisation.

    Args:
        matrix: Positive definite, shape (3, 3); its lower triangle is not read.
        floor: Added to the diagonal.

    Returns:
        Shape (3, 3), symmetric to the last bit.
    """
    d_x, d_y, d_z, l_yx, l_zx, l_zy = _factors(matrix, floor)
    # Subdiagonal elements of the inverse of L, which has a unit diagonal.
    m_yx, m_zy, m_zx = -l_yx, -l_zy, l_zy * l_yx - l_zx
    a, b, c = 1.0 / d_x, 1.0 / d_y, 1.0 / d_z
    i_xy, i_xz, i_yz = m_yx * b + m_zy * m_zx * c, m_zx * c, m_zy * c
    return np.array(
        [[a + m_yx * m_yx * b + m_zx * m_zx * c, i_xy, i_xz], [i_xy, b + m_zy * m_zy * c, i_yz], [i_xz, i_yz, c]]
    )


def _factors(matrix: FloatArray, added: float) -> tuple[float, float, float, float, float, float]:
    """Diagonal of D, and the elements yx, zx and zy of L, of the matrix plus `added` on its diagonal."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = matrix.tolist()
    d_x = xx + added
    l_yx, l_zx = xy / d_x, xz / d_x
    d_y = yy + added - l_yx * xy
    l_zy = (yz - l_zx * xy) / d_y
    d_z = zz + added - l_zx * xz - l_zy * (yz - l_zx * xy)
    return d_x, d_y, d_z, l_yx, l_zx, l_zy
