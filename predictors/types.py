"""What goes into a predictor and what comes out of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_UNIT_QUATERNION_TOLERANCE = 1e-3


def _vector(name: str, value: object, size: int) -> FloatArray:
    array = np.array(value, dtype=np.float64)  # a copy: the caller may use its buffer again
    if array.shape != (size,):
        raise ValueError(f"{name} has shape {array.shape}, expected ({size},)")
    if not all(map(math.isfinite, array.tolist())):
        raise ValueError(f"{name} is not finite: {array}")
    return array


@dataclass(frozen=True)
class HeadObservation:
    """One sighting of a person, stamped with the time at which it was captured (not received).

    Attributes:
        capture_time_s: Capture time in seconds, on the clock that forecasts are asked for.
        head_position_base_m: Head position, shape (3,), metres, in the robot's base frame.
        head_quat_wxyz: Orientation of the head, shape (4,), or None where the sensor gave none.
        pelvis_quat_wxyz: Orientation of the pelvis, shape (4,), or None where the sensor gave none.

    Raises:
        ValueError: If a value has the wrong shape, is not finite, or a quaternion is not of unit length,
            so that a predictor never sees such a value.
    """

    capture_time_s: float
    head_position_base_m: FloatArray
    head_quat_wxyz: FloatArray | None = None
    pelvis_quat_wxyz: FloatArray | None = None

    def __post_init__(self) -> None:
        if not math.isfinite(self.capture_time_s):
            raise ValueError(f"capture_time_s is not finite: {self.capture_time_s}")
        position = _vector("head_position_base_m", self.head_position_base_m, 3)
        object.__setattr__(self, "head_position_base_m", position)
        for name in ("head_quat_wxyz", "pelvis_quat_wxyz"):
            value = getattr(self, name)
            if value is None:
                continue
            quat = _vector(name, value, 4)
            if abs(math.hypot(*quat.tolist()) - 1.0) > _UNIT_QUATERNION_TOLERANCE:
                raise ValueError(f"{name} is not of unit length: {quat}")
            object.__setattr__(self, name, quat)


@dataclass(frozen=True)
class Forecast:
    """Where the head will be, with how sure the predictor is.

    Attributes:
        times_s: Times of the forecast, shape (H,), absolute, on the clock of the capture times.
        means_base_m: Expected head positions, shape (H, 3), metres, base frame.
        covariances_m2: Covariances of these positions, shape (H, 3, 3), square metres.
        issued_at_s: Capture time of the newest observation that is in the forecast.

    Raises:
        ValueError: If a shape is not as said here, or a value is no number.
    """

    times_s: FloatArray
    means_base_m: FloatArray
    covariances_m2: FloatArray
    issued_at_s: float

    def __post_init__(self) -> None:
        count = np.size(self.times_s)
        for name, shape in (("times_s", (count,)), ("means_base_m", (count, 3)), ("covariances_m2", (count, 3, 3))):
            value = getattr(self, name)
            if not isinstance(value, np.ndarray):
                value = np.asarray(value, dtype=np.float64)
                object.__setattr__(self, name, value)
            found = value.shape
            if found != shape:
                raise ValueError(f"{name} of a forecast for {count} times has shape {found}, expected {shape}")
