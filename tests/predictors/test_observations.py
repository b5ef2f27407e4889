"""Observations and orientations: what is refused, and headings."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from predictors import Forecast, HeadObservation

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
def test_observation_refuses(arguments, message):
    with pytest.raises(ValueError, match=message):
        HeadObservation(*arguments)


def test_observation_takes_plain_lists_and_is_frozen():
    observation = HeadObservation(0.0, [1, 2, 3], [1, 0, 0, 0])
    assert observation.head_position_base_m.dtype == np.float64
    with pytest.raises(FrozenInstanceError):
        observation.capture_time_s = 1.0


def test_a_forecast_may_be_made_of_lists():
    forecast = Forecast([1.0, 2.0], [[1, 2, 3], [4, 5, 6]], np.zeros((2, 3, 3)).tolist(), 0.5)
    assert (forecast.means_base_m.shape, forecast.means_base_m.dtype) == ((2, 3), np.float64)
    with pytest.raises(ValueError, match=r"covariances_m2 of a forecast for 2 times has shape \(2,\), expected"):
        Forecast([1.0, 2.0], np.zeros((2, 3)), [1e-4, 1e-4], 0.5)
