"""What is in the field of view of a sensor on the base, or on the head that turns."""

from __future__ import annotations

import numpy as np

from gazempc.neck.poses import head_in_base
from gazempc.neck.spec import Geometry
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


def seen_from_head(geometry: Geometry, angles_rad: FloatArray, position_m: FloatArray) -> FloatArray:
    """A position as a sensor on the head, beside the eye, sees it.

    Args:
        geometry: The neck's geometry.
        angles_rad: Angles of all joints, shape (N,), radians.
        position_m: In the base frame, shape (3,), metres.

    Returns:
        In the head's frame: x forward, y left, z up; shape (3,), metres.
    """
    head, axis_m = head_in_base(geometry, angles_rad)
    return np.asarray(head.inv().apply(position_m - axis_m) - geometry.eye_in_tilt_m)
