"""The rule of Tamaru et al.: turn the Kalman filter's step by the head's yaw relative to the waist."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from predictors.constant_velocity import ConstantVelocity, Refinement
from predictors.geometry import rotation_about_vertical, wrap_rad, yaw_rad
from predictors.types import Forecast, HeadObservation, check_positive

# A glance or a turn moves the head's yaw by about 1 rad/s; as a random walk that is 1 rad^2 a second.
_YAW_WALK_RAD2_PER_S = 1.0
# An orientation older than this is no longer used.
_YAW_VALID_FOR_S = 0.5
# Below this speed the direction of travel is undefined.
_TRAVELS_FROM_M_S = 0.2
# Shrinkage T / (T + this) of the mean yaw over a time T: the mean of a short track may be a turn.
_OFFSET_PRIOR_S = 0.5


class HeadPose(Refinement):
    """Constant velocity turned towards the head's direction; Tamaru et al. 2021, equations 1 to 5.

    The position filter is `ConstantVelocity`. A separate Kalman filter estimates the relative yaw. Let d be the
    filter's step over one frame, and R the rotation by the relative yaw. Then the forecast after N frames is
    ``x + N ((1 - w) d + w R d)``. d is the velocity times the frame interval, so the rule extends to any horizon.
    After half a second without an orientation, the forecast is that of `ConstantVelocity`.

    The measured yaw of a head has a constant error of some degrees, so the paper's rule bends every straight walk;
    `offset_removed` subtracts the running mean of the yaw. The pelvis swings with every step and turns with the head;
    `yaw_from` "travel" measures the yaw from the direction of the filter's velocity instead.

    Args:
        weight: w in equation 4, in [0, 1]. The paper prints a tuned mean of "7.51", which is outside this range. The
            default 0.5 reads this number as steps of the paper's N = 15.
        acceleration_psd: See `ConstantVelocity`.
        position_noise_m: See `ConstantVelocity`.
        yaw_noise_rad: Standard deviation of a measurement of the relative yaw, radians, if none is
            stated. Head and reference contribute half of its variance each.
        yaw_from: Reference of the head's yaw: "waist" as in the paper, or "travel", the direction of travel. Below
            0.2 m/s there is no direction of travel, and the yaw does not change.
        offset_removed: Subtract the mean yaw since the start of the track; not in the paper.
        gated: See `ConstantVelocity`.
    """

    def __init__(
        self,
        weight: float = 0.5,
        acceleration_psd: float = 0.05,
        position_noise_m: float = 0.01,
        yaw_noise_rad: float = 0.05,
        yaw_from: Literal["waist", "travel"] = "waist",
        offset_removed: bool = False,
        gated: bool = True,
    ) -> None:
        if not 0.0 <= weight <= 1.0:
            raise ValueError(f"weight must be in [0, 1], got {weight}")
        if yaw_from not in ("waist", "travel"):
            raise ValueError(f"yaw_from must be waist or travel, got {yaw_from!r}")
        check_positive(yaw_noise_rad=yaw_noise_rad)
        self._weight = weight
        self._yaw_variance_rad2 = yaw_noise_rad**2
        self._yaw_from = yaw_from
        self._offset_removed = offset_removed
        super().__init__(ConstantVelocity(acceleration_psd, position_noise_m, gated))

    def relative_yaw_rad(self) -> float | None:
        """Filtered yaw of the head relative to the waist, or to the direction of travel (`yaw_from`).

        Returns:
            The angle in radians, positive to the person's left; None without a recent orientation.
        """
        if not self._yaw_count or self._position.state()[0] - self._yaw_time_s > _YAW_VALID_FOR_S:
            return None
        offset_rad = 0.0
        if self._offset_removed:
            known_s = self._yaw_time_s - self._yaw_since_s
            offset_rad = self._yaw_sum_rad / self._yaw_count * known_s / (known_s + _OFFSET_PRIOR_S)
        return wrap_rad(self._yaw_rad - offset_rad)

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """Forecast the head position; see `predictors.predictor.Predictor.forecast`."""
        angle_rad = self.relative_yaw_rad()
        if angle_rad is None:
            return self._position.forecast(times_s)
        R = rotation_about_vertical(angle_rad)
        return self._position.forecast_turned(times_s, (1.0 - self._weight) * np.eye(3) + self._weight * R)

    def _refine(self, observation: HeadObservation) -> None:
        for taken in self._position.accepted:
            zero_rad = self._zero_rad(taken)
            if taken.head_quat_wxyz is not None and zero_rad is not None:
                relative_rad = wrap_rad(yaw_rad(taken.head_quat_wxyz) - zero_rad)
                self._update_yaw(relative_rad, self._variance_rad2(taken), taken.capture_time_s)

    def _reset_estimates(self) -> None:
        self._yaw_rad = self._covariance_rad2 = 0.0
        self._yaw_time_s = self._yaw_since_s = -np.inf
        self._yaw_sum_rad, self._yaw_count = 0.0, 0

    def _zero_rad(self, observation: HeadObservation) -> float | None:
        if self._yaw_from == "waist":
            return None if observation.pelvis_quat_wxyz is None else yaw_rad(observation.pelvis_quat_wxyz)
        velocity_m_s = self._position.state()[1][3:5]
        if float(np.hypot(*velocity_m_s)) < _TRAVELS_FROM_M_S:
            return None
        return float(np.arctan2(velocity_m_s[1], velocity_m_s[0]))

    def _variance_rad2(self, observation: HeadObservation) -> float:
        half = self._yaw_variance_rad2 / 2.0
        head_rad = observation.head_yaw_sd_rad
        zero_rad = observation.pelvis_yaw_sd_rad if self._yaw_from == "waist" else None
        return sum(half if sd_rad is None else sd_rad**2 for sd_rad in (head_rad, zero_rad))

    def _update_yaw(self, measured_rad: float, variance_rad2: float, time_s: float) -> None:
        """Scalar Kalman filter of a random walk: prediction and measurement update."""
        if not self._yaw_count:
            self._yaw_since_s = time_s
        # Wrapped innovation: the filtered angle stays continuous at pi, also over a gap.
        innovation_rad = wrap_rad(measured_rad - self._yaw_rad) if self._yaw_count else measured_rad
        gain = 1.0
        if time_s - self._yaw_time_s <= _YAW_VALID_FOR_S:
            predicted_rad2 = self._covariance_rad2 + _YAW_WALK_RAD2_PER_S * (time_s - self._yaw_time_s)
            gain = predicted_rad2 / (predicted_rad2 + variance_rad2)
        self._yaw_rad += gain * innovation_rad
        self._covariance_rad2 = gain * variance_rad2
        self._yaw_time_s = time_s
        # The filtered yaw is continuous, so its mean needs no wrapping.
        self._yaw_sum_rad += self._yaw_rad
        self._yaw_count += 1
