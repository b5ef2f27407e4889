"""The stated uncertainty, fitted to errors: scales, tails and the ellipsoids that hold what they say."""

import numpy as np
import pytest
from builders.fits import toy
from builders.walkers import random_model
from scipy.optimize import approx_fprime
from scipy.stats import f as f_distribution

from experiments.fit.doubt import Found, errors_on_left_out, fit_doubt
from experiments.fit.spread import Spread, SpreadLikelihood, calibrate, fit_spread
from predictors.walker.network import KNOTS_S, N_DOUBT, RegimeMotion

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
    return np.zeros((n, 2, 3))


def shared2(shares, noise_m):
    """Variances by shares of the noise, as measured and as stated, shape (N, knots, 3)."""
    return sum((shares[k][:, None] * noise_m[:, k, None]) ** 2 for k in range(2))


def some_noise(rng, n):
    """From 1 to 100 mm, other on each axis and each frame; every third tracker states it, the others do not."""
    noise_m = no_noise(n)
    noise_m[np.arange(n), (np.arange(n) % 3 == 0).astype(int)] = np.exp(rng.uniform(np.log(0.001), np.log(0.1), (n, 3)))
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


def test_what_is_not_linear_in_the_reasons_is_found_by_the_hidden_units():
    """Doubt is high where either of two reasons holds, but not where both do: no linear formula says that."""
    rng, n = np.random.default_rng(0), 4000
    u = np.column_stack([np.ones(n), rng.integers(0, 2, (n, 2))])
    scale = np.where(u[:, 1] != u[:, 2], 0.1, 0.03)[:, None, None]
    found = fit_spread(u, no_noise(n), t_errors(rng, n, scale, 6.0), np.ones(n))
    np.testing.assert_allclose(found.log_scale(u) - np.log(scale), 0.0, atol=0.15)


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


@pytest.mark.slow
@pytest.mark.parametrize("share", [(0.3, 0.9), (0.8, 0.4), (1.5, 1.5)])
def test_the_shares_of_the_noise_are_recovered_at_each_knot(share):
    """Of measured and of stated noise, each its own; they fall with the horizon."""
    rng, n = np.random.default_rng(0), 6000
    u = np.column_stack([np.ones(n), rng.uniform(0, 2, n)])
    noise_m = some_noise(rng, n)
    shares = np.outer(share, np.linspace(1.0, 0.5, KNOTS))
    own = np.exp(u @ [np.log(0.01), 0.5])[:, None, None] * np.ones((1, KNOTS, 3))
    scale = np.sqrt(own**2 + shared2(shares, noise_m))
    found = fit_spread(u, noise_m, t_errors(rng, n, scale, 6.0), np.ones(n))
    assert 5.0 <= found.degrees_of_freedom <= 8.0
    np.testing.assert_allclose(found.noise_share, shares, rtol=0.08, atol=0.01)
    np.testing.assert_allclose(found.log_scale(u) - np.log(own), 0.0, atol=0.25)
    inside = held(t_errors(rng, n, scale, 6.0), stated(found, u, noise_m), found.degrees_of_freedom)
    np.testing.assert_allclose(inside, (0.68, 0.95), atol=0.02)


@pytest.mark.slow
def test_noise_that_is_in_no_error_has_no_share():
    """Errors of 10 cm, whatever the noise up to 10 cm: a share adds next to nothing to the scale, at the worst 6 %."""
    rng, n = np.random.default_rng(0), 6000
    noise_m = some_noise(rng, n)
    found = fit_spread(np.ones((n, 1)), noise_m, t_errors(rng, n, 0.1, 6.0), np.ones(n))
    assert found.noise_share.max() < 0.35
    assert np.median(found.noise_share) < 0.1
    np.testing.assert_allclose(np.exp(found.log_spread[0]), 0.1, rtol=0.08)


def test_longer_tails_than_are_tried_still_hold_95_percent():
    """With three degrees of freedom the covariance would be made of the rarest errors; five are stated, and wider."""
    rng, u = np.random.default_rng(0), np.ones((4000, 1))
    found = fit_spread(u, no_noise(4000), t_errors(rng, 4000, 0.05, 3.0), np.ones(4000))
    assert found.degrees_of_freedom == 5.0
    inside = held(t_errors(rng, 12000, 0.05, 3.0), np.exp(found.log_spread[0]), 5.0)
    np.testing.assert_allclose(inside, (0.68, 0.95), atol=0.035)


@pytest.mark.slow
def test_of_many_rows_those_in_between_tell_the_same():
    """Only every third row is read for the coefficients, and all for the ellipsoids."""
    rng, n = np.random.default_rng(2), 36000
    u = np.column_stack([np.ones(n), rng.uniform(0, 2, n)])
    scale = np.exp(u @ [np.log(0.05), 0.5])[:, None, None]
    found = fit_spread(u, no_noise(n), t_errors(rng, n, scale, 6.0), np.ones(n))
    assert 5.0 <= found.degrees_of_freedom <= 8.0
    np.testing.assert_allclose(found.log_scale(u) - np.log(scale), 0.0, atol=0.12)
    inside = held(t_errors(rng, n, scale, 6.0), stated(found, u, no_noise(n)), found.degrees_of_freedom)
    np.testing.assert_allclose(inside, (0.68, 0.95), atol=0.015)


