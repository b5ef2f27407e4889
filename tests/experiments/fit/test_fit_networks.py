"""Networks of the predictor `walker`, and its uncertainty model fitted to errors."""

import numpy as np
import pytest
from builders.fits import toy
from builders.walkers import random_covariance, straight_model
from scipy.optimize import approx_fprime
from scipy.special import softmax
from scipy.stats import f as f_distribution

from experiments.fit.command import FitSettings
from experiments.fit.networks import HIDDEN, fit_network, model_of, seen_distance2
from experiments.fit.spread import Found, Spread, SpreadLikelihood, calibrate, fit_spread
from predictors.walker.features import N_INPUTS, OF_YAWS
from predictors.walker.knots import KNOTS_S
from predictors.walker.network import N_OUTPUTS, PLACES, TRANSIENT_S, VELOCITIES, WALKS, WalkerModel, load_walker_model


@pytest.mark.slow
def test_fits_reduce_error_and_are_reproducible_and_blind_ones_ignore_yaws():
    """Orientation inputs of head and pelvis have no effect on blind networks."""
    examples, other = toy(2000, 0), toy(1000, 1)
    blind, again = (fit_network(examples, 3, 80, sees_yaws=False) for _ in range(2))
    np.testing.assert_equal(vars(blind), vars(again))
    first = blind.weights[0]
    assert (len(first), blind.weights[-1].shape[-1]) == (N_INPUTS, N_OUTPUTS)
    hidden = np.zeros(N_INPUTS, dtype=bool)
    hidden[OF_YAWS] = True
    assert not first[hidden].any()
    assert first[~hidden].any(axis=1).all()
    model = WalkerModel(blind, blind, straight_model().log_spread)
    error = Found.by(model, other).error_m
    known = np.isfinite(error[:, 4, 1])
    assert np.mean(np.abs(error[known, 4, 1])) < 0.5 * np.mean(np.abs(other.departure_m[known, 4, 1]))


@pytest.mark.slow
def test_the_fit_recovers_the_place_to_which_people_return_exponentially():
    """People at rest return over 0.6 of the way to one of the places with a time constant of 0.5 s.

    A weight of 0.6 of the regime of staying is equivalent, so the product of both is recovered.
    """
    examples = toy(2000, 0)
    examples.places_m[:, 1] = np.random.default_rng(2).normal(0.0, 0.2, (2000, 3))
    examples.departure_m[:] = 0.6 * (1.0 - np.exp(-KNOTS_S / 0.5))[:, None] * examples.places_m[:, 1:2]
    fitted = fit_network(examples, 0, 500)
    outputs = np.array([fitted(network)[0] for network in examples.network.astype(float)])
    logits, stays = outputs[:, PLACES], 1.0 / (1.0 + np.exp(outputs[:, WALKS]))
    # The return of the forecast to the same place has another profile.
    place_m = np.einsum("np,npc->nc", softmax(logits, axis=1), examples.places_m)
    share = np.sum(stays[:, None] * place_m * examples.places_m[:, 1]) / np.sum(examples.places_m[:, 1] ** 2)
    assert share == pytest.approx(0.6, abs=0.03)


@pytest.mark.slow
def test_the_fit_recovers_the_initial_velocity_in_the_regime_of_staying():
    """People at one place, with 0.8 of the velocity of one of the filters as initial velocity; the line moves."""
    examples = toy(2000, 0)
    examples.velocities_m_s[:, [0, 3]] = np.random.default_rng(2).normal(0.0, 0.3, (2000, 2, 3))
    line_m_s, filter_m_s = examples.velocities_m_s[:, [0]], examples.velocities_m_s[:, [3]]
    examples.departure_m[:] = 0.8 * TRANSIENT_S[:, None] * filter_m_s - KNOTS_S[:, None] * line_m_s
    fitted = fit_network(examples, 0, 500)
    outputs = np.array([fitted(network)[0] for network in examples.network.astype(float)])
    assert np.mean(1.0 / (1.0 + np.exp(outputs[:, WALKS]))) > 0.97
    assert np.mean(softmax(outputs[:, VELOCITIES], axis=1)[:, 3]) == pytest.approx(0.8, abs=0.03)


def test_the_shipped_model_has_the_settings_and_the_decision_of_a_fit_by_default():
    shipped = load_walker_model()
    assert {"variants", "steps", "seed"} == shipped.about["settings"].keys()
    for name, value in shipped.about["settings"].items():
        assert FitSettings.model_fields[name].default == value, name
    again = model_of([shipped.seeing.arrays(), shipped.blind.arrays()], "")
    assert again.decision == shipped.decision
    for name in ("seeing", "blind"):
        np.testing.assert_equal(vars(getattr(again, name)), vars(getattr(shipped, name)))
        assert tuple(b.size for b in getattr(shipped, name).biases[:-1]) == HIDDEN


