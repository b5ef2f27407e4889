"""Symmetric 3x3 matrices in plain numbers: numpy's solvers take several times as long for one so small."""

from __future__ import annotations

import numpy as np

from predictors.types import FloatArray


def mahalanobis2(difference: FloatArray, covariance: FloatArray, allowance: float = 0.0) -> float:
    """Squared Mahalanobis distance, by the factors L D L' of the matrix.

    Args:
        difference: Shape (3,).
        covariance: Positive definite, shape (3, 3); its lower triangle is not read.
        allowance: Variance that is added on each axis.

    Returns:
        The distance, squared; NaN where numbers are too large.
    """
    x, y, z = difference.tolist()
    d_x, d_y, d_z, l_yx, l_zx, l_zy = _factors(covariance, allowance)
    y -= l_yx * x
    z -= l_zx * x + l_zy * y
    distance2: float = x * x / d_x + y * y / d_y + z * z / d_z
    return distance2


def inverse(matrix: FloatArray, floor: float = 0.0) -> FloatArray:
    """The inverse, by the factors L D L'.

    Args:
        matrix: Positive definite, shape (3, 3); its lower triangle is not read.
        floor: Added to the diagonal.

    Returns:
        Shape (3, 3), symmetric to the last bit.
    """
    d_x, d_y, d_z, l_yx, l_zx, l_zy = _factors(matrix, floor)
    # Rows of the inverse of L below its diagonal of ones.
    m_yx, m_zy, m_zx = -l_yx, -l_zy, l_zy * l_yx - l_zx
    a, b, c = 1.0 / d_x, 1.0 / d_y, 1.0 / d_z
    i_xy, i_xz, i_yz = m_yx * b + m_zy * m_zx * c, m_zx * c, m_zy * c
    return np.array(
        [[a + m_yx * m_yx * b + m_zx * m_zx * c, i_xy, i_xz], [i_xy, b + m_zy * m_zy * c, i_yz], [i_xz, i_yz, c]]
    )


def _factors(matrix: FloatArray, added: float) -> tuple[float, float, float, float, float, float]:
    """Diagonal of D, and the elements yx, zx and zy of L, of the matrix with something added to its diagonal."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = matrix.tolist()
    d_x = xx + added
    l_yx, l_zx = xy / d_x, xz / d_x
    d_y = yy + added - l_yx * xy
    l_zy = (yz - l_zx * xy) / d_y
    d_z = zz + added - l_zx * xz - l_zy * (yz - l_zx * xy)
    return d_x, d_y, d_z, l_yx, l_zx, l_zy
