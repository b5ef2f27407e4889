"""Bounds: the last position, as in a reactive gaze, and the true future, an upper bound for any forecast."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from predictors.predictor import NotReadyError, as_times, check_newer, noise_m2
from predictors.types import FloatArray, Forecast, HeadObservation, check_positive


class _Latest:
    """Keeps the newest observation."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Return to the initial state, before the first observation."""
        self._last: HeadObservation | None = None

    def update(self, observation: HeadObservation) -> None:
        """Update with one observation; see `predictors.predictor.Predictor.update`."""
        check_newer(observation, None if self._last is None else self._last.capture_time_s)
        self._last = observation

    def _newest(self) -> HeadObservation:
        if self._last is None:
            raise NotReadyError("no observation yet")
        return self._last


class LastPosition(_Latest):
    """Forecasts the last observed position, with a spread that grows at walking speed.

    Args:
        position_noise_m: Standard deviation of a position measurement on each axis, metres, if none is stated.
        walking_speed_m_s: Standard deviation of a person's speed on each axis, metres a second. The default is for a
            walk at 1.2 m/s in unknown direction.
    """

    def __init__(self, position_noise_m: float = 0.01, walking_speed_m_s: float = 0.7) -> None:
        check_positive(position_noise_m=position_noise_m, walking_speed_m_s=walking_speed_m_s)
        self._R = position_noise_m**2 * np.eye(3)
        self._walking_speed_m_s = walking_speed_m_s
        super().__init__()

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """Forecast the head position; see `predictors.predictor.Predictor.forecast`."""
        last, times = self._newest(), as_times(times_s)
        ahead_s = times - last.capture_time_s
        walked_m2 = (self._walking_speed_m_s * ahead_s) ** 2
        return Forecast(
            times_s=times,
            means_base_m=np.tile(last.head_position_base_m, (times.size, 1)),
            covariances_m2=noise_m2(last, self._R) + walked_m2[:, None, None] * np.eye(3),
            issued_at_s=last.capture_time_s,
        )


class Perfect(_Latest):
    """Forecast of the true positions, with zero covariance.

    Args:
        true_position_base_m: Function from times, shape (H,), in seconds, to the true head positions,
            shape (H, 3), in metres.
    """

    def __init__(self, true_position_base_m: Callable[[FloatArray], FloatArray]) -> None:
        self._true_position_base_m = true_position_base_m
        super().__init__()

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """Return the true positions; see `predictors.predictor.Predictor.forecast`."""
        last, times = self._newest(), as_times(times_s)
        return Forecast(
            times_s=times,
            means_base_m=self._true_position_base_m(times),
            covariances_m2=np.zeros((times.size, 3, 3)),
            issued_at_s=last.capture_time_s,
        )
