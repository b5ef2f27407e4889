"""A direction without a range: its covariance, and a walker who is followed by it alone."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from predictors import HeadObservation, bearing_covariance
from predictors.geometry import bearing_covariance as defined

metres = st.floats(-5.0, 5.0)


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
