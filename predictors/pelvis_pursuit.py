"""Constant velocity that turns towards the direction of the pelvis."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from predictors.constant_velocity import ConstantVelocity, Refinement
from predictors.geometry import rotation_about_vertical, wrap_rad, yaw_rad
from predictors.predictor import as_times
from predictors.types import Forecast, HeadObservation, check_positive

# The direction of travel is undefined at rest: the rule fades out between these speeds.
_NO_DIRECTION_BELOW_M_S = 0.2
_FULL_GAIN_FROM_M_S = 0.5
# An orientation older than this is no longer used.
_YAW_VALID_FOR_S = 0.5


class PelvisPursuit(Refinement):
    """Constant-speed motion that turns exponentially towards the direction of the pelvis.

    v is the velocity of `ConstantVelocity`. R is the rotation about the vertical by the gain times the angle from v to
    the pelvis's forward axis. The velocity a time s ahead is ``v + (1 - exp(-s / T)) (R v - v)``, and its integral is
    the path. The forecast is that of `ConstantVelocity` below 0.2 m/s, and after half a second without an orientation
    of the pelvis. The gain is full from 0.5 m/s.

    Args:
        gain: Fraction of the angle to the pelvis that is turned, in [0, 1].
        turn_time_s: T, time constant of the turn, seconds.
        acceleration_psd: See `ConstantVelocity`; lower than its default, as the pelvis turns before the path.
        position_noise_m: See `ConstantVelocity`.
    """

    def __init__(
        self,
        gain: float = 0.75,
        turn_time_s: float = 0.11,
        acceleration_psd: float = 0.02,
        position_noise_m: float = 0.01,
    ) -> None:
        if not 0.0 <= gain <= 1.0:
            raise ValueError(f"gain must be in [0, 1], got {gain}")
        check_positive(turn_time_s=turn_time_s)
        self._gain = gain
        self._turn_time_s = turn_time_s
        super().__init__(ConstantVelocity(acceleration_psd, position_noise_m))

    def _reset_estimates(self) -> None:
        self._pelvis_yaw_rad, self._pelvis_time_s = 0.0, -np.inf

    def _refine(self, observation: HeadObservation) -> None:
        if observation.pelvis_quat_wxyz is not None:
            self._pelvis_yaw_rad = yaw_rad(observation.pelvis_quat_wxyz)
            self._pelvis_time_s = observation.capture_time_s

    def turn_rad(self) -> float:
        """Predicted total turn of the velocity.

        Returns:
            Radians, positive to the person's left; 0 without a pelvis yaw or a velocity.

        Raises:
            NotReadyError: If there has been no observation since the last reset.
        """
        time_s, x, _ = self._position.state()
        if time_s - self._pelvis_time_s > _YAW_VALID_FOR_S:
            return 0.0
        speed_m_s = np.hypot(x[3], x[4])
        fade = (speed_m_s - _NO_DIRECTION_BELOW_M_S) / (_FULL_GAIN_FROM_M_S - _NO_DIRECTION_BELOW_M_S)
        off_course_rad = wrap_rad(self._pelvis_yaw_rad - np.arctan2(x[4], x[3]))
        return float(np.clip(fade, 0.0, 1.0)) * self._gain * off_course_rad

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """Forecast the head position; see `predictors.predictor.Predictor.forecast`."""
        turn = rotation_about_vertical(self.turn_rad()) - np.eye(3)
        times = as_times(times_s)
        ahead = (times - self._position.state()[0]) / self._turn_time_s
        # Fraction of the turn in the mean velocity over the horizon; zero for past times.
        safe = np.where(ahead > 0, ahead, 1.0)
        share = np.where(ahead > 0, 1.0 + np.expm1(-safe) / safe, 0.0)
        return self._position.forecast_turned(times, np.eye(3) + share[:, None, None] * turn)
