"""What further revision of a forecast its last ones let expect."""

import numpy as np
import pytest

from gazempc.controllers.mpc.revisions import WINDOW_S, Revisions

PERIOD_S = 0.02
PLANS = round(WINDOW_S / PERIOD_S)
# Standard deviations of pan and tilt for an instant, and for one a window later.
SIGMAS = np.array([[0.05, 0.04], [0.06, 0.05]])
ONE_WINDOW = np.sqrt(SIGMAS[1] ** 2 - SIGMAS[0] ** 2)


def watch(forecasts, sigmas=SIGMAS, times_s=None):
    """Feed what is said of an instant now, and of one a window later, plan by plan."""
    revisions = Revisions(PERIOD_S)
    times_s = PERIOD_S * np.arange(len(forecasts)) if times_s is None else times_s
    return np.array([revisions.expected_rad(t, np.array(f), sigmas) for t, f in zip(times_s, forecasts, strict=True)])


def drifting(rate_rad, count=60):
    """The forecast of each instant moves by `rate_rad` a plan; the person stands at 0.3 and -0.1."""
    here = np.array([0.3, -0.1])
    return [(here + rate_rad * k, here + rate_rad * k) for k in range(count)]


def test_a_forecast_that_drifts_beyond_its_covariance_is_followed_ahead():
    rate = 3.5 * ONE_WINDOW / PLANS * [1.0, -1.0]
    expected = watch(drifting(rate))
    assert np.all(expected[:PLANS] == 0.0)
    # Three and a half standard deviations in each window are sure; a quarter comes again.
    assert expected[-1] == pytest.approx(0.25 * rate * PLANS)
    # Two and a half, whose square is 6.25, are not quite.
    less = watch(drifting(2.5 * ONE_WINDOW / PLANS))
    assert less[-1] == pytest.approx(0.25 * (6.25 - 3.0) / 5.0 * 2.5 * ONE_WINDOW, rel=0.01)


def test_one_that_drifts_within_its_covariance_is_taken_as_it_is():
    assert np.all(watch(drifting(1.5 * ONE_WINDOW / PLANS)) == 0.0)


def test_honest_revisions_hardly_ever_let_expect_more():
    """A random walk of the stated variance: over many, what is expected is small and right by chance only."""
    rng = np.random.default_rng(0)
    steps = rng.normal(size=(4000, 2)) * ONE_WINDOW / np.sqrt(PLANS)
    said = np.cumsum(steps, axis=0)
    expected = watch([(row, row) for row in said])
    assert np.sqrt(np.mean(expected**2)) < 0.1 * ONE_WINDOW.max()


def test_never_more_than_a_standard_deviation():
    expected = watch(drifting(np.array([0.3, -0.2])))
    assert expected[-1] == pytest.approx(SIGMAS[0] * [1.0, -1.0])


def test_the_instants_compared_are_the_same():
    """Somebody who moves as forecast: what is said of now + lead changes, what is said of an instant does not."""
    speed = np.array([1.0, 0.3])
    moving = [(speed * PERIOD_S * k, speed * PERIOD_S * (k + PLANS)) for k in range(60)]
    assert np.abs(watch(moving)).max() == 0.0


def test_another_turn_of_the_circle_is_no_revision():
    here = np.zeros(2)
    turned = [(here + np.array([2 * np.pi * (k > 30), 0.0]),) * 2 for k in range(60)]
    assert np.abs(watch(turned)).max() < 1e-12


def test_a_plan_left_out_starts_the_watch_anew():
    forecasts = drifting(5.0 * ONE_WINDOW / PLANS)
    times_s = PERIOD_S * (np.arange(60) + (np.arange(60) >= 40))
    expected = watch(forecasts, times_s=times_s)
    assert np.all(expected[39] != 0.0)
    assert np.all(expected[40 : 40 + PLANS] == 0.0)
    assert np.all(expected[-1] != 0.0)


@pytest.mark.parametrize("sigmas", [np.zeros((2, 2)), SIGMAS[::-1], np.full((2, 2), np.nan)])
def test_without_a_variance_to_compare_with_nothing_is_expected(sigmas):
    assert np.all(watch(drifting(np.array([0.3, 0.3])), sigmas) == 0.0)


def test_a_forecast_that_is_not_finite_leaves_no_trace():
    forecasts = drifting(5.0 * ONE_WINDOW / PLANS, count=90)
    forecasts[40] = (np.full(2, np.nan),) * 2
    expected = watch(forecasts)
    assert np.all(np.isfinite(expected))
    assert np.all(expected[[40, 40 + PLANS]] == 0.0)
    assert np.all(expected[-1] != 0.0)


def test_reset_forgets():
    revisions = Revisions(PERIOD_S)
    for k, said in enumerate(drifting(np.array([0.3, 0.3]), 30)):
        revisions.expected_rad(PERIOD_S * k, np.array(said), SIGMAS)
    revisions.reset()
    assert np.all(revisions.expected_rad(PERIOD_S * 30, np.zeros((2, 2)), SIGMAS) == 0.0)
