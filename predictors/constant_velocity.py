"""Constant-velocity Kalman filter of the head's position: the standard baseline."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from predictors.gate import GatedFilter
from predictors.geometry import inverse
from predictors.predictor import as_times
from predictors.types import FloatArray, Forecast, HeadObservation, check_positive

_INITIAL_SPEED_SD_M_S = 1.0
_EYE3, _EYE6 = np.eye(3), np.eye(6)
# Identities in the blocks of a 6x6 matrix: sums of these are several times as fast as a Kronecker product.
_POSITION, _VELOCITY = np.diag([1.0] * 3 + [0.0] * 3), np.diag([0.0] * 3 + [1.0] * 3)
_POSITION_BY_VELOCITY = np.eye(6, k=3)
_CROSS = _POSITION_BY_VELOCITY + _POSITION_BY_VELOCITY.T


def transition(dt_s: float) -> FloatArray:
    """State transition of constant velocity, state [x, y, z, vx, vy, vz].

    Args:
        dt_s: Time step, seconds.

    Returns:
        F, shape (6, 6).
    """
    return _EYE6 + dt_s * _POSITION_BY_VELOCITY


def process_noise(dt_s: float, acceleration_psd: float) -> FloatArray:
    """Covariance that white-noise acceleration adds to the state over a time step.

    Args:
        dt_s: Time step, seconds; exact for any length.
        acceleration_psd: Power spectral density of the acceleration on each axis, m^2/s^3.

    Returns:
        Q, shape (6, 6). Bar-Shalom, Li & Kirubarajan (2001), eq. 6.2.2-12.
    """
    return acceleration_psd * (dt_s**3 / 3.0 * _POSITION + dt_s**2 / 2.0 * _CROSS + dt_s * _VELOCITY)


class ConstantVelocity(GatedFilter):
    """Constant-velocity Kalman filter driven by the time stamps of the observations; see `GatedFilter`.

    Args:
        acceleration_psd: Power spectral density of the head's acceleration on each axis, m^2/s^3. The default
            minimises the error at 0.5 s on walking people at the default noise.
        position_noise_m: Standard deviation of a position measurement on each axis, metres, if none is stated.
        gated: False to accept every observation, as a plain Kalman filter.
    """

    def __init__(self, acceleration_psd: float = 0.05, position_noise_m: float = 0.01, gated: bool = True) -> None:
        check_positive(acceleration_psd=acceleration_psd)
        self._psd = acceleration_psd
        super().__init__(position_noise_m, gated)

    def _begin(self, position_m: FloatArray, R: FloatArray) -> None:
        self._x = np.concatenate([position_m, np.zeros(3)])
        self._P = np.zeros((6, 6))
        self._P[:3, :3], self._P[3:, 3:] = R, _INITIAL_SPEED_SD_M_S**2 * _EYE3

    def _predict(self, dt_s: float) -> tuple[FloatArray, FloatArray]:
        F = transition(dt_s)
        self._x = F @ self._x
        self._P = F @ self._P @ F.T + process_noise(dt_s, self._psd)
        return self._x[:3], self._P[:3, :3]

    def _correct(self, position_m: FloatArray, R: FloatArray) -> None:
        # H = [I 0], so products with H are slices. The Joseph form keeps the covariance positive definite:
        # Bar-Shalom, Li & Kirubarajan (2001), eq. 5.2.3-18.
        K = self._P[:, :3] @ inverse(self._P[:3, :3] + R)
        self._x = self._x + K @ (position_m - self._x[:3])
        left = _EYE6.copy()
        left[:, :3] -= K
        P = left @ self._P @ left.T + K @ R @ K.T
        # Removes the asymmetry of rounding, relevant if a range changes from 100 km to a metre.
        self._P = 0.5 * (P + P.T)

    def state(self) -> tuple[float, FloatArray, FloatArray]:
        """The filter's estimate.

        Returns:
            Its time in seconds, the state [x, y, z, vx, vy, vz] in metres and metres a second, shape (6,),
            and its covariance, shape (6, 6).

        Raises:
            NotReadyError: If there has been no observation since the last reset.
        """
        self._check_started()
        return self._time_s, self._x.copy(), self._P.copy()

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """Forecast the head position; see `predictors.predictor.Predictor.forecast`."""
        return self.forecast_turned(times_s, _EYE3)

    def forecast_turned(self, times_s: ArrayLike, velocity_map: FloatArray) -> Forecast:
        """Forecast with a linear map of the velocity, for predictors that bend the path.

        Args:
            times_s: Times to forecast for, shape (H,), seconds.
            velocity_map: Matrix from the estimated velocity to the mean velocity until the forecast time, shape
                (3, 3), or (H, 3, 3) with one for each time.

        Returns:
            The forecast; its covariance is that of the mapped state plus the integrated acceleration noise.

        Raises:
            NotReadyError: If there has been no observation since the last reset.
        """
        state_time_s, x, P = self.state()
        times = as_times(times_s)
        tau = times - state_time_s
        t = tau[:, None, None]
        transposed = np.swapaxes(velocity_map, -1, -2)
        cross = P[:3, 3:] @ transposed
        spread_v = velocity_map @ P[3:, 3:] @ transposed
        walk = self._psd * np.maximum(tau, 0.0) ** 3 / 3.0
        return Forecast(
            times_s=times,
            means_base_m=x[:3] + tau[:, None] * (velocity_map @ x[3:]),
            covariances_m2=P[:3, :3]
            + t * (cross + np.swapaxes(cross, -1, -2))
            + t**2 * spread_v
            + walk[:, None, None] * _EYE3,
            issued_at_s=self._issued_at_s,
        )


class Refinement(ABC):
    """Predictor with its own motion model on a track of `ConstantVelocity`, which does gating and track management.

    Args:
        position: The filter.
    """

    def __init__(self, position: ConstantVelocity) -> None:
        self._position = position
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        self._position.reset()
        self._reset_estimates()

    @property
    def rejections_in_a_row(self) -> int:
        """Number of consecutive rejected observations."""
        return self._position.rejections_in_a_row

    def update(self, observation: HeadObservation) -> None:
        """Update with one observation; see `predictors.predictor.Predictor.update`."""
        started_at_s = self._position.started_at_s
        self._position.update(observation)
        if self._position.started_at_s != started_at_s:
            self._reset_estimates()  # a new track may be another person
        # A rejected detection belongs to another person, with its orientation.
        if self._position.accepted:
            self._refine(observation)

    @abstractmethod
    def _reset_estimates(self) -> None:
        """Reset all estimates other than the position filter's."""

    @abstractmethod
    def _refine(self, observation: HeadObservation) -> None:
        """Update with an observation that the filter has accepted."""
