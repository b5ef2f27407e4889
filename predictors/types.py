"""Input and output of a predictor: observation and forecast."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_UNIT_QUATERNION_TOLERANCE = 1e-3
# Relative asymmetry from rounding to six digits.
_SYMMETRY_TOLERANCE = 1e-5


def _array(name: str, value: object, *shape: int) -> FloatArray:
    array = np.array(value, dtype=np.float64)  # a copy: the caller may reuse its buffer
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
    if not all(map(math.isfinite, array.ravel().tolist())):
        raise ValueError(f"{name} is not finite: {array.tolist()}")
    return array


def _covariance(name: str, value: object) -> FloatArray:
    array = _array(name, value, 3, 3)
    if np.abs(array - array.T).max() > _SYMMETRY_TOLERANCE * np.abs(array).max():
        raise ValueError(f"{name} is not symmetric: {array.tolist()}")
    array = 0.5 * (array + array.T)
    try:
        np.linalg.cholesky(array)
    except np.linalg.LinAlgError:
        raise ValueError(f"{name} is not positive definite: {array.tolist()}") from None
    return array


def check_positive(**numbers: float) -> None:
    """Check that parameters are positive and finite.

    Args:
        **numbers: Parameters by name.

    Raises:
        ValueError: If one is zero, negative or not finite; the message has the first one's name.
    """
    for name, number in numbers.items():
        if not 0.0 < number < math.inf:
            raise ValueError(f"{name} is {number}, expected a positive number")


@dataclass(frozen=True)
class HeadObservation:
    """One observation of a person, stamped with its capture time (not the time of reception).

    Time and position are required; None for other quantities that the sensor does not provide.

    Attributes:
        capture_time_s: Capture time in seconds, on the clock of the forecast times.
        head_position_base_m: Head position, shape (3,), metres, in the robot's base frame.
        head_quat_wxyz: Orientation of the head, shape (4,).
        pelvis_quat_wxyz: Orientation of the pelvis, shape (4,).
        position_covariance_m2: Covariance of the position's error, shape (3, 3), square metres, base frame. For a
            bearing without a range: a large variance along the line of sight.
        head_yaw_sd_rad: Standard deviation of the head's yaw, radians, positive.
        pelvis_yaw_sd_rad: Standard deviation of the pelvis's yaw, radians, positive.
        person_id: Track identity that the sensor assigns.
        confidence: Probability that the detection is a person, from the sensor, 0 to 1.

    Raises:
        ValueError: If a value has the wrong shape, is not finite or is out of range. Also if a quaternion is not of
            unit length, or the covariance is not symmetric and positive definite.
    """

    capture_time_s: float
    head_position_base_m: FloatArray
    head_quat_wxyz: FloatArray | None = None
    pelvis_quat_wxyz: FloatArray | None = None
    position_covariance_m2: FloatArray | None = None
    head_yaw_sd_rad: float | None = None
    pelvis_yaw_sd_rad: float | None = None
    person_id: str | None = None
    confidence: float | None = None

    def __post_init__(self) -> None:
        if not math.isfinite(self.capture_time_s):
            raise ValueError(f"capture_time_s is not finite: {self.capture_time_s}")
        position = _array("head_position_base_m", self.head_position_base_m, 3)
        object.__setattr__(self, "head_position_base_m", position)
        for name in ("head_quat_wxyz", "pelvis_quat_wxyz"):
            value = getattr(self, name)
            if value is None:
                continue
            quat = _array(name, value, 4)
            if abs(math.hypot(*quat.tolist()) - 1.0) > _UNIT_QUATERNION_TOLERANCE:
                raise ValueError(f"{name} is not of unit length: {quat}")
            object.__setattr__(self, name, quat)
        if self.position_covariance_m2 is not None:
            covariance = _covariance("position_covariance_m2", self.position_covariance_m2)
            object.__setattr__(self, "position_covariance_m2", covariance)
        for name in ("head_yaw_sd_rad", "pelvis_yaw_sd_rad"):
            sd = getattr(self, name)
            if sd is not None:
                check_positive(**{name: sd})
        if self.confidence is not None and not 0.0 <= self.confidence <= 1.0:
            raise ValueError(f"confidence is {self.confidence}, expected 0 to 1")
        if self.person_id is not None and not isinstance(self.person_id, str):
            raise ValueError(f"person_id is {self.person_id!r}, expected a text")


@dataclass(frozen=True)
class Forecast:
    """Forecast positions of the head with their covariances.

    Attributes:
        times_s: Times of the forecast, shape (H,), absolute, on the clock of the capture times.
        means_base_m: Expected head positions, shape (H, 3), metres, base frame.
        covariances_m2: Covariances of these positions, shape (H, 3, 3), square metres.
        issued_at_s: Capture time of the newest observation that the forecast uses.
        degrees_of_freedom: Of the errors' multivariate t distribution, above 2; infinite for a normal one. Fewer mean
            heavier tails at the same covariance.

    Raises:
        ValueError: If a shape is wrong, a value is not numeric or the degrees of freedom are not above 2.
    """

    times_s: FloatArray
    means_base_m: FloatArray
    covariances_m2: FloatArray
    issued_at_s: float
    degrees_of_freedom: float = math.inf

    def __post_init__(self) -> None:
        if not self.degrees_of_freedom > 2.0:  # below, a t distribution has no covariance
            raise ValueError(f"degrees_of_freedom is {self.degrees_of_freedom}, expected more than 2")
        count = np.size(self.times_s)
        for name, shape in (("times_s", (count,)), ("means_base_m", (count, 3)), ("covariances_m2", (count, 3, 3))):
            value = getattr(self, name)
            if not isinstance(value, np.ndarray):
                value = np.asarray(value, dtype=np.float64)
                object.__setattr__(self, name, value)
            if value.shape != shape:
                raise ValueError(f"{name} of a forecast for {count} times has shape {value.shape}, expected {shape}")
