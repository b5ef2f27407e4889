"""Symmetric 3x3 matrices in plain numbers, against numpy's own solvers, exact fractions and closed forms."""

from fractions import Fraction

import numpy as np
import pytest
from builders.walkers import random_covariance
from hypothesis import given
from hypothesis import strategies as st

from predictors.geometry import inverse, mahalanobis2

seeds = st.integers(0, 10_000)
sizes_m = st.tuples(*[st.floats(-3.0, 1.0)] * 3).map(lambda exponents: 10.0 ** np.array(exponents))
allowances = st.sampled_from([0.0, 1e-4, 3.0])


def rounding(sds_m):
    """Relative error that rounding may make: in proportion to the condition number."""
    return 1e-13 + 1e-14 * float(np.max(sds_m) / np.min(sds_m)) ** 2


def exact_inverse(matrix):
    """By cofactors in fractions, so without rounding before the last step."""
    a = [[Fraction(float(matrix[min(r, c), max(r, c)])) for c in range(3)] for r in range(3)]

    def cofactor(r, c):
        (p, q), (s, t) = ([a[i][j] for j in range(3) if j != c] for i in range(3) if i != r)
        return (-1) ** (r + c) * (p * t - q * s)

    determinant = sum(a[0][c] * cofactor(0, c) for c in range(3))
    return np.array([[float(cofactor(c, r) / determinant) for c in range(3)] for r in range(3)])


@given(seed=seeds, sds_m=sizes_m, allowance=allowances)
def test_the_distance_is_numpy_s(seed, sds_m, allowance):
    rng = np.random.default_rng(seed)
    covariance, difference = random_covariance(rng, sds_m), rng.standard_normal(3) * np.max(sds_m)
    expected = difference @ np.linalg.solve(covariance + allowance * np.eye(3), difference)
    assert mahalanobis2(difference, covariance, allowance) == pytest.approx(expected, rel=rounding(sds_m))


@given(seed=seeds, sds_m=sizes_m, floor=allowances)
def test_the_inverse_is_numpy_s_and_symmetric_to_the_last_bit(seed, sds_m, floor):
    matrix = random_covariance(np.random.default_rng(seed), sds_m)
    found, expected = inverse(matrix, floor), np.linalg.inv(matrix + floor * np.eye(3))
    np.testing.assert_array_equal(found, found.T)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=rounding(sds_m) * np.abs(expected).max())


@pytest.mark.parametrize("sds_m", [(100.0, 1e-3, 1e-3), (100.0, 100.0, 1e-3), (10.0, 1e-4, 1e-5), (1e-7, 1e-7, 1e-7)])
@pytest.mark.parametrize("seed", range(10))
def test_near_singular_it_is_as_exact_as_numpy(seed, sds_m):
    """Against fractions: what is lost is what any method loses, and no direction becomes impossible."""
    rng = np.random.default_rng(seed)
    matrix = random_covariance(rng, sds_m)
    exact = exact_inverse(matrix)
    largest = np.abs(exact).max()
    found = inverse(matrix)
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
def test_of_a_singular_matrix_the_floor_makes_one_with_a_closed_form(direction, size_m, floor):
    """A single direction v: by Sherman and Morrison (1950), (I - v v' / (floor + |v|^2)) / floor."""
    v = size_m * direction
    expected = (np.eye(3) - np.outer(v, v) / (floor + v @ v)) / floor
    tolerance = 1e-14 * (1.0 + v @ v / floor)
    np.testing.assert_allclose(inverse(np.outer(v, v), floor), expected, rtol=0.0, atol=tolerance / floor)
    assert mahalanobis2(v, np.outer(v, v), floor) == pytest.approx(v @ v / (floor + v @ v), abs=tolerance)
