"""The filter's likelihood is the density of the normal distribution that the process has."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from gazempc.identify.tracker.likelihood import Stretches, likelihood

TIMES_S = np.array([0.0, 0.03, 0.07, 0.1, 0.25, 0.28, 0.6])
VALUES = np.array([0.02, 0.05, -0.01, 0.03, 0.06, 0.04, 0.2])
Q, WHITE, SLOW, TAU, SCALE_M = 0.7, 0.02, 0.05, 0.3, 2.0


def one_stretch(used=None):
    values = np.tile(VALUES[:, None, None], (1, 1, 1))
    used = np.ones((VALUES.size, 1), dtype=bool) if used is None else used[:, None]
    return Stretches(np.diff(TIMES_S, prepend=0.0)[:, None], values, used, np.array([SCALE_M]))


def model(white=WHITE):
    return np.array([[[Q], [white], [SLOW], [TAU]]])


def covariance():
    """Of the measurements, from the integrals of the process, without a filter."""
    s, t = np.meshgrid(TIMES_S, TIMES_S)
    first, last = np.minimum(s, t), np.maximum(s, t)
    driven = (Q / SCALE_M) ** 2 * (first**2 * last / 2.0 - first**3 / 6.0)
    start = 1.0 + (1.0 / SCALE_M) ** 2 * s * t
    return driven + start + SLOW**2 * np.exp(-np.abs(s - t) / TAU) + WHITE**2 * np.eye(TIMES_S.size)


@pytest.mark.parametrize("left_out", [[], [2, 5]])
def test_likelihood_is_the_density_of_the_measurements_that_are_used(left_out):
    used = ~np.isin(np.arange(VALUES.size), left_out)
    rest = np.flatnonzero(used)
    normal = multivariate_normal(np.full(rest.size, VALUES[0]), covariance()[np.ix_(rest, rest)])
    assert likelihood(one_stretch(used), model())[0].item() == pytest.approx(normal.logpdf(VALUES[rest]), rel=1e-9)


def test_gate_leaves_a_spike_out():
    values = VALUES.copy()
    values[3] += 5.0
    spiked = Stretches(one_stretch().intervals_s, values[:, None, None], one_stretch().used, np.array([SCALE_M]))
    kept, normalised = likelihood(spiked, model(), gate=4.5)
    without, _ = likelihood(one_stretch(np.arange(7) != 3), model())
    assert np.abs(normalised[3]).item() > 4.5
    assert kept.item() == pytest.approx(without.item())
