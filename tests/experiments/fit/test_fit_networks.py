"""Networks of the predictor `walker`: they learn, and the same seed gives the same."""

import numpy as np
import pytest
from builders.fits import toy
from builders.walkers import straight_model

from experiments.fit.networks import fit_networks
from predictors.walker.features import N_INPUTS, OF_YAWS
from predictors.walker.network import KNOTS_S, WalkerModel


@pytest.mark.slow
def test_networks_learn_and_are_the_same_for_the_same_seed():
    examples, other = toy(4000, 0), toy(1000, 1)
    fits = [fit_networks(examples, 3, 1, 600) for _ in range(2)]
    for a, b in zip(fits[0][0], fits[1][0], strict=True):
        np.testing.assert_array_equal(a, b)
    weights, biases = fits[0]
    assert weights[-1].shape[-1] == 3 * KNOTS_S.size
    model = WalkerModel(weights, biases, weights, biases, straight_model().log_spread)
    error = model.answer(other.network.astype(float), other.spread.astype(float))[0] - other.departure_m
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
