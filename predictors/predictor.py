"""The interface of all predictors."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from predictors.types import FloatArray, Forecast, HeadObservation


class NotReadyError(RuntimeError):
    """A forecast was requested before the first observation."""


class OutOfOrderError(ValueError):
    """An observation is not newer than the one before it."""


class Predictor(Protocol):
    """Estimator of one person's head position, and its forecast.

    Only `update` and `reset` change the state; `forecast` has no side effects and may be called any number of times
    between two observations.

    A predictor that rejects false detections may have an attribute ``rejections_in_a_row``, the number of consecutive
    rejected observations; runs then count the rejections.
    """

    def reset(self) -> None:
        """Return to the initial state."""
        ...

    def update(self, observation: HeadObservation) -> None:
        """Update with one observation.

        Args:
            observation: The observation; its capture time must be later than the last one's.

        Raises:
            OutOfOrderError: If it is not newer than the last observation.
        """
        ...

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """Forecast the head position.

        Args:
            times_s: Absolute forecast times, shape (H,), seconds on the clock of the capture times.

        Returns:
            The forecast for these times.

        Raises:
            NotReadyError: If there has been no observation since the last reset.
        """
        ...


def as_times(times_s: ArrayLike) -> FloatArray:
    """Validate forecast times.

    Args:
        times_s: Times, scalar or shape (H,), seconds.

    Returns:
        The times as a float array of shape (H,).

    Raises:
        ValueError: If a time is not finite or the array has more than one dimension.
    """
    times = np.atleast_1d(np.asarray(times_s, dtype=np.float64))
    if times.ndim != 1 or not np.isfinite(times).all():
        raise ValueError(f"times_s must be finite and of shape (H,), got {times!r}")
    return times


def noise_m2(observation: HeadObservation, otherwise_m2: FloatArray) -> FloatArray:
    """Covariance of an observed position: stated, or else a default.

    Args:
        observation: The observation.
        otherwise_m2: Default covariance, shape (3, 3), square metres.

    Returns:
        Shape (3, 3), square metres.
    """
    stated = observation.position_covariance_m2
    return otherwise_m2 if stated is None else stated


def check_newer(observation: HeadObservation, last_capture_time_s: float | None) -> None:
    """Check that an observation is newer than the last one.

    Args:
        observation: The new observation.
        last_capture_time_s: Capture time of the last one; None before the first.

    Raises:
        OutOfOrderError: If it is not newer.
    """
    if last_capture_time_s is not None and observation.capture_time_s <= last_capture_time_s:
        raise OutOfOrderError(
            f"observation captured at {observation.capture_time_s:.6f} s is not newer than the last one "
            f"at {last_capture_time_s:.6f} s"
        )
