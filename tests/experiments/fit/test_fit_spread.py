"""The stated uncertainty, fitted to errors: scales, tails and the ellipsoids that hold what they say."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from scipy.stats import f as f_distribution

from experiments.fit.spread import Spread, SpreadLikelihood, calibrate, fit_spread
from predictors.walker.network import KNOTS_S

KNOTS = KNOTS_S.size


def t_errors(rng, n, scale, v):
    """Errors of a multivariate t distribution at each knot, shape (n, knots, 3)."""
    normal = rng.standard_normal((n, KNOTS, 3))
    tails = 1.0 if v == np.inf else np.sqrt(rng.chisquare(v, (n, KNOTS, 1)) / v)
    return scale * normal / tails


def held(error, scale, v):
    """Shares of errors inside the ellipsoids that should hold 68 and 95 %."""
    distance2 = np.sum((error / scale) ** 2, axis=-1)
    distance2 = distance2[np.isfinite(distance2)]
    return [float(np.mean(distance2 <= 3 * f_distribution.ppf(share, 3, v))) for share in (0.68, 0.95)]


def no_noise(n):
    return np.zeros((n, 3))


def shared2(shares, noise_m):
    """Variances by shares of the stated error, shape (N, knots, 3)."""
    return (shares[:, None] * noise_m[:, None]) ** 2


def some_noise(rng, n):
    """From 1 to 100 mm, other on each axis and each frame; every third tracker states it, the others do not."""
    noise_m = no_noise(n)
    noise_m[::3] = np.exp(rng.uniform(np.log(0.001), np.log(0.1), noise_m[::3].shape))
    return noise_m


def stated(found, u, noise_m):
    """Scales by what was fitted, shape (N, knots, 3)."""
    return np.sqrt(np.exp(2.0 * found.log_scale(u)) + shared2(found.noise_share, noise_m))


@pytest.mark.slow
@pytest.mark.parametrize(("true_v", "chosen"), [(6.0, (5.0, 7.0)), (9.0, (7.0, 12.0)), (np.inf, (19.9, 20.0))])
def test_scales_and_tails_are_recovered_and_ellipsoids_hold_what_they_say(true_v, chosen):
    """Errors drawn with a known dependence of their scale on the reasons for doubt, through a tracker without error."""
    rng, n = np.random.default_rng(0), 4000
    u = np.column_stack([np.ones(n), rng.uniform(0, 2, (n, 2))])
    true = np.array([np.log(0.05), 0.8, -0.3])
    scale = np.exp(u @ true)[:, None, None]
    error = t_errors(rng, n, scale, true_v)
    error[::7, 6:] = np.nan
    found = fit_spread(u, no_noise(n), error, np.ones(n))
    assert chosen[0] <= found.degrees_of_freedom <= chosen[1]
    assert found.log_spread.shape == (3, KNOTS, 3)
    assert found.log_spread_hidden.shape == (found.hidden.shape[1], KNOTS, 3)
    # A scale of other tails than the true ones is another number; what counts is what it holds.
    off = found.log_scale(u) - np.log(scale)
    assert np.abs(np.mean(off)) < (0.06 if true_v < np.inf else 0.12)
    assert np.std(off) < 0.08
    fresh = t_errors(rng, n, scale, true_v)
    inside = held(fresh, stated(found, u, no_noise(n)), found.degrees_of_freedom)
    np.testing.assert_allclose(inside, (0.68, 0.95), atol=0.025)


def test_the_gradient_of_the_likelihood_is_its_slope():
    rng = np.random.default_rng(0)
    u = np.column_stack([np.ones(40), rng.standard_normal((40, 2))])
    error = t_errors(rng, 40, 0.05, 5.0)
    error[3:9, 2] = np.nan
    likelihood = SpreadLikelihood(u, some_noise(rng, 40), error, rng.uniform(0.5, 2.0, 40))
    x = likelihood.start()
    x += 0.1 * rng.standard_normal(x.size)
    x[-1] = 6.3
    expected = approx_fprime(x, lambda at: likelihood(at)[0], 1e-6)
    np.testing.assert_allclose(likelihood(x)[1], expected, atol=2e-6)


def same_for_all(scale_m, v, share=0.0):
    unhidden = np.zeros((1, 0)), np.zeros((0, KNOTS, 3))
    return Spread(np.full((1, KNOTS, 3), np.log(scale_m)), *unhidden, np.full(KNOTS, share), v)


@pytest.mark.parametrize("said", [0.07, 0.1, 0.16])
@pytest.mark.parametrize("v", [4.0, 20.0])
def test_calibration_scales_what_is_stated_too_small_or_too_large(said, v):
    rng = np.random.default_rng(0)
    u, error = np.ones((20000, 1)), t_errors(rng, 20000, 0.1, v)
    before = same_for_all(said, v)
    found = calibrate(before, u, no_noise(20000), error, np.ones(20000))
    np.testing.assert_allclose(np.exp(found.log_spread), 0.1, rtol=0.03)
    assert found.degrees_of_freedom == v
    np.testing.assert_array_equal(before.log_spread, np.log(said))
