"""Whatever is seen, `walker` has a forecast: finite, its covariance positive definite, and no warning on the way."""

import numpy as np
import pytest
from builders.people import yaw_quat
from builders.walkers import random_covariance, random_model
from hypothesis import example, given, settings
from hypothesis import strategies as st

from predictors import HeadObservation, Walker

TIMES_S = np.array([-0.1, 0.0, 0.5, 3.0])
steps = st.sampled_from([1e-9, 1e-6, 1e-3, 1 / 120, 1 / 30, 0.3, 3.0, 1e4])
exponents = st.floats(-3.0, 2.0)  # of standard deviations: variances from 1e-6 to 1e4 m^2


def assert_sound(walker, now_s):
    forecast = walker.forecast(now_s + TIMES_S)
    P = forecast.covariances_m2
    assert np.all(np.isfinite(forecast.means_base_m))
    assert np.all(np.isfinite(P))
    np.testing.assert_allclose(P, np.swapaxes(P, 1, 2), rtol=1e-9)
    assert np.linalg.eigvalsh(P).min() > 0.0


@settings(max_examples=20)
@given(steps_s=st.lists(steps, min_size=1, max_size=60), speed_m_s=st.floats(0.0, 5.0), seed=st.integers(0, 1000))
def test_any_time_stamps(steps_s, speed_m_s, seed):
    """Bursts a nanosecond apart, gaps of hours, orientations that come and go."""
    rng, walker, time_s = np.random.default_rng(seed), Walker(random_model()), 0.0
    for step_s in steps_s:
        time_s += step_s
        quats = [yaw_quat(rng.uniform(-7, 7)) if rng.random() < 0.6 else None for _ in range(2)]
        position = np.array([speed_m_s * time_s, 0.0, 0.4]) + 0.02 * rng.standard_normal(3)
        walker.update(HeadObservation(time_s, position, *quats))
        assert_sound(walker, time_s)


@settings(max_examples=15)
@given(
    sizes=st.lists(st.tuples(exponents, exponents, exponents), min_size=2, max_size=40),
    stated=st.lists(st.booleans(), min_size=40, max_size=40),
    turns=st.booleans(),
    seed=st.integers(0, 1000),
)
@example(sizes=[(2.0, -3.0, -3.0)] * 40, stated=[True] * 40, turns=True, seed=1)
@example(sizes=[(2.5, 2.5, -3.0)] * 40, stated=[True] * 40, turns=True, seed=2)
def test_any_covariance_in_any_direction(sizes, stated, turns, seed):
    """From a millimetre to a hundred metres, in a direction of its own each frame or in the same, now and then none."""
    rng, walker = np.random.default_rng(seed), Walker(random_model())
    for k, exponent in enumerate(sizes):
        covariance = random_covariance(rng if turns else np.random.default_rng(seed), 10.0 ** np.array(exponent))
        position = np.array([1.2 * k / 30, 0.0, 0.4]) + 0.02 * rng.standard_normal(3)
        told = covariance if stated[k] else None
        walker.update(HeadObservation(k / 30, position, None, yaw_quat(0.1), position_covariance_m2=told))
        assert_sound(walker, k / 30)


@pytest.mark.parametrize("covariance", [None, np.diag([1e4, 1e-6, 1e-6])])
@pytest.mark.parametrize("rate_hz", [2.5, 30.0])
def test_who_stands_exactly_still_stays_there(covariance, rate_hz):
    """Somebody who does not even sway, or a tracker that repeats itself."""
    walker, at = Walker(random_model()), np.array([2.0, -1.0, 0.3])
    for k in range(100):
        walker.update(HeadObservation(k / rate_hz, at, yaw_quat(0.4), yaw_quat(0.4), position_covariance_m2=covariance))
        assert_sound(walker, k / rate_hz)
    np.testing.assert_allclose(walker.forecast(99 / rate_hz + TIMES_S).means_base_m, np.tile(at, (4, 1)), atol=1e-6)
