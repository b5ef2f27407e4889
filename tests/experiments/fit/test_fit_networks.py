"""Networks of the predictor `walker`: they learn, and the same seed gives the same."""

import numpy as np
import pytest
from builders.fits import toy
from builders.walkers import random_covariance, straight_model

from experiments.fit.networks import fit_networks, seen_distance2
from predictors.walker.features import N_INPUTS, OF_YAWS
from predictors.walker.network import N_OUTPUTS, RegimeMotion, WalkerModel


@pytest.mark.slow
def test_networks_learn_and_are_the_same_for_the_same_seed():
    examples, other = toy(4000, 0), toy(1000, 1)
    fits = [fit_networks(examples, 3, 1, 600) for _ in range(2)]
    for a, b in zip(fits[0][0], fits[1][0], strict=True):
        np.testing.assert_array_equal(a, b)
    weights, biases = fits[0]
    assert weights[-1].shape[-1] == N_OUTPUTS
    model = WalkerModel(weights, biases, weights, biases, straight_model().log_spread)
    motion = RegimeMotion(other.line_m_s.astype(float), other.places_m.astype(float))
    regimes = model.regimes(other.network.astype(float), motion)
    error = model.answer(regimes, other.spread.astype(float))[0] - other.departure_m
    known = np.isfinite(error[:, 4, 1])
    assert np.mean(np.abs(error[known, 4, 1])) < 0.75 * np.mean(np.abs(other.departure_m[known, 4, 1]))


@pytest.mark.slow
def test_networks_that_see_no_yaws_have_no_weights_for_them():
    """Shown or hidden, what is said of head and pelvis changes nothing."""
    weights, _ = fit_networks(toy(500, 0), 3, 2, 20, sees_yaws=False)
    assert weights[0].shape[:2] == (2, N_INPUTS)
    hidden = np.zeros(N_INPUTS, dtype=bool)
    hidden[OF_YAWS] = True
    assert not weights[0][:, hidden].any()
    assert weights[0][:, ~hidden].any(axis=2).all()


def test_errors_that_a_tracker_cannot_see_count_less():
    """Against the inverse of the whole matrix."""
    rng = np.random.default_rng(0)
    off_m, usual_m2 = rng.standard_normal((20, 3, 3)), np.array([0.02, 0.08, 0.2]) ** 2
    noises_m2 = [np.pad(random_covariance(rng, (0.4, 0.01, 0.01))[:2, :2], (0, 1)) for _ in range(20)]
    up_m2 = rng.uniform(0.0, 0.1, 20)
    told = np.array([[n[0, 0], n[1, 1], n[0, 1], up] for n, up in zip(noises_m2, up_m2, strict=True)])
    found = seen_distance2(off_m, told, usual_m2)
    for i, noise_m2 in enumerate(noises_m2):
        noise_m2[2, 2] = up_m2[i]
        for k, usual in enumerate(usual_m2):
            expected = off_m[i, k] @ np.linalg.solve(np.eye(3) + noise_m2 / usual, off_m[i, k])
            np.testing.assert_allclose(found[i, k], expected, rtol=1e-9)
