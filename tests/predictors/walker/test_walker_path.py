"""The smooth path of `Walker`, against a dense solution, a Kalman smoother and a Kalman filter."""

import numpy as np
import pytest
from builders.walkers import random_covariance
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from predictors.walker.path import information_of, smooth_path

STEP_S = 1.0 / 30.0
PSD, SPEED_SD_M_S, FARTHEST_M = 1.0, 1.0, 100.0


def track(seed, n=30, nodes=36, sds_m=(0.005, 0.02, 0.3)):
    """Places in order, positions with the errors that their covariances say, and those covariances."""
    rng = np.random.default_rng(seed)
    at = np.sort(rng.uniform(0.0, nodes - 1, n))
    at[-1] = nodes - 1
    covariances = np.array([random_covariance(rng, np.array(sds_m) * rng.uniform(0.3, 3.0)) for _ in range(n)])
    path = np.stack([1.2 * at * STEP_S, 0.1 * np.sin(at * STEP_S), 0.0 * at + 0.3], axis=1)
    seen = np.array([rng.multivariate_normal(p, c) for p, c in zip(path, covariances, strict=True)])
    return at, seen, covariances


def smoothed(at, seen, covariances, nodes=36):
    return smooth_path(at, seen, np.array([information_of(c) for c in covariances]), nodes, STEP_S)


def dense(at, seen, covariances, nodes):
    """Least squares, every row written out: what was seen, second differences, first velocity, and a wide prior."""
    rows, values = [], []

    def add(weights, value, root):
        block = np.kron(weights, np.eye(3))
        rows.append(root @ block)
        values.append(root @ value)

    for a, y, c in zip(at, seen, covariances, strict=True):
        left = min(int(a), nodes - 2)
        weights = np.zeros((1, nodes))
        weights[0, left], weights[0, left + 1] = left + 1 - a, a - left
        add(weights, y, np.linalg.cholesky(np.linalg.inv(c)).T)
    for k in range(nodes - 2):
        weights = np.zeros((1, nodes))
        weights[0, k : k + 3] = 1.0, -2.0, 1.0
        add(weights, np.zeros(3), np.eye(3) / np.sqrt(PSD * STEP_S**3))
    first = np.zeros((1, nodes))
    first[0, :2] = -1.0, 1.0
    add(first, np.zeros(3), np.eye(3) / (STEP_S * SPEED_SD_M_S))
    for k in range(nodes):
        add(np.eye(nodes)[k : k + 1], seen[-1], np.eye(3) / FARTHEST_M)
    return np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0].reshape(nodes, 3)


@pytest.mark.parametrize("nodes", [2, 3, 36])
@pytest.mark.parametrize("n", [2, 30, 80])
def test_it_is_the_least_squares_solution(nodes, n):
    """For few and many frames, also several between two nodes."""
    at, seen, covariances = track(n, n, nodes)
    np.testing.assert_allclose(smoothed(at, seen, covariances, nodes), dense(at, seen, covariances, nodes), atol=1e-7)


@settings(max_examples=15)
@given(
    angles=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    shift_m=st.tuples(*[st.floats(-50.0, 50.0)] * 3).map(np.array),
    mirror=st.booleans(),
)
def test_it_turns_moves_and_is_mirrored_with_what_is_seen(angles, shift_m, mirror):
    at, seen, covariances = track(3)
    change = Rotation.from_euler("xyz", angles).as_matrix() @ np.diag([1.0, -1.0 if mirror else 1.0, 1.0])
    other = smoothed(at, seen @ change.T + shift_m, change @ covariances @ change.T)
    np.testing.assert_allclose(other, smoothed(at, seen, covariances) @ change.T + shift_m, atol=1e-6)


@pytest.mark.parametrize("sds_m", [(100.0, 1e-3, 1e-3), (100.0, 100.0, 1e-3), (1e4, 1e-5, 1.0), (1e-7, 1e-7, 1e-7)])
def test_information_is_the_inverse_and_positive_definite_to_the_limit(sds_m):
    rng = np.random.default_rng(0)
    for _ in range(50):
        covariance = random_covariance(rng, sds_m)
        information = information_of(covariance).reshape(3, 3)
        np.testing.assert_array_equal(information, information.T)
        assert np.linalg.eigvalsh(information / information.max()).min() > -1e-15
        sight = np.linalg.eigh(covariance)[1][:, 0]  # best known direction: its share is that of the smallest variance
        floor_m2 = 1e-12 * np.trace(covariance)
        expected = 1.0 / (np.square(min(sds_m)) + floor_m2)
        assert sight @ information @ sight == pytest.approx(expected, rel=1e-3 if max(sds_m) < 1e3 else 0.2)
