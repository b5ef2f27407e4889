"""Least squares, and how sure its result is when errors hang together in time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from gazempc.types import FloatArray

# Two-sided 95 % of a normal distribution.
Z_95 = 1.959964


@dataclass(frozen=True)
class Fit:
    """Result of a fit with p parameters to n residuals.

    Attributes:
        values: Best parameters, shape (p,).
        covariance: Their covariance, shape (p, p).
        residual: Shape (n,).
    """

    values: FloatArray
    covariance: FloatArray
    residual: FloatArray


def fit(
    residual: Callable[[FloatArray], FloatArray],
    starts: Sequence[Sequence[float]],
    low: Sequence[float],
    high: Sequence[float],
    channels: int = 1,
) -> Fit:
    """Fit from several starts and keep the best.

    Args:
        residual: Parameters, shape (p,), to residuals in time order, shape (n,).
        starts: Where to begin.
        low: Lower bounds.
        high: Upper bounds.
        channels: How many residuals in a row share a time.

    Returns:
        The best fit.
    """
    results = [least_squares(residual, start, jac="3-point", bounds=(low, high)) for start in starts]
    best = min(results, key=lambda result: float(result.cost))
    return Fit(best.x, robust_covariance(np.asarray(best.jac), best.fun, channels), best.fun)


def robust_covariance(jacobian: FloatArray, residual: FloatArray, channels: int = 1) -> FloatArray:
    """Covariance of a least-squares estimate whose errors are correlated in time (Newey & West 1987).

    The number of lags follows Andrews (1991) for first-order correlation. Where the simple formula for independent
    errors gives more, it counts: correlation found by chance must not make an estimate look better than it is.

    Args:
        jacobian: Shape (n, p).
        residual: Shape (n,), in time order.
        channels: How many residuals in a row share a time.

    Returns:
        Shape (p, p).
    """
    n, p = jacobian.shape
    inverse = np.linalg.pinv(_products(jacobian, jacobian))
    # One row a time: errors of one time may have anything in common.
    scores = (jacobian * residual[:, None]).reshape(n // channels, channels, p).sum(axis=1)
    meat = _products(scores, scores)
    lags = _lags(residual.reshape(-1, channels))
    for lag in range(1, lags + 1):
        shared = _products(scores[lag:], scores[:-lag])
        meat += (1.0 - lag / (lags + 1.0)) * (shared + shared.T)
    spread = n / max(n - p, 1)
    correlated = spread * inverse @ meat @ inverse
    independent = inverse * float(residual @ residual) / max(n - p, 1)
    more = np.sqrt(np.maximum(1.0, np.diag(independent) / np.maximum(np.diag(correlated), 1e-300)))
    covariance: FloatArray = correlated * np.outer(more, more)
    return covariance


def _products(a: FloatArray, b: FloatArray) -> FloatArray:
    # As a @ of long thin matrices, but on one thread: starting several for so little work takes far longer than it.
    products: FloatArray = np.einsum("ij,ik->jk", a, b)
    return products


def _lags(residual: FloatArray) -> int:
    power = float(np.sum(residual * residual))
    rho = float(np.sum(residual[1:] * residual[:-1])) / power if power > 0 else 0.0
    rho = float(np.clip(rho, 0.0, 0.99))
    count = len(residual)
    return min(int(np.ceil(1.1447 * (4 * rho**2 / (1 - rho**2) ** 2 * count) ** (1 / 3))), count // 8)
