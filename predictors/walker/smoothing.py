"""A smooth path through uncertain positions: a smoothing spline on an even grid, with a covariance for each position."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.linalg.lapack import dpbsv

from predictors.types import FloatArray

# Standard deviation of the velocity before anything is known, m/s; as in `ConstantVelocity`.
_SPEED_SD_M_S = 1.0
# Lower band of a symmetric matrix with 3x3 blocks next to the diagonal of blocks.
_BAND = 7


def smooth_path(
    at: FloatArray, positions_m: FloatArray, information: FloatArray, psd_step: tuple[float, float], nodes: int
) -> FloatArray:
    """The most probable path of a body whose acceleration is white noise.

    It solves (sum of H' W H + D' D / (q h^3)) p = sum of H' W y with D the second difference: the discrete smoothing
    spline, which is the Kalman smoother of constant velocity. The matrix is banded, so this takes time in proportion to
    the number of nodes.

    Args:
        at: Places of the positions on the grid, shape (N,), in [0, nodes - 1]; between nodes the path is straight.
        positions_m: Positions, shape (N, 3), metres.
        information: Inverses of the positions' covariances, shape (N, 3, 3), 1/m^2.
        psd_step: Power spectral density q of the acceleration on each axis, m^2/s^3, and step h of the grid, seconds.
        nodes: Number of nodes, at least 2.

    Returns:
        The path at the nodes, shape (nodes, 3), metres.
    """
    left = np.minimum(at.astype(np.intp), nodes - 2)
    share = at - left
    rest = 1.0 - share
    seen = np.matmul(information, positions_m[:, :, None])[:, :, 0]
    # Sums over the positions at each node: of a table with the parts of all sums in its columns.
    n = at.size
    table = np.empty((2 * n, 12))
    table[:n, :9] = (rest * rest)[:, None] * information.reshape(n, 9)
    table[n:, :9] = (share * share)[:, None] * information.reshape(n, 9)
    table[:n, 9:], table[n:, 9:] = rest[:, None] * seen, share[:, None] * seen
    choose = np.zeros((nodes, 2 * n))
    columns = np.arange(n)
    choose[left, columns] = choose[left + 1, n + columns] = 1.0
    sums = choose @ table
    beside = choose[:, :n] @ ((rest * share)[:, None] * information.reshape(n, 9))
    band = _stiffness(nodes, psd_step).copy()
    blocks, beside = sums[:, :9].reshape(nodes, 3, 3), beside.reshape(nodes, 3, 3)
    for row in range(3):
        for column in range(3):
            if row >= column:
                band[row - column, column::3] += blocks[:, row, column]
            band[3 + row - column, column : 3 * nodes - 3 : 3] += beside[:-1, row, column]
    _, path, failed = dpbsv(band, sums[:, 9:].reshape(-1, 1), lower=1, overwrite_ab=1, overwrite_b=1)
    if failed:
        raise FloatingPointError(f"no path through these positions: row {failed} of the matrix is not positive")
    return np.asarray(path).reshape(nodes, 3)


@cache
def _stiffness(nodes: int, psd_step: tuple[float, float]) -> FloatArray:
    """Lower band of the matrix of second differences, and of the prior of the first velocity, shape (7, 3 nodes)."""
    psd, step_s = psd_step
    difference = np.zeros((nodes - 2, nodes))
    rows = np.arange(nodes - 2)
    difference[rows, rows], difference[rows, rows + 1], difference[rows, rows + 2] = 1.0, -2.0, 1.0
    matrix = difference.T @ difference / (psd * step_s**3)
    first = np.zeros(nodes)
    first[:2] = -1.0, 1.0
    matrix += np.outer(first, first) / (step_s * _SPEED_SD_M_S) ** 2
    band = np.zeros((_BAND, 3 * nodes))
    for apart in range(min(3, nodes)):
        diagonal = np.diagonal(matrix, -apart)
        band[3 * apart, : 3 * diagonal.size] = np.repeat(diagonal, 3)
    return band
