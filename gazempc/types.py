"""Values that pass between the stages."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from predictors.types import FloatArray, HeadObservation

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.intp]
StringArray = NDArray[np.str_]

__all__ = ["BoolArray", "FloatArray", "IntArray", "JointState", "Sighting", "StringArray"]


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
class Sighting:
    """An observation and the time of its arrival.

    Attributes:
        arrival_s: Time at which the loop can first use it, seconds.
        observation: The observation with its capture time.
        head_position_sensor_m: The same head in the frame of a sensor that moves, shape (3,), metres; None for one that
            is fixed to the base.
    """

    arrival_s: float
    observation: HeadObservation
    head_position_sensor_m: FloatArray | None = None
