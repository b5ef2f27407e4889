"""Fit how far the predictor `walker` errs, on people that its networks have not seen."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize
from scipy.stats import chi2

from gazempc.types import FloatArray

# Keeps coefficients of what hardly varies near zero; in units of examples.
_PRIOR_WEIGHT = 5.0
_SMALLEST_M = 1e-4
_NOMINAL = np.array([0.68, 0.95])
_CAUTIOUS = 0.72
_SCALES = np.exp(np.linspace(np.log(0.5), np.log(2.0), 141))


def fit_spread(doubt: FloatArray, error_m: FloatArray, weight: FloatArray) -> FloatArray:
    """Coefficients of the logarithm of the standard deviation, by maximum likelihood.

    For each knot and axis: error ~ N(0, exp(2 doubt · b)), which is convex in b.

    Args:
        doubt: Reasons for doubt, shape (N, reasons), the first of them 1.
        error_m: Errors on people left out, shape (N, knots, 3), metres; NaN where there is none.
        weight: How much each example counts, shape (N,).

    Returns:
        Shape (reasons, knots, 3).
    """
    coefficients = np.zeros((doubt.shape[1], *error_m.shape[1:]))
    for knot in range(error_m.shape[1]):
        for axis in range(3):
            known = np.isfinite(error_m[:, knot, axis])
            coefficients[:, knot, axis] = _fit_one(doubt[known], error_m[known, knot, axis], weight[known])
    return coefficients


def calibrate(coefficients: FloatArray, doubt: FloatArray, error_m: FloatArray) -> FloatArray:
    """Scale the spread at each knot so that the stated 68 and 95 % ellipsoids hold what they say.

    Errors of walkers have longer tails than a normal distribution: nobody knows beforehand who will turn. Maximum
    likelihood then makes the 68 % ellipsoid too large and the 95 % one too small. This takes the scale at which the
    worse of both is least wrong, or the one at which the 68 % ellipsoid holds 72 %, whichever is wider: in turns errors
    are larger than elsewhere, and a robot that is too sure of itself is worse off than one that is not sure enough.

    Args:
        coefficients: As made by `fit_spread`.
        doubt: Reasons for doubt, shape (N, reasons).
        error_m: Errors, shape (N, knots, 3), metres.

    Returns:
        Coefficients of the scaled spread.
    """
    scaled = coefficients.copy()
    with np.errstate(invalid="ignore"):
        distance2 = np.sum((error_m / np.exp(np.tensordot(doubt, coefficients, axes=1))) ** 2, axis=-1)
    limits = chi2.ppf(_NOMINAL, df=3)
    for knot in range(error_m.shape[1]):
        found = distance2[np.isfinite(distance2[:, knot]), knot]
        if not found.size:
            continue
        held = (found[:, None, None] <= (_SCALES**2)[:, None] * limits).mean(axis=0)
        least_wrong = np.argmin(np.max(np.abs(held - _NOMINAL), axis=1))
        cautious = np.argmin(np.abs(held[:, 0] - _CAUTIOUS))
        scaled[0, knot] += np.log(_SCALES[max(least_wrong, cautious)])
    return scaled


def _fit_one(u: FloatArray, e: FloatArray, weight: FloatArray) -> FloatArray:
    start = np.zeros(u.shape[1])
    total = float(weight.sum())
    if not total > 0:
        return start
    start[0] = np.log(max(float(np.sqrt(np.average(e**2, weights=weight))), _SMALLEST_M))
    prior = np.full(u.shape[1], _PRIOR_WEIGHT)
    prior[0] = 0.0

    def cost(b: FloatArray) -> tuple[float, FloatArray]:
        log_sd = u @ b
        squared = 0.5 * e**2 * np.exp(-2.0 * log_sd)
        value = float(np.sum(weight * (log_sd + squared)) + 0.5 * np.sum(prior * b**2))
        return value / total, (u.T @ (weight * (1.0 - 2.0 * squared)) + prior * b) / total

    return np.asarray(minimize(cost, start, jac=True, method="L-BFGS-B").x)
