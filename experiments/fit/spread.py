"""Fit the uncertainty model of the predictor `walker` to forecast errors on people left out of the networks' fit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize
from scipy.special import digamma, gammaln
from scipy.stats import f as f_distribution

from experiments.fit.examples import Examples
from gazempc.types import FloatArray
from predictors.walker.network import WalkerModel

# Ridge penalties: coefficients of nearly constant features stay near zero, and the hidden units do not overfit single
# people.
_PRIOR_WEIGHT, _HIDDEN_PRIOR_WEIGHT = 1e-3, 1e-4
# Hidden units: a linear model gives too wide ellipsoids for one tracker, too narrow ones for another; 24 have no
# benefit.
_HIDDEN = 12
_STEPS = 250
_SMALLEST_M = 1e-4
_NOMINAL = np.array([0.68, 0.95])
_SCALES = np.exp(np.linspace(np.log(0.5), np.log(2.0), 141))
# Bounds of the degrees of freedom; below 5 the rarest errors dominate the covariance.
_DEGREES_OF_FREEDOM = (5.0, 20.0)
# Number of evenly spaced rows for the fit: errors of successive frames are correlated.
_ENOUGH_ROWS = 12_000
# Initial value of the observation error's share.
_FIRST_SHARE = 0.5


@dataclass(frozen=True)
class Spread:
    """Parameters of the uncertainty model, named as in `WalkerModel`."""

    log_spread: FloatArray
    hidden: FloatArray
    log_spread_hidden: FloatArray
    noise_share: FloatArray
    degrees_of_freedom: float

    def log_scale(self, doubt: FloatArray) -> FloatArray:
        """Logarithm of the scales without observation error, shape (N, knots, 3); `doubt` of shape (N, N_DOUBT)."""
        linear = np.tensordot(doubt, self.log_spread, axes=1)
        return np.asarray(linear + np.tensordot(np.tanh(doubt @ self.hidden), self.log_spread_hidden, axes=1))


@dataclass(frozen=True)
class Found:
    """Forecast errors, with the features of the uncertainty model.

    Attributes:
        doubt: Features of the uncertainty model, shape (N, N_DOUBT); the first is the constant 1.
        noise_m: Stated standard deviation of the observed position, shape (N, 3), metres; zeros if none is stated.
        error_m: Forecast error on people left out, shape (N, knots, 3), metres; NaN after the end of a walk.
        weight: Weight of each example, shape (N,).
    """

    doubt: FloatArray
    noise_m: FloatArray
    error_m: FloatArray
    weight: FloatArray

    @classmethod
    def by(cls, model: WalkerModel, part: Examples) -> Found:
        """Errors of a model on examples."""
        answers = []
        columns = (part.network, part.spread, part.places_m, part.velocities_m_s)
        for network, *of_track in zip(*(column.astype(np.float64) for column in columns), strict=True):
            answers.append(model.answer(model.outputs(network), *of_track))
        departure, doubt = map(np.array, zip(*answers, strict=True))
        noise_m, weight = part.noise_m.astype(np.float64), part.weight.astype(np.float64)
        return cls(doubt, noise_m, departure - part.departure_m, weight)


def fit_spread(found: Found) -> Spread:
    """Fit scale and degrees of freedom of a t distribution to errors.

    At each knot the errors have a t distribution with v degrees of freedom. Its scale on axis i is the root of
    exp(2 s_i) + (share noise_i)^2, with s = doubt · b + tanh(doubt · h) · c. All are fitted by penalised
    maximum likelihood; then `calibrate` scales them to the nominal coverage of the 68 and 95 % ellipsoids.

    Args:
        found: Forecast errors on people left out.

    Returns:
        The fitted parameters.
    """
    rows = slice(None, None, max(1, len(found.doubt) // _ENOUGH_ROWS))
    return calibrate(_maximum_likelihood(Found(*(part[rows] for part in vars(found).values()))), found)


def calibrate(spread: Spread, found: Found) -> Spread:
    """Scale the spread at each knot to minimise the larger coverage error of the 68 and 95 % ellipsoids.

    Args:
        spread: Fitted parameters.
        found: Forecast errors.

    Returns:
        The scaled spread.
    """
    variance = np.exp(2.0 * spread.log_scale(found.doubt))
    variance += spread.noise_share[:, None] ** 2 * found.noise_m[:, None] ** 2
    with np.errstate(invalid="ignore"):
        distance2 = np.sum(found.error_m**2 / variance, axis=-1)
    limits = 3.0 * f_distribution.ppf(_NOMINAL, 3, spread.degrees_of_freedom)
    log_spread, noise_share = spread.log_spread.copy(), spread.noise_share.copy()
    for knot in range(distance2.shape[1]):
        valid = np.isfinite(distance2[:, knot]) & (found.weight > 0)
        if not valid.any():
            continue
        inside = distance2[valid, knot][:, None, None] <= (_SCALES**2)[:, None] * limits
        coverage = np.average(inside, axis=0, weights=found.weight[valid])
        scale = _SCALES[np.argmin(np.max(np.abs(coverage - _NOMINAL), axis=1))]
        log_spread[0, knot] += np.log(scale)
        noise_share[knot] *= scale
    return replace(spread, log_spread=log_spread, noise_share=noise_share)


def _maximum_likelihood(errors: Found) -> Spread:
    doubt, knots = errors.doubt, errors.error_m.shape[1]
    # Standardised features, so that the penalties are comparable; the first is the constant.
    mean, sd = np.append(0.0, doubt[:, 1:].mean(axis=0)), np.append(1.0, doubt[:, 1:].std(axis=0) + 1e-6)
    likelihood = SpreadLikelihood(replace(errors, doubt=(doubt - mean) / sd))
    start, bounds = likelihood.start(), likelihood.bounds()
    found = minimize(likelihood, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": _STEPS})
    linear, hidden, out, log_share, v = likelihood.parts(found.x)
    for part in (linear, hidden):
        part[:] /= sd[:, None]
        part[0] -= mean @ part
    log_spread, of_hidden = (part.reshape(-1, knots, 3) for part in (linear, out))
    return Spread(log_spread, hidden, of_hidden, np.exp(log_share), float(v[0]))


class SpreadLikelihood:
    """Negative log-likelihood of forecast errors as a function of the parameters, with its gradient.

    Args:
        found: Forecast errors.
    """

    def __init__(self, found: Found) -> None:
        valid = np.asarray(np.isfinite(found.error_m).all(axis=2))
        self._u, self._noise2 = found.doubt, found.noise_m**2
        self._error2 = np.where(valid[..., None], found.error_m, 0.0) ** 2
        self._weight = valid * found.weight[:, None]
        self._weight /= max(float(self._weight.sum()), 1e-9)
        features, knots = found.doubt.shape[1], valid.shape[1]
        self._shapes = ((features, 3 * knots), (features, _HIDDEN), (_HIDDEN, 3 * knots), (knots,), (1,))

    def parts(self, x: FloatArray) -> list[FloatArray]:
        """Split into linear, hidden and output weights, log shares of the stated error, and degrees of freedom."""
        ends = np.cumsum([math.prod(shape) for shape in self._shapes])
        return [part.reshape(shape) for part, shape in zip(np.split(x, ends[:-1]), self._shapes, strict=True)]

    def start(self) -> FloatArray:
        """Initial parameters."""
        x = np.zeros(sum(math.prod(shape) for shape in self._shapes))
        linear, hidden, _, log_share, v = self.parts(x)
        total = np.maximum(self._weight.sum(axis=0), 1e-9)[:, None]
        mean2 = np.sum(self._weight[..., None] * self._error2, axis=0) / total
        linear[0] = 0.5 * np.log(np.maximum(mean2, _SMALLEST_M**2)).ravel()
        hidden[:] = np.random.default_rng(0).standard_normal(hidden.shape) / math.sqrt(len(hidden))
        log_share[:] = np.log(_FIRST_SHARE)
        v[:] = _DEGREES_OF_FREEDOM[0]
        return x

    def bounds(self) -> list[tuple[float | None, float | None]]:
        """Lower and upper bound of each parameter."""
        *free, shares, _ = (math.prod(shape) for shape in self._shapes)
        no_bounds: tuple[float | None, float | None] = (None, None)
        return [no_bounds] * sum(free) + [(-10.0, 3.0)] * shares + [_DEGREES_OF_FREEDOM]

    def __call__(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Weighted mean negative log-likelihood plus penalties, and its gradient."""
        linear, hidden, out, log_share, (v,) = self.parts(x)
        units = np.tanh(self._u @ hidden)
        own = np.exp(2.0 * (self._u @ linear + units @ out)).reshape(self._error2.shape)
        share2 = np.exp(2.0 * log_share)
        variance = own + share2[:, None] * self._noise2[:, None]
        ratio = self._error2 / variance
        distance2 = ratio.sum(axis=2)
        constant = gammaln(0.5 * v) - gammaln(0.5 * (v + 3.0)) + 1.5 * np.log(v)
        log_tails = np.log1p(distance2 / v)
        cost = 0.5 * np.log(variance).sum(axis=2) + 0.5 * (v + 3.0) * log_tails + constant
        # Derivatives with respect to variance, log scale and degrees of freedom.
        by_variance = (
            0.5 * self._weight[..., None] * (1.0 - ((v + 3.0) / (v + distance2))[..., None] * ratio) / variance
        )
        by_scale = (2.0 * by_variance * own).reshape(len(own), -1)
        by_v = 0.5 * log_tails - 0.5 * (v + 3.0) * distance2 / (v * (v + distance2))
        by_v += 0.5 * digamma(0.5 * v) - 0.5 * digamma(0.5 * (v + 3.0)) + 1.5 / v
        by_hidden = self._u.T @ ((by_scale @ out.T) * (1.0 - units**2))
        by_linear = self._u.T @ by_scale
        by_linear[1:] += 2.0 * _PRIOR_WEIGHT * linear[1:]
        gradient = (
            by_linear,
            by_hidden + 2.0 * _HIDDEN_PRIOR_WEIGHT * hidden,
            units.T @ by_scale + 2.0 * _PRIOR_WEIGHT * out,
            2.0 * share2 * np.einsum("nka,na->k", by_variance, self._noise2),
            np.sum(self._weight * by_v),
        )
        prior = _PRIOR_WEIGHT * (np.sum(linear[1:] ** 2) + np.sum(out**2)) + _HIDDEN_PRIOR_WEIGHT * np.sum(hidden**2)
        return float(np.sum(self._weight * cost) + prior), np.concatenate([np.ravel(g) for g in gradient])


def errors_on_left_out(
    left_out: Mapping[str, WalkerModel], people: Sequence[str], scoring: Sequence[Examples]
) -> list[Found]:
    """Errors on each recording by the model fitted without the person in it.

    Args:
        left_out: Model by the person left out of its fit.
        people: Person in each recording.
        scoring: Test examples of each recording.

    Returns:
        The errors, for each recording.
    """
    return [Found.by(left_out[person], part) for person, part in zip(people, scoring, strict=True)]
