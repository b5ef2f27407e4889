"""What is in the field of view of a sensor on the base, or on the head that turns."""

from __future__ import annotations

import numpy as np

from gazempc.neck.kinematics import gaze_ray
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
    """A position as a sensor beside the eye sees it.

    Args:
        geometry: The neck's geometry.
        angles_rad: Pan and tilt, shape (2,), radians.
        position_m: In the base frame, shape (3,), metres.

    Returns:
        In the sensor's frame: x along the gaze, y left, z up; shape (3,), metres.
    """
    eye_m, forward = gaze_ray(geometry, angles_rad)
    left = np.array([-np.sin(angles_rad[0]), np.cos(angles_rad[0]), 0.0])
    return np.stack([forward, left, np.cross(forward, left)]) @ (position_m - eye_m)
