"""Yaws, covariances of bearings, and 3x3 matrices, against rotations, exact fractions and closed forms."""

from dataclasses import FrozenInstanceError
from fractions import Fraction

import numpy as np
import pytest
from builders.walkers import random_covariance
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from predictors import Forecast, HeadObservation, bearing_covariance
from predictors.geometry import inverse, mahalanobis2, wrap_rad, yaw_rad

metres = st.floats(-5.0, 5.0)


@given(yaw=st.floats(-np.pi, np.pi), pitch=st.floats(-1.5, 1.5), roll=st.floats(-np.pi, np.pi))
def test_yaw_is_the_heading_of_the_forward_axis(yaw, pitch, roll):
    rotation = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    x, y, _ = rotation.apply([1.0, 0.0, 0.0])
    quat = rotation.as_quat(scalar_first=True)
    assert abs(wrap_rad(yaw_rad(quat) - np.arctan2(y, x))) < 1e-9
    assert abs(wrap_rad(yaw_rad(-quat) - yaw)) < 1e-9


@given(angle=st.floats(-50, 50))
def test_wrapped_angle_is_the_same_direction_within_half_a_turn(angle):
    wrapped = wrap_rad(angle)
    assert -np.pi < wrapped <= np.pi
    assert np.exp(1j * wrapped) == pytest.approx(np.exp(1j * angle), abs=1e-12)


@given(
    st.tuples(metres, metres, metres).filter(lambda p: np.linalg.norm(p) > 0.1),
    st.floats(1e-3, 0.3),
    st.floats(1e-2, 5.0),
)
def test_covariance_of_a_bearing_has_the_stated_axes(position, bearing_sd_rad, range_sd_m):
    covariance = bearing_covariance(position, bearing_sd_rad, range_sd_m)
    sight = np.array(position) / np.linalg.norm(position)
    np.testing.assert_allclose(covariance @ sight, range_sd_m**2 * sight, rtol=1e-9, atol=1e-12)
    across = np.linalg.norm(position) * bearing_sd_rad
    expected = np.sort([across**2, across**2, range_sd_m**2])
    np.testing.assert_allclose(np.linalg.eigvalsh(covariance), expected, rtol=1e-6)
    HeadObservation(0.0, position, position_covariance_m2=covariance)  # which checks it


def rounding(sds_m):
    """Bound on the relative rounding error, in proportion to the condition number."""
    return 1e-13 + 1e-14 * float(np.max(sds_m) / np.min(sds_m)) ** 2


def exact_inverse(matrix):
    """Inverse by cofactors in exact fractions, rounded once."""
    a = [[Fraction(float(matrix[min(r, c), max(r, c)])) for c in range(3)] for r in range(3)]

    def cofactor(r, c):
        (p, q), (s, t) = ([a[i][j] for j in range(3) if j != c] for i in range(3) if i != r)
        return (-1) ** (r + c) * (p * t - q * s)

    determinant = sum(a[0][c] * cofactor(0, c) for c in range(3))
    return np.array([[float(cofactor(c, r) / determinant) for c in range(3)] for r in range(3)])


@pytest.mark.parametrize(
    "sds_m", [(1.0, 0.5, 0.2), (100.0, 1e-3, 1e-3), (100.0, 100.0, 1e-3), (10.0, 1e-4, 1e-5), (1e-7, 1e-7, 1e-7)]
)
@pytest.mark.parametrize("seed", range(3))
def test_inverse_and_distance_near_singularity_agree_with_fractions(seed, sds_m):
    """Rounding in proportion to the condition number; symmetric and positive definite."""
    rng = np.random.default_rng(seed)
    matrix = random_covariance(rng, sds_m)
    exact = exact_inverse(matrix)
    largest = np.abs(exact).max()
    found = inverse(matrix)
    np.testing.assert_array_equal(found, found.T)
    assert np.abs(found - exact).max() < rounding(sds_m) * largest
    assert np.linalg.eigvalsh(found).min() > -1e-14 * largest
    difference = rng.standard_normal(3) * min(sds_m)
    expected = difference @ exact @ difference
    assert mahalanobis2(difference, matrix) == pytest.approx(expected, rel=3.0 * rounding(sds_m))


@given(
    direction=st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1),
    size_m=st.floats(0.01, 10.0),
    floor=st.floats(1e-4, 1.0),
)
def test_the_floored_inverse_of_a_singular_matrix_has_a_closed_form(direction, size_m, floor):
    """A single direction v: by Sherman and Morrison (1950), (I - v v' / (floor + |v|^2)) / floor."""
    v = size_m * direction
    expected = (np.eye(3) - np.outer(v, v) / (floor + v @ v)) / floor
    tolerance = 1e-14 * (1.0 + v @ v / floor)
    np.testing.assert_allclose(inverse(np.outer(v, v), floor), expected, rtol=0.0, atol=tolerance / floor)
    assert mahalanobis2(v, np.outer(v, v), floor) == pytest.approx(v @ v / (floor + v @ v), abs=tolerance)


# ---------------------------------------------------------------- observations


GOOD = np.array([1.0, 2.0, 3.0])
QUAT = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.inf, GOOD), "capture_time_s is not finite"),
        ((0.0, np.array([1.0, np.inf, 0.0])), "head_position_base_m is not finite"),
        ((0.0, np.ones(2)), r"head_position_base_m has shape \(2,\), expected \(3,\)"),
        ((0.0, GOOD, np.ones(3)), "head_quat_wxyz has shape"),
        ((0.0, GOOD, QUAT, 1.01 * QUAT), "pelvis_quat_wxyz is not of unit length"),
        ((0.0, GOOD, np.zeros(4)), "head_quat_wxyz is not of unit length"),
    ],
)
def test_invalid_observations_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        HeadObservation(*arguments)


def test_observation_takes_plain_lists_and_is_frozen():
    observation = HeadObservation(0.0, [1, 2, 3], [1, 0, 0, 0])
    assert observation.head_position_base_m.dtype == np.float64
    with pytest.raises(FrozenInstanceError):
        observation.capture_time_s = 1.0


def test_a_forecast_accepts_lists():
    forecast = Forecast([1.0, 2.0], [[1, 2, 3], [4, 5, 6]], np.zeros((2, 3, 3)).tolist(), 0.5)
    assert (forecast.means_base_m.shape, forecast.means_base_m.dtype) == ((2, 3), np.float64)
    with pytest.raises(ValueError, match=r"covariances_m2 of a forecast for 2 times has shape \(2,\), expected"):
        Forecast([1.0, 2.0], np.zeros((2, 3)), [1e-4, 1e-4], 0.5)
