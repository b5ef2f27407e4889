"""Kalman filter whose state is the head's position, velocity and acceleration."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from predictors.gate import GatedFilter
from predictors.predictor import as_times
from predictors.types import FloatArray, Forecast, check_positive

_INITIAL_SPEED_SD_M_S = 1.0
_INITIAL_ACCELERATION_SD_M_S2 = 1.0


def transition(dt_s: FloatArray) -> FloatArray:
    """State transitions of constant acceleration, state [x, y, z, vx, vy, vz, ax, ay, az].

    Args:
        dt_s: Time steps, shape (H,), seconds.

    Returns:
        F, shape (H, 9, 9).
    """
    t = dt_s[:, None, None]
    return np.asarray(np.eye(9) + t * np.eye(9, k=3) + t**2 / 2.0 * np.eye(9, k=6))


def process_noise(dt_s: FloatArray, jerk_psd: float) -> FloatArray:
    """Covariances that white-noise jerk adds to the state over time steps.

    Args:
        dt_s: Time steps, shape (H,), seconds.
        jerk_psd: Power spectral density of the jerk on each axis, m^2/s^5.

    Returns:
        Q, shape (H, 9, 9). Bar-Shalom, Li & Kirubarajan (2001), eq. 6.2.3-9.
    """
    t = dt_s
    block = np.array([[t**5 / 20, t**4 / 8, t**3 / 6], [t**4 / 8, t**3 / 3, t**2 / 2], [t**3 / 6, t**2 / 2, t]])
    return np.asarray(jerk_psd * np.einsum("ijh,kl->hikjl", block, np.eye(3)).reshape(-1, 9, 9))


def start_filter(position_m: FloatArray, R: FloatArray, derivative_sds: tuple[float, ...]) -> Any:
    """Kalman filter of position and derivatives, initialised at a position.

    Args:
        position_m: The position, shape (3,), metres.
        R: Its covariance, shape (3, 3), square metres.
        derivative_sds: Prior standard deviation of each derivative on each axis, m/s, m/s^2, ...

    Returns:
        The filter, a `filterpy.kalman.KalmanFilter`; the means of the derivatives are zero.
    """
    from filterpy.kalman import KalmanFilter  # noqa: PLC0415

    size = 3 * (1 + len(derivative_sds))
    kf = KalmanFilter(dim_x=size, dim_z=3)
    kf.x = np.concatenate([position_m, np.zeros(size - 3)])
    kf.P = np.diag(np.repeat(np.square([0.0, *derivative_sds]), 3))
    kf.P[:3, :3] = R
    kf.H = np.eye(3, size)
    return kf


class ConstantAcceleration(GatedFilter):
    """Constant-acceleration Kalman filter driven by the time stamps of the observations; see `GatedFilter`.

    Args:
        jerk_psd: Power spectral density of the head's jerk on each axis, m^2/s^5. The default minimises the
            error at 0.5 s on walking people at the default noise.
        position_noise_m: Standard deviation of a position measurement on each axis, metres, if none is stated.
    """

    def __init__(self, jerk_psd: float = 0.003, position_noise_m: float = 0.01) -> None:
        check_positive(jerk_psd=jerk_psd)
        self._psd = jerk_psd
        super().__init__(position_noise_m)

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """Forecast the head position; see `predictors.predictor.Predictor.forecast`."""
        self._check_started()
        times = as_times(times_s)
        tau = times - self._time_s
        to_position = transition(tau)[:, :3]
        noise = process_noise(np.maximum(tau, 0.0), self._psd)[:, :3, :3]
        return Forecast(
            times_s=times,
            means_base_m=to_position @ self._filter.x,
            covariances_m2=to_position @ self._filter.P @ np.swapaxes(to_position, 1, 2) + noise,
            issued_at_s=self._issued_at_s,
        )

    def _begin(self, position_m: FloatArray, R: FloatArray) -> None:
        derivatives = (_INITIAL_SPEED_SD_M_S, _INITIAL_ACCELERATION_SD_M_S2)
        self._filter = start_filter(position_m, R, derivatives)

    def _predict(self, dt_s: float) -> tuple[FloatArray, FloatArray]:
        step_s = np.array([dt_s])
        self._filter.predict(F=transition(step_s)[0], Q=process_noise(step_s, self._psd)[0])
        return self._filter.x[:3], self._filter.P[:3, :3]

    def _correct(self, position_m: FloatArray, R: FloatArray) -> None:
        self._filter.update(position_m, R=R)
