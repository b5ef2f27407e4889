"""The last 1.2 s on an even grid: what is kept, what lies between frames, and orientations that were missing."""

import numpy as np
import pytest
from builders.people import yaw_quat

from predictors import HeadObservation
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
def test_a_straight_line_is_the_line_at_any_rate(rate_hz, begin_s):
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


@pytest.mark.parametrize("frames", [1, 2, 36, 90])
def test_it_is_as_long_as_the_track_and_never_longer_than_1_2_s(frames):
    times_s = np.arange(frames) * STEP_S
    path, seen = window_of(times_s, line(times_s))[0].on_grid()
    assert len(path) == len(seen) == min(frames, WINDOW)
    np.testing.assert_allclose(seen[-1, :3], line(times_s)[-1])


def test_what_is_uncertain_moves_the_path_less():
    """The covariance of each frame is that which came with it."""
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
    np.testing.assert_allclose(turned, yaws - yaws[0], atol=1e-9)  # evenly, also where it was not seen
    np.testing.assert_allclose(window.values[:, 3], 0.2)
    assert fresh == [[k >= 6, k not in {4, 5, 6}] for k in range(12)]
    held, _ = window_of(np.arange(7) * STEP_S, np.zeros((7, 3)), None, head[:7])
    np.testing.assert_array_equal(held.values[4:, 4], held.values[3, 4])
    assert held.yaw_seen_s == [-np.inf, 3 * STEP_S]


def test_an_orientation_that_was_gone_for_longer_than_the_window_comes_back():
    yaws = [0.0] * 5 + [None] * 60 + [1.0]
    window, _ = window_of(np.arange(66) * STEP_S, np.zeros((66, 3)), None, yaws)
    share = (window.times_s - 4 * STEP_S) / (61 * STEP_S)
    np.testing.assert_allclose(window.values[:, 4], share, atol=1e-9)
