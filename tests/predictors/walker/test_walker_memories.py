"""Longer memories: Kalman filters and running means, at any frame rate, in the frame of the newest line."""

import numpy as np
import pytest

from predictors import ConstantVelocity, HeadObservation
from predictors.walker.line import Line
from predictors.walker.memories import _FILTERS, _MEANS_S, Memories

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
    found, places_m = inputs_of(times_s, positions_m)
    np.testing.assert_allclose(found[: SCALES.size], np.ravel(expected) / SCALES, atol=1e-9)
    np.testing.assert_allclose(places_m[1 : 1 + len(_FILTERS)], np.array(expected)[:, :3], atol=1e-9)


def test_they_are_relative_to_the_line_in_its_frame():
    """A line that leads to the left, 2 cm behind and 3 cm/s slower than a steady walk."""
    times_s = np.arange(300) / 30.0
    positions_m = np.outer(times_s, [0.0, 1.2, 0.0])
    newest = Line(times_s[-1], positions_m[-1] - [0.0, 0.02, 0.0], np.array([0.0, 1.17, 0.0]), np.pi / 2)
    found = inputs_of(times_s, positions_m, newest)[0][: SCALES.size].reshape(-1, 2, 3)
    np.testing.assert_allclose(found[:, 0], np.tile([0.4, 0.0, 0.0], (len(_FILTERS), 1)), atol=0.05)
    np.testing.assert_allclose(found[:, 1], np.tile([0.2, 0.0, 0.0], (len(_FILTERS), 1)), atol=0.05)


@pytest.mark.parametrize("rate_hz", [2.5, 30.0])
def test_running_means_forget_and_tell_the_sway_about_them(rate_hz):
    """A long rest here, then one a metre off: the mean of each memory is on its way by 1 - exp(-t / memory)."""
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
