"""The stated uncertainty, fitted to errors: scales, tails and the ellipsoids that hold what they say."""

import numpy as np
import pytest
from builders.fits import toy
from builders.walkers import random_model
from scipy.stats import f as f_distribution

from experiments.fit.doubt import Found, errors_on_left_out, fit_doubt
from experiments.fit.spread import calibrate, fit_spread
from predictors.walker.network import KNOTS_S, N_DOUBT

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


@pytest.mark.parametrize(("true_v", "chosen"), [(5.0, {5.0, 6.0}), (8.0, {6.0, 8.0, 12.0}), (np.inf, {20.0})])
def test_scales_and_tails_are_recovered_and_ellipsoids_hold_what_they_say(true_v, chosen):
    """Errors drawn with a known dependence of their scale on the reasons for doubt."""
    rng, n = np.random.default_rng(0), 12000
    u = np.column_stack([np.ones(n), rng.uniform(0, 2, (n, 2))])
    true = np.array([np.log(0.05), 0.8, -0.3])
    scale = np.exp(u @ true)[:, None, None]
    error = t_errors(rng, n, scale, true_v)
    error[::7, 6:] = np.nan
    found, v = fit_spread(u, error, np.ones(n))
    assert v in chosen
    assert found.shape == (3, KNOTS, 3)
    np.testing.assert_allclose(found[1:], np.broadcast_to(true[1:, None, None], (2, KNOTS, 3)), atol=0.06)
    # A scale of other tails than the true ones is another number; what counts is what it holds.
    np.testing.assert_allclose(found[0], true[0], atol=0.06 if true_v < np.inf else 0.12)
    fresh = t_errors(rng, n, scale, true_v)
    np.testing.assert_allclose(held(fresh, np.exp(np.tensordot(u, found, axes=1)), v), (0.68, 0.95), atol=0.02)


def test_longer_tails_than_are_tried_still_hold_95_percent():
    """With three degrees of freedom the covariance would be made of the rarest errors; five are stated, and wider."""
    rng, u = np.random.default_rng(0), np.ones((12000, 1))
    found, v = fit_spread(u, t_errors(rng, 12000, 0.05, 3.0), np.ones(12000))
    assert v == 5.0
    inside = held(t_errors(rng, 12000, 0.05, 3.0), np.exp(found[0]), v)
    np.testing.assert_allclose(inside, (0.68, 0.95), atol=0.035)


def test_of_many_rows_those_in_between_tell_the_same():
    """Only every third row is read for the coefficients, and all for the ellipsoids."""
    rng, n = np.random.default_rng(2), 36000
    u = np.column_stack([np.ones(n), rng.uniform(0, 2, n)])
    scale = np.exp(u @ [np.log(0.05), 0.5])[:, None, None]
    found, v = fit_spread(u, t_errors(rng, n, scale, 6.0), np.ones(n))
    assert v in {5.0, 6.0, 8.0}
    np.testing.assert_allclose(found[1], 0.5, atol=0.06)
    inside = held(t_errors(rng, n, scale, 6.0), np.exp(np.tensordot(u, found, axes=1)), v)
    np.testing.assert_allclose(inside, (0.68, 0.95), atol=0.015)


def test_weights_count():
    """Two kinds of people with errors of 5 and 10 cm: whoever has the weight has the scale."""
    rng, n = np.random.default_rng(1), 4000
    error = np.concatenate([t_errors(rng, n, 0.05, 5.0), t_errors(rng, n, 0.1, 5.0)])
    weight = np.repeat([1.0, 1e-6], n)
    u = np.ones((2 * n, 1))
    for order, scale in ((1, 0.05), (-1, 0.1)):
        found, _ = fit_spread(u, error, weight[::order])
        np.testing.assert_allclose(np.exp(found), scale, rtol=0.12)


@pytest.mark.parametrize("stated", [0.07, 0.1, 0.16])
@pytest.mark.parametrize("v", [4.0, 20.0])
def test_calibration_scales_what_is_stated_too_small_or_too_large(stated, v):
    rng = np.random.default_rng(0)
    u, error = np.ones((20000, 1)), t_errors(rng, 20000, 0.1, v)
    coefficients = np.full((1, KNOTS, 3), np.log(stated))
    found = np.exp(calibrate(coefficients, u, error, np.ones(20000), v))
    np.testing.assert_allclose(found, 0.1, rtol=0.03)
    np.testing.assert_array_equal(coefficients, np.log(stated))


def test_calibration_is_bounded_and_where_nothing_is_known_it_changes_nothing():
    rng = np.random.default_rng(0)
    error = t_errors(rng, 2000, 1.0, 5.0)
    error[:, 7] = np.nan
    found = np.exp(calibrate(np.full((1, KNOTS, 3), np.log(0.1)), np.ones((2000, 1)), error, np.ones(2000), 5.0))
    np.testing.assert_allclose(found[0, :7], 0.2)
    np.testing.assert_allclose(found[0, 7], 0.1)


def test_with_tails_that_are_not_the_true_ones_the_worse_of_both_shares_is_least_wrong():
    """Errors of a mixture that no t distribution describes: both are missed by the same number of points."""
    rng = np.random.default_rng(0)
    wide = rng.random((40000, 1, 1)) < 0.2
    error = np.where(wide, 0.4, 0.1) * rng.standard_normal((40000, KNOTS, 3))
    u = np.ones((40000, 1))
    found = calibrate(np.full((1, KNOTS, 3), np.log(0.1)), u, error, np.ones(40000), 20.0)
    inside68, inside95 = held(error, np.exp(found[0]), 20.0)
    assert inside68 > 0.68
    assert inside95 < 0.95
    assert inside68 - 0.68 == pytest.approx(0.95 - inside95, abs=0.01)


def test_doubt_is_fitted_to_all_errors_that_were_found():
    """Through the table of errors of each recording, by the model that has not seen the person."""
    model = random_model()
    examples = [toy(300, seed) for seed in range(3)]
    found = errors_on_left_out({"ann": model, "bob": model}, ["ann", "bob", "ann"], examples)
    assert [f.weight.size for f in found] == [300] * 3
    said = model.answer(examples[1].network.astype(float), examples[1].spread.astype(float))
    np.testing.assert_allclose(found[1].doubt, said[1])
    np.testing.assert_allclose(found[1].error_m, said[0] - examples[1].departure_m)
    log_spread, v = fit_doubt(found)
    assert log_spread.shape == (N_DOUBT, KNOTS, 3)
    assert v > 2.0
    table = Found.join(found)
    scale = np.exp(np.tensordot(table.doubt, log_spread, axes=1))
    np.testing.assert_allclose(held(table.error_m, scale, v), (0.68, 0.95), atol=0.06)
