"""Fit how far the predictor `walker` errs, on people that its networks have not seen."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize
from scipy.special import gammaln
from scipy.stats import f as f_distribution

from gazempc.types import FloatArray

# Keeps coefficients of what hardly varies near zero; in units of examples.
_PRIOR_WEIGHT = 5.0
_SMALLEST_M = 1e-4
_NOMINAL = np.array([0.68, 0.95])
_SCALES = np.exp(np.linspace(np.log(0.5), np.log(2.0), 141))
# Tails that are tried. With fewer than 5 degrees, the rarest errors alone would make the covariance.
_DEGREES_OF_FREEDOM = (5.0, 6.0, 8.0, 12.0, 20.0)
# Frames in a row err alike; so many rows, evenly spaced, tell as much as all.
_ENOUGH_ROWS = 12_000
# The tails are chosen at this horizon's knot, half a second.
_KNOT = 4


def fit_spread(doubt: FloatArray, error_m: FloatArray, weight: FloatArray) -> tuple[FloatArray, float]:
    """Fit scales and tails of a t distribution to errors.

    For each knot and axis: error ~ t(v) exp(doubt · b), by maximum likelihood; then the scales at each knot are
    multiplied by what makes the 68 and 95 % ellipsoids hold what they say.

    Args:
        doubt: Reasons for doubt, shape (N, reasons), the first of them 1.
        error_m: Errors on people left out, shape (N, knots, 3), metres; NaN where there is none.
        weight: How much each example counts, shape (N,).

    Returns:
        Coefficients b, shape (reasons, knots, 3), and degrees of freedom v.
    """
    rows = slice(None, None, max(1, len(doubt) // _ENOUGH_ROWS))
    everything = doubt, error_m, weight
    doubt, error_m, weight = doubt[rows], error_m[rows], weight[rows]
    known = np.isfinite(error_m[:, _KNOT]).all(axis=1)
    chosen = min(
        _DEGREES_OF_FREEDOM,
        key=lambda v: sum(
            _fit_one(doubt[known], error_m[known, _KNOT, axis], weight[known], v)[1] for axis in range(3)
        ),
    )
    coefficients = np.zeros((doubt.shape[1], *error_m.shape[1:]))
    for knot in range(error_m.shape[1]):
        for axis in range(3):
            known = np.isfinite(error_m[:, knot, axis])
            coefficients[:, knot, axis], _ = _fit_one(doubt[known], error_m[known, knot, axis], weight[known], chosen)
    return calibrate(coefficients, *everything, chosen), chosen


def calibrate(
    coefficients: FloatArray, doubt: FloatArray, error_m: FloatArray, weight: FloatArray, degrees_of_freedom: float
) -> FloatArray:
    """Scale the spread at each knot so that the worse of the 68 and 95 % ellipsoids is least wrong.

    Args:
        coefficients: Of the scale of each axis by itself, shape (reasons, knots, 3).
        doubt: Reasons for doubt, shape (N, reasons).
        error_m: Errors, shape (N, knots, 3), metres.
        weight: How much each example counts, shape (N,).
        degrees_of_freedom: Those of the t distribution.

    Returns:
        Coefficients of the scaled spread.
    """
    scaled = coefficients.copy()
    with np.errstate(invalid="ignore"):
        distance2 = np.sum((error_m / np.exp(np.tensordot(doubt, coefficients, axes=1))) ** 2, axis=-1)
    limits = 3.0 * f_distribution.ppf(_NOMINAL, 3, degrees_of_freedom)
    for knot in range(error_m.shape[1]):
        known = np.isfinite(distance2[:, knot]) & (weight > 0)
        if not known.any():
            continue
        inside = distance2[known, knot][:, None, None] <= (_SCALES**2)[:, None] * limits
        held = np.average(inside, axis=0, weights=weight[known])
        scaled[0, knot] += np.log(_SCALES[np.argmin(np.max(np.abs(held - _NOMINAL), axis=1))])
    return scaled


def _fit_one(u: FloatArray, e: FloatArray, weight: FloatArray, v: float) -> tuple[FloatArray, float]:
    """Coefficients, and the mean negative log likelihood."""
    start = np.zeros(u.shape[1])
    total = float(weight.sum())
    if not total > 0:
        return start, 0.0
    start[0] = np.log(max(float(np.sqrt(np.average(e**2, weights=weight))), _SMALLEST_M))
    prior = np.full(u.shape[1], _PRIOR_WEIGHT)
    prior[0] = 0.0
    # Of the t distribution's density: the parts that depend on v, too, so that tails can be compared.
    constant = float(gammaln(0.5 * v) - gammaln(0.5 * (v + 1.0)) + 0.5 * np.log(v))

    def cost(b: FloatArray) -> tuple[float, FloatArray]:
        log_scale = u @ b
        square = e**2 * np.exp(-2.0 * log_scale) / v
        value = float(np.sum(weight * (log_scale + 0.5 * (v + 1.0) * np.log1p(square))) + 0.5 * np.sum(prior * b**2))
        slope = u.T @ (weight * (1.0 - (v + 1.0) * square / (1.0 + square))) + prior * b
        return value / total, slope / total

    found = minimize(cost, start, jac=True, method="L-BFGS-B")
    return np.asarray(found.x), float(found.fun) + constant
