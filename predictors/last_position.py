"""Zero-order hold of the last observed position: the forecast behind a reactive gaze."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from predictors.predictor import NotReadyError, as_times, check_newer, noise_m2
from predictors.types import Forecast, HeadObservation


class LastPosition:
    """Forecasts the last observed position, with a spread that grows at walking speed.

    Args:
        position_noise_m: Standard deviation of a position measurement on each axis, metres, where none is stated.
        walking_speed_m_s: Standard deviation of a person's speed on each axis, metres a second. The default is for a
            walk of unknown direction at 1.2 m/s.
    """

    def __init__(self, position_noise_m: float = 0.01, walking_speed_m_s: float = 0.7) -> None:
        if not (position_noise_m > 0 and walking_speed_m_s > 0):
            raise ValueError("position_noise_m and walking_speed_m_s must be positive")
        self._R = position_noise_m**2 * np.eye(3)
        self._walking_speed_m_s = walking_speed_m_s
        self.reset()

    def reset(self) -> None:
        """Forget the person."""
        self._last: HeadObservation | None = None

    def update(self, observation: HeadObservation) -> None:
        """Take in one observation; see `predictors.predictor.Predictor.update`."""
        check_newer(observation, None if self._last is None else self._last.capture_time_s)
        self._last = observation

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """Forecast the head position; see `predictors.predictor.Predictor.forecast`."""
        if self._last is None:
            raise NotReadyError("no observation yet")
        times = as_times(times_s)
        ahead_s = times - self._last.capture_time_s
        walked_m2 = (self._walking_speed_m_s * ahead_s) ** 2
        return Forecast(
            times_s=times,
            means_base_m=np.tile(self._last.head_position_base_m, (times.size, 1)),
            covariances_m2=noise_m2(self._last, self._R) + walked_m2[:, None, None] * np.eye(3),
            issued_at_s=self._last.capture_time_s,
        )
