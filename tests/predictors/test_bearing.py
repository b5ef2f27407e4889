"""A direction without a range: its covariance, and a walker who is followed by it alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from predictors import ConstantVelocity, HeadObservation, LastPosition, Walker, bearing_covariance
from predictors.bearing import bearing_covariance as defined

metres = st.floats(-5.0, 5.0)
BEARING_SD_RAD = 0.002


def test_ahead_it_is_what_is_written_by_hand():
    np.testing.assert_allclose(bearing_covariance([2.0, 0.0, 0.0], 0.01, 0.5), np.diag([0.25, 0.0004, 0.0004]))
    np.testing.assert_allclose(bearing_covariance((0.0, 0.0, -3.0), 0.01, 0.5), np.diag([0.0009, 0.0009, 0.25]))
    assert defined is bearing_covariance


@given(
    st.tuples(metres, metres, metres).filter(lambda p: np.linalg.norm(p) > 0.1),
    st.floats(1e-3, 0.3),
    st.floats(1e-2, 5.0),
)
def test_it_is_that_of_points_at_random_ranges_and_directions(position, bearing_sd_rad, range_sd_m):
    covariance = bearing_covariance(position, bearing_sd_rad, range_sd_m)
    sight = np.array(position) / np.linalg.norm(position)
    np.testing.assert_allclose(covariance @ sight, range_sd_m**2 * sight, rtol=1e-9, atol=1e-12)
    across = np.linalg.norm(position) * bearing_sd_rad
    expected = np.sort([across**2, across**2, range_sd_m**2])
    np.testing.assert_allclose(np.linalg.eigvalsh(covariance), expected, rtol=1e-6)
    HeadObservation(0.0, position, position_covariance_m2=covariance)  # which checks it


def always_3_m(range_m, rng):
    return 3.0


def too_far_and_noisy(range_m, rng):
    return 1.2 * range_m * (1.0 + 0.05 * rng.standard_normal())


def direction_errors_deg(predictor, seen_range_m, stated):
    """Of forecasts 0.5 s ahead, for a walker who passes at 2.5 to 3.6 m; the first second is left out."""
    times_s = np.arange(150) / 30.0
    path_m = np.stack([2.5 + 0.0 * times_s, 2.6 - 1.1 * times_s, 0.3 + 0.02 * np.sin(11.0 * times_s)], axis=1)
    rng, errors = np.random.default_rng(0), []
    for i, time_s in enumerate(times_s[:-15]):
        range_m = np.linalg.norm(path_m[i])
        sight = path_m[i] / range_m + BEARING_SD_RAD * rng.standard_normal(3)
        seen_m = seen_range_m(range_m, rng) * sight / np.linalg.norm(sight)
        covariance = bearing_covariance(seen_m, BEARING_SD_RAD, 1.0) if stated else None
        predictor.update(HeadObservation(time_s, seen_m, position_covariance_m2=covariance))
        forecast_m, true_m = predictor.forecast(time_s + 0.5).means_base_m[0], path_m[i + 15]
        cosine = forecast_m @ true_m / np.linalg.norm(forecast_m) / np.linalg.norm(true_m)
        errors.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    return np.array(errors[30:])


@pytest.mark.parametrize("seen_range_m", [always_3_m, too_far_and_noisy])
@pytest.mark.parametrize(
    ("make", "within_deg"),
    [(ConstantVelocity, 2.0), (Walker, 2.5)],
)
def test_a_walker_is_followed_by_bearings_alone(make, within_deg, seen_range_m):
    """The range is wrong by some 20 %. Half a second ahead the walker is 10 degrees further on; the forecast, near."""
    errors_deg = direction_errors_deg(make(), seen_range_m, stated=True)
    assert np.sqrt(np.mean(errors_deg**2)) < within_deg
    assert errors_deg.max() < 2.0 * within_deg
    stands_deg = direction_errors_deg(LastPosition(), seen_range_m, stated=True)
    assert np.sqrt(np.mean(stands_deg**2)) > 10.0
