"""A straight line through the recent walk, and its frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from predictors.types import FloatArray


@dataclass(frozen=True)
class Line:
    """A straight line through the recent walk.

    Attributes:
        time_s: Capture time of the newest observation.
        origin_base_m: Point of the line at that time, shape (3,).
        velocity_base_m_s: Its slope, shape (3,).
        heading_rad: Horizontal direction of the slope, about the vertical from +x.
    """

    time_s: float
    origin_base_m: FloatArray
    velocity_base_m_s: FloatArray
    heading_rad: float

    def to_base(self) -> FloatArray:
        """Rotation from the line's frame (along, across, up) to the base frame, shape (3, 3)."""
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
