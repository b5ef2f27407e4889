"""Smoothing of positions with covariances on a uniform time grid."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.linalg.lapack import dpbsv

from predictors.geometry import inverse
from predictors.types import FloatArray

# Power spectral density of the acceleration, m^2/s^3: passes gait (1.2 m/s^2 of sway at 1 Hz). Forecasts are the same
# with 5.
_ACCELERATION_PSD = 1.0
# Prior standard deviation of the velocity, as in `ConstantVelocity`.
_SPEED_SD_M_S = 1.0
# Prior standard deviation of the positions about the newest: keeps the matrix positive definite if a direction is
# nearly unobservable.
_FARTHEST_M = 100.0
# Share of a covariance's trace that is added to its diagonal: bounds the condition number.
_ROUNDING = 1e-12
# Diagonals in the lower band of the symmetric block-pentadiagonal matrix: 3x3 blocks up to the second neighbour.
_BAND = 7
# Indices of a block's elements in lower band storage (seven elements a column, from the diagonal down): lower triangle
# of the diagonal block with the indices in the block, then the block of the next neighbour.
_LOWER = [(row, column) for row in range(3) for column in range(row + 1)]
_ON_DIAGONAL = np.array([[_BAND * c + r - c for r, c in _LOWER], [3 * r + c for r, c in _LOWER]])
_BESIDE = np.array([_BAND * c + 3 + r - c for r in range(3) for c in range(3)])


def information_of(covariance_m2: FloatArray) -> FloatArray:
    """Inverse of a covariance, positive definite for any condition number.

    Args:
        covariance_m2: Covariance of a position, shape (3, 3), square metres.

    Returns:
        Its inverse, shape (9,), row by row, 1/m^2.
    """
    return inverse(covariance_m2, _ROUNDING * float(covariance_m2.trace())).reshape(9)


def smooth_path(
    at: FloatArray, positions_m: FloatArray, information: FloatArray, nodes: int, step_s: float
) -> FloatArray:
    """Maximum a posteriori path under white-noise acceleration: the Kalman smoother of the constant-velocity model.

    Solves (sum of H' W H + D' D / (q h^3)) p = sum of H' W y, with D the second difference, and with priors of position
    and initial velocity. The matrix is banded: time linear in the number of nodes. Reinsch (1967), Smoothing by spline
    functions.

    Args:
        at: Grid coordinates of the positions, shape (N,), in [0, nodes - 1]; the path is linear between nodes.
        positions_m: Positions, shape (N, 3), metres.
        information: Inverses of the positions' covariances, shape (N, 9), row by row, 1/m^2.
        nodes: Number of nodes, at least 2.
        step_s: Step h of the grid, seconds.

    Returns:
        The path at the nodes, shape (nodes, 3), metres.

    Raises:
        FloatingPointError: If an information matrix is not positive definite.
    """
    n = at.size
    left = np.minimum(at.astype(np.intp), nodes - 2)
    share = (at - left)[:, None]
    rest = 1.0 - share
    newest_m = positions_m[-1]
    weighted = (information.reshape(n, 3, 3) @ (positions_m - newest_m)[:, :, None])[:, :, 0]
    # Sums over the positions at each node, as one product.
    table = np.empty((2 * n, 12))
    np.multiply(rest * rest, information, out=table[:n, :9])
    np.multiply(share * share, information, out=table[n:, :9])
    np.multiply(rest, weighted, out=table[:n, 9:])
    np.multiply(share, weighted, out=table[n:, 9:])
    choose = np.zeros((nodes, 2 * n))
    columns = np.arange(n)
    choose[left, columns] = choose[left + 1, n + columns] = 1.0
    sums = choose @ table
    beside = choose[:-1, :n] @ (rest * share * information)
    band = stiffness(nodes, step_s).copy()
    band[:, _ON_DIAGONAL[0]] += sums[:, _ON_DIAGONAL[1]]
    band[:-1, _BESIDE] += beside
    _, path, failed = dpbsv(
        band.reshape(3 * nodes, _BAND).T, sums[:, 9:].reshape(-1, 1), lower=1, overwrite_ab=1, overwrite_b=1
    )
    if failed:
        raise FloatingPointError("an information matrix is not positive definite")
    return np.asarray(path.reshape(nodes, 3) + newest_m)


@cache
def stiffness(nodes: int, step_s: float) -> FloatArray:
    """Lower band of the matrix of second differences and of the priors, node by node, shape (nodes, 21)."""
    difference = np.diff(np.eye(nodes), 2, axis=0)
    first = np.diff(np.eye(nodes)[:2], axis=0)
    matrix = difference.T @ difference / (_ACCELERATION_PSD * step_s**3)
    matrix += first.T @ first / (step_s * _SPEED_SD_M_S) ** 2
    matrix += np.eye(nodes) / _FARTHEST_M**2
    band = np.zeros((3 * nodes, _BAND))
    for apart in range(min(3, nodes)):
        diagonal = np.diagonal(matrix, -apart)
        band[: 3 * diagonal.size, 3 * apart] = np.repeat(diagonal, 3)
    return band.reshape(nodes, 3 * _BAND)
