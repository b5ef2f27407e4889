"""The true future: a bound on what a better forecast could gain."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from predictors.predictor import NotReadyError, as_times, check_newer
from predictors.types import FloatArray, Forecast, HeadObservation


class Perfect:
    """Forecast of the true positions, with zero covariance.

    Args:
        true_position_base_m: Function from times, shape (H,), in seconds, to the true head positions,
            shape (H, 3), in metres.
    """

    def __init__(self, true_position_base_m: Callable[[FloatArray], FloatArray]) -> None:
        self._true_position_base_m = true_position_base_m
        self.reset()

    def reset(self) -> None:
        """Forget that the person has been seen."""
        self._issued_at_s: float | None = None

    def update(self, observation: HeadObservation) -> None:
        """Note that the person is in sight; see `predictors.predictor.Predictor.update`."""
        check_newer(observation, self._issued_at_s)
        self._issued_at_s = observation.capture_time_s

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """Give the true positions; see `predictors.predictor.Predictor.forecast`."""
        if self._issued_at_s is None:
            raise NotReadyError("no observation yet")
        times = as_times(times_s)
        return Forecast(
            times_s=times,
            means_base_m=self._true_position_base_m(times),
            covariances_m2=np.zeros((times.size, 3, 3)),
            issued_at_s=self._issued_at_s,
        )