def test_errors_are_weighted_by_the_inverse_covariance():
    """Compared with the inverse of the full covariance."""
    rng = np.random.default_rng(0)
    off_m, usual_m2 = rng.standard_normal((20, 3, 3)), np.array([0.02, 0.08, 0.2]) ** 2
    noises_m2 = [np.pad(random_covariance(rng, (0.4, 0.01, 0.01))[:2, :2], (0, 1)) for _ in range(20)]
    up_m2 = rng.uniform(0.0, 0.1, 20)
    stated = np.array([[n[0, 0], n[1, 1], n[0, 1], up] for n, up in zip(noises_m2, up_m2, strict=True)])
    found = seen_distance2(off_m, stated, usual_m2)
    for i, noise_m2 in enumerate(noises_m2):
        noise_m2[2, 2] = up_m2[i]
        for k, usual in enumerate(usual_m2):
            expected = off_m[i, k] @ np.linalg.solve(np.eye(3) + noise_m2 / usual, off_m[i, k])
            np.testing.assert_allclose(found[i, k], expected, rtol=1e-9)


KNOTS = KNOTS_S.size


def t_errors(rng, n, scale, v):
    """Errors of a multivariate t distribution at each knot, shape (n, knots, 3)."""
    normal = rng.standard_normal((n, KNOTS, 3))
    tails = 1.0 if v == np.inf else np.sqrt(rng.chisquare(v, (n, KNOTS, 1)) / v)
    return scale * normal / tails


def held(error, scale, v):
    """Empirical coverage of the 68 and 95 % ellipsoids."""
    distance2 = np.sum((error / scale) ** 2, axis=-1)
    distance2 = distance2[np.isfinite(distance2)]
    return [float(np.mean(distance2 <= 3 * f_distribution.ppf(share, 3, v))) for share in (0.68, 0.95)]


def some_noise(rng, n):
    """Noise from 1 to 100 mm, varying by axis and frame; stated for every third tracker."""
    noise_m = np.zeros((n, 3))
    noise_m[::3] = np.exp(rng.uniform(np.log(0.001), np.log(0.1), noise_m[::3].shape))
    return noise_m


@pytest.mark.slow
@pytest.mark.parametrize(("true_v", "chosen"), [(6.0, (5.0, 7.0)), (np.inf, (19.9, 20.0))])
def test_scales_and_tails_are_recovered_with_nominal_coverage(true_v, chosen):
    """Errors whose scale depends in a known way on the features of the uncertainty model, with an ideal tracker."""
    rng, n = np.random.default_rng(0), 4000
    u = np.column_stack([np.ones(n), rng.uniform(0, 2, (n, 2))])
    true = np.array([np.log(0.05), 0.8, -0.3])
    scale = np.exp(u @ true)[:, None, None]
    error = t_errors(rng, n, scale, true_v)
    error[::7, 6:] = np.nan
    found = fit_spread(Found(u, np.zeros((n, 3)), error, np.ones(n)))
    assert chosen[0] <= found.degrees_of_freedom <= chosen[1]
    assert found.log_spread.shape == (3, KNOTS, 3)
    assert found.log_spread_hidden.shape == (found.hidden.shape[1], KNOTS, 3)
    # With other degrees of freedom the scale differs; the coverage must hold.
    off = found.log_scale(u) - np.log(scale)
    assert np.abs(np.mean(off)) < (0.06 if true_v < np.inf else 0.12)
    assert np.std(off) < 0.08
    fresh = t_errors(rng, n, scale, true_v)
    inside = held(fresh, np.exp(found.log_scale(u)), found.degrees_of_freedom)
    np.testing.assert_allclose(inside, (0.68, 0.95), atol=0.025)


def test_the_likelihood_gradient_equals_finite_differences():
    rng = np.random.default_rng(0)
    u = np.column_stack([np.ones(40), rng.standard_normal((40, 2))])
    error = t_errors(rng, 40, 0.05, 5.0)
    error[3:9, 2] = np.nan
    likelihood = SpreadLikelihood(Found(u, some_noise(rng, 40), error, rng.uniform(0.5, 2.0, 40)))
    x = likelihood.start()
    x += 0.1 * rng.standard_normal(x.size)
    x[-1] = 6.3
    expected = approx_fprime(x, lambda at: likelihood(at)[0], 1e-6)
    np.testing.assert_allclose(likelihood(x)[1], expected, atol=2e-6)


@pytest.mark.parametrize(("scale_m", "v"), [(0.07, 4.0), (0.16, 20.0)])
def test_calibration_corrects_too_small_and_too_large_scales(scale_m, v):
    rng = np.random.default_rng(0)
    u, error = np.ones((8000, 1)), t_errors(rng, 8000, 0.1, v)
    nothing_hidden = np.zeros((1, 0)), np.zeros((0, KNOTS, 3))
    before = Spread(np.full((1, KNOTS, 3), np.log(scale_m)), *nothing_hidden, np.zeros(KNOTS), v)
    found = calibrate(before, Found(u, np.zeros((8000, 3)), error, np.ones(8000)))
    np.testing.assert_allclose(np.exp(found.log_spread), 0.1, rtol=0.04)
    assert found.degrees_of_freedom == v
    np.testing.assert_array_equal(before.log_spread, np.log(scale_m))
