"""Lines through a longer walk: Kalman filters, whatever the frame rate, told in the frame of the newest line."""

import numpy as np
import pytest

from predictors import ConstantVelocity, HeadObservation
from predictors.walker.line import Line
from predictors.walker.slow import _FILTERS, N_SLOW, SLOW_MIRROR, SlowLines

STILL = Line(0.0, np.zeros(3), np.zeros(3), 0.0)
SCALES = np.tile(np.repeat([0.05, 0.15], 3), len(_FILTERS))  # metres, m/s


def wobbling(rate_hz, mirrored=False):
    """Frames of a slow walk with noise and one gap."""
    rng = np.random.default_rng(0)
    times_s = np.delete(np.arange(60) / rate_hz, slice(20, 23))
    at_m = np.outer(times_s, [0.05, -0.03, 0.0]) + 0.005 * rng.standard_normal((times_s.size, 3))
    return times_s, at_m * [1.0, -1.0 if mirrored else 1.0, 1.0]


def inputs_of(times_s, positions_m, line=STILL):
    slow = SlowLines()
    for time_s, position_m in zip(times_s, positions_m, strict=True):
        slow.add(time_s, position_m)
    return np.array(slow.inputs(line))


@pytest.mark.parametrize(("rate_hz", "frames"), [(15.0, 2.0), (30.0, 1.0), (60.0, 0.5)])
def test_they_are_kalman_filters_of_constant_velocity(rate_hz, frames):
    """Without a gate; a frame counts by the time that it stands for, so its variance is that at 30 Hz over `frames`."""
    times_s, positions_m = wobbling(rate_hz)
    times_s = np.arange(times_s.size) / rate_hz
    expected = []
    for psd, sd_m in _FILTERS:
        filters = ConstantVelocity(psd, sd_m, gated=False)
        for k, (time_s, position_m) in enumerate(zip(times_s, positions_m, strict=True)):
            variance_m2 = sd_m**2 / (frames if k else 1.0)
            filters.update(HeadObservation(time_s, position_m, position_covariance_m2=variance_m2 * np.eye(3)))
        expected.append(filters.state()[1])
    np.testing.assert_allclose(inputs_of(times_s, positions_m), np.ravel(expected) / SCALES, atol=1e-9)


def test_they_are_relative_to_the_line_in_its_frame():
    """A line that leads to the left, 2 cm behind and 3 cm/s slower than a steady walk."""
    times_s = np.arange(300) / 30.0
    positions_m = np.outer(times_s, [0.0, 1.2, 0.0])
    newest = Line(times_s[-1], positions_m[-1] - [0.0, 0.02, 0.0], np.array([0.0, 1.17, 0.0]), np.pi / 2)
    found = inputs_of(times_s, positions_m, newest).reshape(-1, 2, 3)
    np.testing.assert_allclose(found[:, 0], np.tile([0.4, 0.0, 0.0], (len(_FILTERS), 1)), atol=0.05)
    np.testing.assert_allclose(found[:, 1], np.tile([0.2, 0.0, 0.0], (len(_FILTERS), 1)), atol=0.05)


def test_left_and_right_are_alike():
    found, mirrored = inputs_of(*wobbling(30.0)), inputs_of(*wobbling(30.0, mirrored=True))
    assert found.shape == (N_SLOW,)
    np.testing.assert_allclose(mirrored, found * SLOW_MIRROR)
