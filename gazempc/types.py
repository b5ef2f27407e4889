"""Data types exchanged between the stages of the loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from predictors.types import FloatArray, HeadObservation

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.intp]
StringArray = NDArray[np.str_]

__all__ = ["BoolArray", "CameraView", "FloatArray", "IntArray", "JointState", "Sighting", "StringArray"]


@dataclass(frozen=True)
class JointState:
    """Measured state of the joints.

    Attributes:
        time_s: Time of the measurement, seconds, on the loop's clock.
        position_rad: Angles in the order of `NeckSpec.joint_names`, shape (N,), radians.
        velocity_rad_s: Their velocities, shape (N,), rad/s.
    """

    time_s: float
    position_rad: FloatArray
    velocity_rad_s: FloatArray


@dataclass(frozen=True)
class CameraView:
    """View frustum of a camera at the capture time of a picture.

    Attributes:
        position_base_m: Place of the camera, shape (3,), metres.
        axes_base: Its axes x (along the view), y (left) and z (up) in the columns, shape (3, 3).
        half_rad: Half of the picture's width and height, radians.
    """

    position_base_m: FloatArray
    axes_base: FloatArray
    half_rad: tuple[float, float]

    def bounded(self, places_m: FloatArray) -> FloatArray:
        """Clamp directions to half a picture outside of the picture.

        Args:
            places_m: Places in the base frame, shape (N, 3), metres.

        Returns:
            Places at the same distances from the camera, shape (N, 3).
        """
        x, y, z = ((places_m - self.position_base_m) @ self.axes_base).T
        level_m, far_m = np.hypot(x, y), np.sqrt(x**2 + y**2 + z**2)
        aside, up = (2.0 * half for half in self.half_rad)
        azimuth, elevation = np.clip(np.arctan2(y, x), -aside, aside), np.clip(np.arctan2(z, level_m), -up, up)
        ahead = np.cos(elevation)
        turned = np.stack([ahead * np.cos(azimuth), ahead * np.sin(azimuth), np.sin(elevation)], axis=1)
        return np.asarray(self.position_base_m + (far_m[:, None] * turned) @ self.axes_base.T)


@dataclass(frozen=True)
class Sighting:
    """An observation and the time of its arrival.

    Attributes:
        arrival_s: Time at which the loop can first use it, seconds.
        observation: The observation with its capture time.
        head_position_sensor_m: The same head in the frame of a sensor that moves, shape (3,), metres; None for one that
            is fixed to the base.
        view: The camera's view; None if it is unknown.
    """

    arrival_s: float
    observation: HeadObservation
    head_position_sensor_m: FloatArray | None = None
    view: CameraView | None = None
