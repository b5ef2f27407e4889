"""Fit how far the predictor `walker` errs, on people that its networks have not seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

FloatArray = NDArray[np.float64]

# Keeps coefficients of what hardly varies near zero; in units of examples.
_PRIOR_WEIGHT = 5.0
_SMALLEST_M = 1e-4


def fit_spread(spread: FloatArray, error_m: FloatArray) -> FloatArray:
    """Coefficients of the logarithm of the standard deviation, by maximum likelihood.

    For each knot and axis: error ~ N(0, exp(2 spread · b)), which is convex in b.

    Args:
        spread: Inputs, shape (N, inputs), the first of them 1.
        error_m: Errors on people left out, shape (N, knots, 3), metres; NaN where there is none.

    Returns:
        Shape (inputs, knots, 3).
    """
    coefficients = np.zeros((spread.shape[1], *error_m.shape[1:]))
    for knot in range(error_m.shape[1]):
        for axis in range(3):
            known = np.isfinite(error_m[:, knot, axis])
            coefficients[:, knot, axis] = _fit_one(spread[known], error_m[known, knot, axis])
    return coefficients


def _fit_one(u: FloatArray, e: FloatArray) -> FloatArray:
    start = np.zeros(u.shape[1])
    if not e.size:
        return start
    start[0] = np.log(max(float(np.sqrt(np.mean(e**2))), _SMALLEST_M))
    prior = np.full(u.shape[1], _PRIOR_WEIGHT)
    prior[0] = 0.0

    def cost(b: FloatArray) -> tuple[float, FloatArray]:
        log_sd = u @ b
        squared = 0.5 * e**2 * np.exp(-2.0 * log_sd)
        value = float(np.sum(log_sd + squared) + 0.5 * np.sum(prior * b**2))
        return value / e.size, (u.T @ (1.0 - 2.0 * squared) + prior * b) / e.size

    return np.asarray(minimize(cost, start, jac=True, method="L-BFGS-B").x)
