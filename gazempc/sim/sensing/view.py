"""What is in the field of view of a sensor on the base."""

from __future__ import annotations

import numpy as np

from gazempc.sim.sensing.tables import FieldOfView
from gazempc.types import BoolArray, FloatArray


def in_view(view: FieldOfView, positions_m: FloatArray) -> BoolArray:
    """Where a head is in view.

    Args:
        view: Field of view.
        positions_m: Heads in the sensor's frame: x forward, y left, z up; shape (N, 3), metres.

    Returns:
        Shape (N,).
    """
    x, y, z = positions_m.T
    azimuth_deg = np.degrees(np.arctan2(y, x))
    elevation_deg = np.degrees(np.arctan2(z, np.hypot(x, y)))
    return np.asarray(
        (np.abs(azimuth_deg) <= view.horizontal_deg / 2) & (np.abs(elevation_deg) <= view.vertical_deg / 2)
    )
