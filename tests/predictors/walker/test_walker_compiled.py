"""Compiled code gives the answers of the numpy code that it stands for."""

import numpy as np
import pytest
from builders.people import yaw_quat
from builders.walkers import random_covariance

from predictors import HeadObservation, Walker
from predictors.walker import between, window
from predictors.walker.optional import compiled


@pytest.fixture
def numpy_only(monkeypatch):
    def switch():
        monkeypatch.setattr(window, "compiled", lambda: None)
        monkeypatch.setattr(between, "compiled", lambda: None)

    return switch


def frames(seed, n=80):
    """A walk at an uneven rate, with gaps, with stated errors of any size and direction."""
    rng = np.random.default_rng(seed)
    times_s = np.cumsum(rng.choice([0.005, 0.02, 1 / 30, 0.05, 0.2], n, p=[0.1, 0.2, 0.5, 0.15, 0.05]))
    for time_s in times_s:
        position = np.array([1.2 * time_s, 0.1 * np.sin(time_s), 0.3]) + 0.01 * rng.standard_normal(3)
        stated = random_covariance(rng, 10.0 ** rng.uniform(-3, 0, 3)) if seed % 2 else None
        yield HeadObservation(time_s, position, yaw_quat(0.1), yaw_quat(0.2), position_covariance_m2=stated)


@pytest.mark.parametrize("seed", range(6))
def test_windows_are_the_same(seed, numpy_only):
    assert compiled() is not None
    tracks = [window.TrackWindow(), window.TrackWindow()]
    found = []
    for frame in frames(seed):
        covariance = frame.position_covariance_m2
        tracks[0].add(frame, 1e-4 * np.eye(3) if covariance is None else covariance)
        found.append(tracks[0].on_grid())
    numpy_only()
    for k, frame in enumerate(frames(seed)):
        covariance = frame.position_covariance_m2
        tracks[1].add(frame, 1e-4 * np.eye(3) if covariance is None else covariance)
        path, seen = tracks[1].on_grid()
        np.testing.assert_allclose(found[k][0], path, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found[k][1], seen, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_forecasts_are_the_same(seed, numpy_only):
    ahead_s = np.array([0.0, 0.1, 0.125, 0.7351, 1.4999, 1.5])
    walkers, found = [Walker(), Walker()], []
    for k, walker in enumerate(walkers):
        if k == 1:
            numpy_only()
        for frame in frames(seed):
            walker.update(frame)
            found.append(walker.forecast(frame.capture_time_s + ahead_s))
    half = len(found) // 2
    for one, other in zip(found[:half], found[half:], strict=True):
        np.testing.assert_allclose(one.means_base_m, other.means_base_m, rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(one.covariances_m2, other.covariances_m2, rtol=1e-5, atol=1e-9)


def test_a_matrix_that_is_not_positive_definite_is_refused():
    track = window.TrackWindow()
    for k in range(5):
        track.add(HeadObservation(k / 30, [1.0, 2.0, 3.0]), 1e-4 * np.eye(3))
    track._information[:] *= -1.0
    with pytest.raises(FloatingPointError, match="not positive definite"):
        track.on_grid()
