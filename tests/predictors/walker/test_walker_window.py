"""The window of 1.2 s on an even grid, longer memories, and the smooth path against a dense solution."""

import numpy as np
import pytest
from builders.people import yaw_quat
from builders.walkers import random_covariance
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from predictors import ConstantVelocity, HeadObservation
from predictors.walker.line import Line
from predictors.walker.memories import _FILTERS, _MEANS_S, Memories
from predictors.walker.path import information_of, smooth_path
from predictors.walker.window import LAGS_S, STEP_S, WINDOW, TrackWindow

C = 1e-4 * np.eye(3)


def window_of(times_s, positions_m, pelvis=None, head=None):
    window, fresh = TrackWindow(), []
    for k, (t, p) in enumerate(zip(times_s, positions_m, strict=True)):
        quats = [None if yaws is None or yaws[k] is None else yaw_quat(yaws[k]) for yaws in (head, pelvis)]
        fresh.append(window.add(HeadObservation(t, p, *quats), C))
    return window, fresh


def line(times_s):
    return np.array([3.0, -1.0, 0.4]) + np.outer(times_s, [0.8, 0.3, 0.0])


@pytest.mark.parametrize("rate_hz", [4.0, 30.0, 500.0])
@pytest.mark.parametrize("begin_s", [-7.3, 1e6])
def test_a_straight_walk_is_sampled_exactly_at_any_rate(rate_hz, begin_s):
    since_s = np.arange(round(3.0 * rate_hz)) / rate_hz
    window, _ = window_of(begin_s + since_s, line(since_s))
    path, seen = window.on_grid()
    expected = line(since_s[-1] + LAGS_S)
    m = len(path)
    assert path.shape == (m, 3)
    assert seen.shape == (m, 5)
    assert WINDOW - 1.0 / (rate_hz * STEP_S) <= m <= WINDOW  # to the oldest frame within 1.2 s
    known = LAGS_S[WINDOW - m :] >= window.times_s[0] - window.times_s[-1] - 1e-9
    assert known[1:].all()
    np.testing.assert_allclose(seen[known, :3], expected[WINDOW - m :][known], atol=1e-6)
    np.testing.assert_allclose(path, expected[WINDOW - m :], atol=0.005 if known.all() else 0.02)
    assert window.times_s[-1] - window.times_s[0] <= -LAGS_S[0] + 2e-6


def test_uncertain_observations_have_lower_weight():
    """Each frame keeps its own covariance."""
    times_s, seen = np.arange(30) * STEP_S, np.zeros((30, 3))
    seen[-1] = [0.3, 0.3, 0.0]
    window = TrackWindow()
    for k, (t, p) in enumerate(zip(times_s, seen, strict=True)):
        window.add(HeadObservation(t, p), np.diag([1e-4, 1.0, 1e-4]) if k == 29 else C)
    newest = window.on_grid()[0][-1]
    assert newest[0] > 0.05
    assert abs(newest[1]) < 0.005


def test_yaws_are_unwrapped_held_and_bridged():
    """Turning left by 30 deg a frame from 150; three frames without, and the pelvis never seen before the sixth."""
    yaws = np.radians(150.0 + 30.0 * np.arange(12))
    head = [None if k in {4, 5, 6} else y for k, y in enumerate(yaws)]
    pelvis = [None] * 6 + [0.2] * 6
    window, fresh = window_of(np.arange(12) * STEP_S, np.zeros((12, 3)), pelvis, head)
    turned = window.values[:, 4] - window.values[0, 4]
    np.testing.assert_allclose(turned, yaws - yaws[0], atol=1e-9)  # uniform, also in unobserved frames
    np.testing.assert_allclose(window.values[:, 3], 0.2)
    assert fresh == [[k >= 6, k not in {4, 5, 6}] for k in range(12)]
    held, _ = window_of(np.arange(7) * STEP_S, np.zeros((7, 3)), None, head[:7])
    np.testing.assert_array_equal(held.values[4:, 4], held.values[3, 4])
    assert held.yaw_seen_s == [-np.inf, 3 * STEP_S]


def test_an_orientation_returns_after_a_loss_longer_than_the_window():
    yaws = [0.0] * 5 + [None] * 60 + [1.0]
    window, _ = window_of(np.arange(66) * STEP_S, np.zeros((66, 3)), None, yaws)
    share = (window.times_s - 4 * STEP_S) / (61 * STEP_S)
    np.testing.assert_allclose(window.values[:, 4], share, atol=1e-9)


# ---------------------------------------------------------------- longer memories


STILL = Line(0.0, np.zeros(3), np.zeros(3), 0.0)
SCALES = np.tile(np.repeat([0.05, 0.15], 3), len(_FILTERS))  # metres, m/s


def wobbling(rate_hz):
    """Frames of a slow walk with noise and one gap."""
    rng = np.random.default_rng(0)
    times_s = np.delete(np.arange(60) / rate_hz, slice(20, 23))
    at_m = np.outer(times_s, [0.05, -0.03, 0.0]) + 0.005 * rng.standard_normal((times_s.size, 3))
    return times_s, at_m


def inputs_of(times_s, positions_m, line=STILL):
    memories = Memories()
    for time_s, position_m in zip(times_s, positions_m, strict=True):
        memories.add(time_s, position_m)
    found, places_m = memories.inputs(line, positions_m[-1])
    return np.array(found), np.array(places_m)


