"""Stated shares against errors that were drawn from the stated distribution."""

import numpy as np
import pytest
from scipy.stats import multivariate_t

from gazempc.results.forecast_metrics import inside, squared_radius

SHARES = (0.68, 0.90, 0.95)
SPREAD = np.array([[0.01, 0.004, 0.0], [0.004, 0.04, 0.001], [0.0, 0.001, 0.0025]])
DRAWS = 40_000


def errors_of(freedom):
    """Errors of covariance SPREAD, normal or with the tails of a t distribution."""
    rng = np.random.default_rng(0)
    if np.isinf(freedom):
        return rng.multivariate_normal(np.zeros(3), SPREAD, size=DRAWS)
    return multivariate_t(np.zeros(3), SPREAD * (freedom - 2.0) / freedom, df=freedom, seed=rng).rvs(DRAWS)


def nees_of(freedom):
    errors = errors_of(freedom)
    return np.einsum("ni,ij,nj->n", errors, np.linalg.inv(SPREAD), errors)


@pytest.mark.parametrize("freedom", [2.5, 4.0, 10.0, np.inf])
@pytest.mark.parametrize("share", SHARES)
def test_of_errors_as_stated_the_stated_share_is_inside(freedom, share):
    assert np.mean(inside(nees_of(freedom), np.full(DRAWS, freedom), share)) == pytest.approx(share, abs=0.007)


def test_long_tails_that_are_not_stated_are_seen():
    """Errors of t with 3 degrees of freedom, taken for normal: more than 68 % near, fewer than 99 % not far."""
    nees = nees_of(3.0)
    normal = np.full(DRAWS, np.inf)
    assert np.mean(inside(nees, normal, 0.68)) > 0.78
    assert np.mean(inside(nees, normal, 0.99)) < 0.98


def test_each_forecast_counts_by_its_own_degrees_of_freedom():
    """chi-square(3) has its 95 % at 7.815; F(3, 4) at 6.591, which is a NEES of 3 * 6.591 * 2 / 4 = 9.887."""
    nees = np.array([7.81, 7.82, 9.88, 9.89, np.nan])
    freedom = np.array([np.inf, np.inf, 4.0, 4.0, 4.0])
    assert inside(nees, freedom, 0.95).tolist() == [True, False, True, False, False]


def test_the_ellipse_seen_from_above_holds_the_share_of_two_axes():
    for freedom in (3.0, np.inf):
        errors = errors_of(freedom)[:, :2]
        squared = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(SPREAD[:2, :2]), errors)
        assert np.mean(squared <= squared_radius(freedom, 0.95, axes=2)) == pytest.approx(0.95, abs=0.007)