@pytest.mark.slow
def test_weights_count():
    """Two kinds of people with errors of 5 and 10 cm: whoever has the weight has the scale."""
    rng, n = np.random.default_rng(1), 4000
    error = np.concatenate([t_errors(rng, n, 0.05, 5.0), t_errors(rng, n, 0.1, 5.0)])
    weight = np.repeat([1.0, 1e-6], n)
    u = np.ones((2 * n, 1))
    for order, scale in ((1, 0.05), (-1, 0.1)):
        found = fit_spread(u, no_noise(2 * n), error, weight[::order])
        np.testing.assert_allclose(np.exp(found.log_spread), scale, rtol=0.12)


def same_for_all(scale_m, v, share=0.0):
    unhidden = np.zeros((1, 0)), np.zeros((0, KNOTS, 3))
    return Spread(np.full((1, KNOTS, 3), np.log(scale_m)), *unhidden, np.full((2, KNOTS), share), v)


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


@pytest.mark.parametrize("factor", [0.7, 1.0, 1.6])
def test_calibration_scales_the_share_of_the_noise_as_well(factor):
    """So that long and short axes of the ellipsoid keep their ratio."""
    rng, n = np.random.default_rng(0), 20000
    noise_m = no_noise(n)
    noise_m[: n // 2, 0] = noise_m[n // 2 :, 1] = [0.2, 0.01, 0.01]
    error = t_errors(rng, n, np.sqrt(0.05**2 + shared2(np.full((2, KNOTS), 0.5), noise_m)), 6.0)
    before = same_for_all(0.05 * factor, 6.0, 0.5 * factor)
    found = calibrate(before, np.ones((n, 1)), noise_m, error, np.ones(n))
    np.testing.assert_allclose(np.exp(found.log_spread), 0.05, rtol=0.03)
    np.testing.assert_allclose(found.noise_share, 0.5, rtol=0.03)
    np.testing.assert_array_equal(before.noise_share, 0.5 * factor)


def test_calibration_is_bounded_and_where_nothing_is_known_it_changes_nothing():
    rng = np.random.default_rng(0)
    error = t_errors(rng, 2000, 1.0, 5.0)
    error[:, 7] = np.nan
    found = calibrate(same_for_all(0.1, 5.0, 0.3), np.ones((2000, 1)), no_noise(2000), error, np.ones(2000))
    np.testing.assert_allclose(np.exp(found.log_spread[0, :7]), 0.2)
    np.testing.assert_allclose(np.exp(found.log_spread[0, 7]), 0.1)
    np.testing.assert_allclose(found.noise_share, 2 * [[*7 * [0.6], 0.3]])


def test_with_tails_that_are_not_the_true_ones_the_worse_of_both_shares_is_least_wrong():
    """Errors of a mixture that no t distribution describes: both are missed by the same number of points."""
    rng = np.random.default_rng(0)
    wide = rng.random((40000, 1, 1)) < 0.2
    error = np.where(wide, 0.4, 0.1) * rng.standard_normal((40000, KNOTS, 3))
    u = np.ones((40000, 1))
    found = calibrate(same_for_all(0.1, 20.0), u, no_noise(40000), error, np.ones(40000))
    inside68, inside95 = held(error, np.exp(found.log_spread[0]), 20.0)
    assert inside68 > 0.68
    assert inside95 < 0.95
    assert inside68 - 0.68 == pytest.approx(0.95 - inside95, abs=0.01)


def test_doubt_is_fitted_to_all_errors_that_were_found():
    """Through the table of errors of each recording, by the model that has not seen the person."""
    model = random_model()
    examples = [toy(300, seed) for seed in range(3)]
    found = errors_on_left_out({"ann": model, "bob": model}, ["ann", "bob", "ann"], examples)
    assert [f.weight.size for f in found] == [300] * 3
    motion = RegimeMotion(examples[1].line_m_s.astype(float), examples[1].places_m.astype(float))
    said = model.answer(examples[1].network.astype(float), examples[1].spread.astype(float), motion)
    np.testing.assert_allclose(found[1].doubt, said[1])
    np.testing.assert_allclose(found[1].error_m, said[0] - examples[1].departure_m)
    np.testing.assert_array_equal(found[1].noise_m, examples[1].noise_m)
    fitted = fit_doubt(found)
    assert fitted.log_spread.shape == (N_DOUBT, KNOTS, 3)
    assert fitted.noise_share.shape == (2, KNOTS)
    assert fitted.degrees_of_freedom > 2.0
    table = Found.join(found)
    scale = stated(fitted, table.doubt, table.noise_m)
    np.testing.assert_allclose(held(table.error_m, scale, fitted.degrees_of_freedom), (0.68, 0.95), atol=0.06)