@pytest.mark.parametrize(("rate_hz", "frames"), [(15.0, 2.0), (60.0, 0.5)])
def test_memories_are_constant_velocity_kalman_filters(rate_hz, frames):
    """Ungated; a frame is weighted by its duration: its variance is that at 30 Hz divided by `frames`."""
    times_s, positions_m = wobbling(rate_hz)
    times_s = np.arange(times_s.size) / rate_hz
    expected = []
    for psd, sd_m in _FILTERS:
        filters = ConstantVelocity(psd, sd_m, gated=False)
        for k, (time_s, position_m) in enumerate(zip(times_s, positions_m, strict=True)):
            variance_m2 = sd_m**2 / (frames if k else 1.0)
            filters.update(HeadObservation(time_s, position_m, position_covariance_m2=variance_m2 * np.eye(3)))
        expected.append(filters.state()[1])
    found, places_m = inputs_of(times_s, positions_m)
    np.testing.assert_allclose(found[: SCALES.size], np.ravel(expected) / SCALES, atol=1e-9)
    np.testing.assert_allclose(places_m[1 : 1 + len(_FILTERS)], np.array(expected)[:, :3], atol=1e-9)


def test_memories_are_in_the_frame_of_the_line():
    """A line that leads to the left, 2 cm behind and 3 cm/s slower than a steady walk."""
    times_s = np.arange(300) / 30.0
    positions_m = np.outer(times_s, [0.0, 1.2, 0.0])
    newest = Line(times_s[-1], positions_m[-1] - [0.0, 0.02, 0.0], np.array([0.0, 1.17, 0.0]), np.pi / 2)
    found = inputs_of(times_s, positions_m, newest)[0][: SCALES.size].reshape(-1, 2, 3)
    np.testing.assert_allclose(found[:, 0], np.tile([0.4, 0.0, 0.0], (len(_FILTERS), 1)), atol=0.05)
    np.testing.assert_allclose(found[:, 1], np.tile([0.2, 0.0, 0.0], (len(_FILTERS), 1)), atol=0.05)


@pytest.mark.parametrize("rate_hz", [2.5, 30.0])
def test_running_means_decay_exponentially_and_give_the_sway(rate_hz):
    """A step of 1 m between two rests: each mean has the response 1 - exp(-t / memory)."""
    times_s = np.arange(round(60 * rate_hz) + 1) / rate_hz
    positions_m = np.where(times_s[:, None] > 58.0, [0.0, 1.0, 0.3], [0.0, 0.0, 0.3])
    found, places_m = inputs_of(times_s, positions_m)
    expected = 1.0 - np.exp(-2.0 / np.array(_MEANS_S))
    means_m = places_m[-len(_MEANS_S) :]
    np.testing.assert_allclose(means_m[:, 1], expected, atol=0.15 / rate_hz + 0.02)
    np.testing.assert_allclose(means_m[:, [0, 2]], np.tile([0.0, 0.3], (len(_MEANS_S), 1)), atol=1e-12)
    sways_m = 0.05 * np.exp(found[-len(_MEANS_S) :])
    assert np.all(sways_m > 0.2)
    still, _ = inputs_of(times_s, np.tile([0.0, 1.0, 0.3], (times_s.size, 1)))
    np.testing.assert_allclose(0.05 * np.exp(still[-len(_MEANS_S) :]), 0.002)


# ---------------------------------------------------------------- the smooth path


PSD, SPEED_SD_M_S, FARTHEST_M = 1.0, 1.0, 100.0


def track(seed, n=30, nodes=36, sds_m=(0.005, 0.02, 0.3)):
    """Sorted nodes, positions with errors of their covariances, and the covariances."""
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
    """Dense least squares: observations, second differences, initial velocity, and a wide prior."""
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
def test_the_smooth_path_is_the_least_squares_solution(nodes, n):
    """For few and many frames, also several between two nodes."""
    at, seen, covariances = track(n, n, nodes)
    np.testing.assert_allclose(smoothed(at, seen, covariances, nodes), dense(at, seen, covariances, nodes), atol=1e-7)


@settings(max_examples=15)
@given(
    angles=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    shift_m=st.tuples(*[st.floats(-50.0, 50.0)] * 3).map(np.array),
    mirror=st.booleans(),
)
def test_the_smooth_path_is_equivariant(angles, shift_m, mirror):
    at, seen, covariances = track(3)
    change = Rotation.from_euler("xyz", angles).as_matrix() @ np.diag([1.0, -1.0 if mirror else 1.0, 1.0])
    other = smoothed(at, seen @ change.T + shift_m, change @ covariances @ change.T)
    np.testing.assert_allclose(other, smoothed(at, seen, covariances) @ change.T + shift_m, atol=1e-6)


@pytest.mark.parametrize("sds_m", [(100.0, 1e-3, 1e-3), (100.0, 100.0, 1e-3), (1e4, 1e-5, 1.0), (1e-7, 1e-7, 1e-7)])
def test_information_matrices_are_inverse_and_positive_definite(sds_m):
    rng = np.random.default_rng(0)
    for _ in range(50):
        covariance = random_covariance(rng, sds_m)
        information = information_of(covariance).reshape(3, 3)
        np.testing.assert_array_equal(information, information.T)
        assert np.linalg.eigvalsh(information / information.max()).min() > -1e-15
        sight = np.linalg.eigh(covariance)[1][:, 0]  # most certain direction: share by the smallest variance
        floor_m2 = 1e-12 * np.trace(covariance)
        expected = 1.0 / (np.square(min(sds_m)) + floor_m2)
        assert sight @ information @ sight == pytest.approx(expected, rel=1e-3 if max(sds_m) < 1e3 else 0.2)
