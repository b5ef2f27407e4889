"""Fit how far the predictor `walker` errs, on people that its networks have not seen."""

from __future__ import annotations

from dataclasses import dataclass

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
# Share of an observation's error in a forecast, before it is fitted.
_FIRST_SHARE = 0.5


@dataclass(frozen=True)
class Spread:
    """The stated uncertainty of a `WalkerModel`, field by field."""

    log_spread: FloatArray
    noise_share: FloatArray
    degrees_of_freedom: float


def fit_spread(doubt: FloatArray, noise_m: FloatArray, error_m: FloatArray, weight: FloatArray) -> Spread:
    """Fit scales and tails of a t distribution to errors.

    At each knot: error on axis i ~ t(v) times the root of (exp(2 doubt · b_i) + sum of (share noise_i)^2), by
    maximum likelihood; then the scales are multiplied by what makes the 68 and 95 % ellipsoids hold what they say.

    Args:
        doubt: Reasons for doubt, shape (N, reasons), the first of them 1.
        noise_m: Standard deviation of the observed position, as measured and as stated, shape (N, 2, 3), metres.
        error_m: Errors on people left out, shape (N, knots, 3), metres; NaN where there is none.
        weight: How much each example counts, shape (N,).

    Returns:
        The fitted numbers.
    """
    rows = slice(None, None, max(1, len(doubt) // _ENOUGH_ROWS))
    thin = doubt[rows], noise_m[rows], error_m[rows], weight[rows]
    tails = {v: _fit_knot(*thin, _KNOT, v)[2] for v in _DEGREES_OF_FREEDOM}
    v = min(tails, key=lambda tail: tails[tail])
    knots = [_fit_knot(*thin, knot, v)[:2] for knot in range(error_m.shape[1])]
    spread = Spread(np.stack([b for b, _ in knots], axis=1), np.stack([share for _, share in knots], axis=1), v)
    return calibrate(spread, doubt, noise_m, error_m, weight)


def calibrate(
    spread: Spread, doubt: FloatArray, noise_m: FloatArray, error_m: FloatArray, weight: FloatArray
) -> Spread:
    """Scale the spread at each knot so that the worse of the 68 and 95 % ellipsoids is least wrong.

    Args:
        spread: As fitted.
        doubt: Reasons for doubt, shape (N, reasons).
        noise_m: Standard deviation of the observed position, shape (N, 2, 3), metres.
        error_m: Errors, shape (N, knots, 3), metres.
        weight: How much each example counts, shape (N,).

    Returns:
        The scaled spread.
    """
    variance = np.exp(2.0 * np.tensordot(doubt, spread.log_spread, axes=1))
    variance += np.einsum("sk,nsa->nka", spread.noise_share**2, noise_m**2)
    with np.errstate(invalid="ignore"):
        distance2 = np.sum(error_m**2 / variance, axis=-1)
    limits = 3.0 * f_distribution.ppf(_NOMINAL, 3, spread.degrees_of_freedom)
    log_spread, noise_share = spread.log_spread.copy(), spread.noise_share.copy()
    for knot in range(error_m.shape[1]):
        known = np.isfinite(distance2[:, knot]) & (weight > 0)
        if not known.any():
            continue
        inside = distance2[known, knot][:, None, None] <= (_SCALES**2)[:, None] * limits
        held = np.average(inside, axis=0, weights=weight[known])
        scale = _SCALES[np.argmin(np.max(np.abs(held - _NOMINAL), axis=1))]
        log_spread[0, knot] += np.log(scale)
        noise_share[:, knot] *= scale
    return Spread(log_spread, noise_share, spread.degrees_of_freedom)


def _fit_knot(
    doubt: FloatArray, noise_m: FloatArray, error_m: FloatArray, weight: FloatArray, knot: int, v: float
) -> tuple[FloatArray, FloatArray, float]:
    """Coefficients, shape (reasons, 3), shares of the noises, shape (2,), and the mean negative log likelihood."""
    known = np.isfinite(error_m[:, knot]).all(axis=1) & (weight > 0)
    u, w, e2, n2 = doubt[known], weight[known, None], error_m[known, knot] ** 2, noise_m[known] ** 2
    reasons = u.shape[1]
    start = np.zeros(3 * reasons + 2)
    if not known.any():
        return start[:-2].reshape(reasons, 3), np.zeros(2), 0.0
    start[:3] = 0.5 * np.log(np.maximum(np.average(e2, axis=0, weights=w[:, 0]), _SMALLEST_M**2))
    start[-2:] = np.log(_FIRST_SHARE)
    prior = np.full(3 * reasons, _PRIOR_WEIGHT)
    prior[:3] = 0.0
    total = float(w.sum())
    # Of the t distribution's density: the parts that depend on v, too, so that tails can be compared.
    constant = 3.0 * float(gammaln(0.5 * v) - gammaln(0.5 * (v + 1.0)) + 0.5 * np.log(v))

    def cost(x: FloatArray) -> tuple[float, FloatArray]:
        own = np.exp(2.0 * (u @ x[:-2].reshape(reasons, 3)))
        noises = np.exp(2.0 * x[-2:])[:, None] * n2
        variance = own + noises.sum(axis=1)
        square = e2 / variance / v
        value = float(np.sum(w * (0.5 * np.log(variance) + 0.5 * (v + 1.0) * np.log1p(square))))
        # Slope by the logarithm of the variance.
        slope = 0.5 * w * (1.0 - (v + 1.0) * square / (1.0 + square)) / variance
        value += 0.5 * float(np.sum(prior * x[:-2] ** 2))
        to_noises = 2.0 * np.einsum("na,nsa->s", slope, noises)
        gradient = np.append((u.T @ (2.0 * slope * own)).ravel() + prior * x[:-2], to_noises)
        return value / total, gradient / total

    bounds = [(None, None)] * (3 * reasons) + [(-10.0, 3.0)] * 2
    found = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds)
    return found.x[:-2].reshape(reasons, 3), np.exp(found.x[-2:]), float(found.fun) + constant
