"""Covariance of a position whose bearing is more accurate than its range, as with one camera."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from predictors.types import FloatArray


def bearing_covariance(position_m: ArrayLike, bearing_sd_rad: float, range_sd_m: float) -> FloatArray:
    """Covariance with separate errors of bearing and range.

    For a bearing without a range, place the head at a likely range and state the uncertainty of that range.

        covariance_m2 = bearing_covariance(head_m, bearing_sd_rad=0.002, range_sd_m=1.0)

    Args:
        position_m: Head as seen from the sensor, shape (3,), metres. The covariance is in the same frame.
        bearing_sd_rad: Standard deviation of the direction on both axes across it, radians, positive.
        range_sd_m: Standard deviation of the range, metres, positive.

    Returns:
        The covariance, shape (3, 3), square metres.

    Raises:
        ValueError: If the position is not three finite numbers or at the sensor itself, or a standard deviation is not
            a positive number.
    """
    position = np.asarray(position_m, dtype=np.float64)
    if position.shape != (3,) or not np.isfinite(position).all():
        raise ValueError(f"position_m is {position_m!r}, expected three finite numbers in metres")
    range_m = float(np.linalg.norm(position))
    if range_m == 0.0:
        raise ValueError("position_m is at the sensor itself, where there is no direction")
    for name, sd in (("bearing_sd_rad", bearing_sd_rad), ("range_sd_m", range_sd_m)):
        if not 0.0 < sd < np.inf:
            raise ValueError(f"{name} is {sd}, expected a positive number")
    sight = position / range_m
    along = np.outer(sight, sight)
    across_m = range_m * bearing_sd_rad
    return np.asarray(range_sd_m**2 * along + across_m**2 * (np.eye(3) - along))
