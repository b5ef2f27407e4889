"""Several people as one target: the middle of the box that holds them all in the picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from predictors import Forecast


def middle_of(forecasts: Sequence[Forecast]) -> Forecast:
    """The middle of the box of several people, by directions from the base.

    Args:
        forecasts: One a person, for the same times.

    Returns:
        Halfway between the outermost pans and between the outermost tilts, at the mean distance; all else as the first.
    """
    means_m = np.array([forecast.means_base_m for forecast in forecasts])
    x, y, z = np.moveaxis(means_m, -1, 0)
    # From the first person's pan, so that people on both sides of straight behind are one group.
    first_rad = np.arctan2(y[0], x[0])
    aside_rad = (np.arctan2(y, x) - first_rad + np.pi) % (2.0 * np.pi) - np.pi
    pan_rad = first_rad + 0.5 * (aside_rad.min(axis=0) + aside_rad.max(axis=0))
    tilts_rad = np.arctan2(z, np.hypot(x, y))
    tilt_rad = 0.5 * (tilts_rad.min(axis=0) + tilts_rad.max(axis=0))
    level = np.cos(tilt_rad)
    directions = np.stack([level * np.cos(pan_rad), level * np.sin(pan_rad), np.sin(tilt_rad)], axis=-1)
    ranges_m = np.linalg.norm(means_m, axis=-1).mean(axis=0)
    return replace(forecasts[0], means_base_m=ranges_m[:, None] * directions)
