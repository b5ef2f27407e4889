"""The inner loops of `Walker`, compiled by numba (extra ``fast``): the same answers in a fraction of the time.

`predictors.walker.window` and `predictors.walker.between` say what is computed, in numpy, and do it without numba.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from predictors.types import FloatArray

_BAND = 7


@njit(cache=True)
def on_grid(
    times_s: FloatArray, values: FloatArray, information: FloatArray, lags_s: FloatArray, stiffness: FloatArray
) -> tuple[bool, FloatArray, FloatArray]:
    """The track on the grid, see `TrackWindow.on_grid`, and its smooth path, see `smooth_path`.

    Args:
        times_s: Times of the frames, shape (N,), seconds.
        values: Shape (N, 5).
        information: Inverses of the positions' covariances, shape (N, 9).
        lags_s: Lags of the nodes, shape (m,), m >= 2, the last one 0, seconds.
        stiffness: Band of the matrix before anything is seen, shape (3 m, 7); it is overwritten.

    Returns:
        Whether the matrix is positive definite; the path, shape (m, 3); what was seen, shape (m, 5).
    """
    n, m = times_s.size, lags_s.size
    now_s, step_s = times_s[n - 1], (lags_s[m - 1] - lags_s[0]) / (m - 1)
    seen = np.empty((m, 5))
    right = 1
    for k in range(m):
        at_s = now_s + lags_s[k]
        while right < n - 1 and times_s[right] < at_s:
            right += 1
        left = right - 1
        share = max((at_s - times_s[left]) / (times_s[right] - times_s[left]), 0.0)
        for c in range(5):
            seen[k, c] = values[left, c] + share * (values[right, c] - values[left, c])
    band, path = stiffness, np.zeros((m, 3))
    for i in range(n):
        at = max((times_s[i] - now_s) / step_s + (m - 1), 0.0)
        node = min(int(at), m - 2)
        share = at - node
        rest = 1.0 - share
        for r in range(3):
            pull = 0.0
            for c in range(3):
                info = information[i, 3 * r + c]
                pull += info * (values[i, c] - values[n - 1, c])
                if r >= c:
                    band[3 * node + c, r - c] += rest * rest * info
                    band[3 * (node + 1) + c, r - c] += share * share * info
                band[3 * node + c, 3 + r - c] += rest * share * info
            path[node, r] += rest * pull
            path[node + 1, r] += share * pull
    good = _solve(band, path.reshape(3 * m))
    for k in range(m):
        for c in range(3):
            path[k, c] += values[n - 1, c]
    return good, path, seen


@njit(cache=True)
def _solve(band: FloatArray, right: FloatArray) -> bool:
    # Cholesky factors L L' in place of the band: column j has its elements from the diagonal down.
    n = right.size
    for j in range(n):
        if not band[j, 0] > 0.0:
            return False
        band[j, 0] = math.sqrt(band[j, 0])
        last = min(_BAND, n - j)
        for d in range(1, last):
            band[j, d] /= band[j, 0]
        for p in range(1, last):
            for d in range(p, last):
                band[j + p, d - p] -= band[j, p] * band[j, d]
    for j in range(n):
        right[j] /= band[j, 0]
        for d in range(1, min(_BAND, n - j)):
            right[j + d] -= band[j, d] * right[j]
    for j in range(n - 1, -1, -1):
        for d in range(1, min(_BAND, n - j)):
            right[j] -= band[j, d] * right[j + d]
        right[j] /= band[j, 0]
    return True


@njit(cache=True)
def between_knots(
    tau_s: FloatArray, table: FloatArray, step_s: float, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Departures and spread at horizons, none of them in the past or beyond the last knot; see `BetweenKnots`.

    Args:
        tau_s: Horizons, shape (H,), seconds.
        table: Weights of the knots at every step, shape (rows, 2 knots): of departures, then of the spread.
        step_s: Step of the table, seconds.
        values: Shape (2 knots, 3 + columns): departures in the upper left, spread in the lower right.

    Returns:
        Shapes (H, 3) and (H, columns).
    """
    knots, columns = table.shape[1] // 2, values.shape[1]
    departure, spread = np.zeros((tau_s.size, 3)), np.zeros((tau_s.size, columns - 3))
    for h in range(tau_s.size):
        at = tau_s[h] / step_s
        row = int(at)
        share = at - row
        for k in range(knots):
            weight = table[row, k] + share * (table[row + 1, k] - table[row, k])
            for c in range(3):
                departure[h, c] += weight * values[k, c]
            weight = table[row, knots + k] + share * (table[row + 1, knots + k] - table[row, knots + k])
            for c in range(3, columns):
                spread[h, c - 3] += weight * values[knots + k, c]
    return departure, spread
