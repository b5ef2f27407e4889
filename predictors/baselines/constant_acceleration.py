"""Kalman filter whose state is the head's position, velocity and acceleration."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from predictors.gate import Gate
from predictors.predictor import NotReadyError, as_times, check_newer, noise_m2
from predictors.types import FloatArray, Forecast, HeadObservation

if TYPE_CHECKING:
    from filterpy.kalman import KalmanFilter

_INITIAL_SPEED_SD_M_S = 1.0
_INITIAL_ACCELERATION_SD_M_S2 = 1.0


def transition(dt_s: FloatArray) -> FloatArray:
    """State transitions of constant acceleration, state [x, y, z, vx, vy, vz, ax, ay, az].

    Args:
        dt_s: Time steps, shape (H,), seconds.

    Returns:
        F, shape (H, 9, 9).
    """
    one, zero = np.ones_like(dt_s), np.zeros_like(dt_s)
    return _on_each_axis([[one, dt_s, dt_s**2 / 2.0], [zero, one, dt_s], [zero, zero, one]])


def process_noise(dt_s: FloatArray, jerk_psd: float) -> FloatArray:
    """Covariances that white-noise jerk adds to the state over time steps.

    Args:
        dt_s: Time steps, shape (H,), seconds.
        jerk_psd: Power spectral density of the jerk on each axis, m^2/s^5.

    Returns:
        Q, shape (H, 9, 9). Bar-Shalom, Li & Kirubarajan (2001), eq. 6.2.3-9.
    """
    t = dt_s
    return jerk_psd * _on_each_axis(
        [
            [t**5 / 20.0, t**4 / 8.0, t**3 / 6.0],
            [t**4 / 8.0, t**3 / 3.0, t**2 / 2.0],
            [t**3 / 6.0, t**2 / 2.0, t],
        ]
    )


def _on_each_axis(blocks: list[list[FloatArray]]) -> FloatArray:
    block = np.moveaxis(np.array(blocks), -1, 0)
    return np.asarray(np.einsum("hij,kl->hikjl", block, np.eye(3)).reshape(-1, 9, 9))


class ConstantAcceleration:
    """Constant-acceleration Kalman filter driven by the time stamps of the observations.

    Improbable observations are refused as by `ConstantVelocity`.

    Args:
        jerk_psd: Power spectral density of the head's jerk on each axis, m^2/s^5. The default has the least error
            at 0.5 s over walking people at the noise below.
        position_noise_m: Standard deviation of a position measurement on each axis, metres, where none is stated.
    """

    def __init__(self, jerk_psd: float = 0.003, position_noise_m: float = 0.01) -> None:
        if not (jerk_psd > 0 and position_noise_m > 0):
            raise ValueError("jerk_psd and position_noise_m must be positive")
        self._psd = jerk_psd
        self._R = position_noise_m**2 * np.eye(3)
        self.reset()

    def reset(self) -> None:
        """Forget the person."""
        self._filter: KalmanFilter | None = None
        self._time_s = -np.inf
        self._issued_at_s = -np.inf
        self._gate = Gate()

    @property
    def rejections_in_a_row(self) -> int:
        """Number of observations refused since the last accepted one."""
        return self._gate.rejections_in_a_row

    def update(self, observation: HeadObservation) -> None:
        """Take in one observation; see `predictors.predictor.Predictor.update`."""
        check_newer(observation, None if self._filter is None else self._time_s)
        if self._filter is None:
            self._start(observation)
            return
        kf = self._filter
        dt_s = np.array([observation.capture_time_s - self._time_s])
        kf.predict(F=transition(dt_s)[0], Q=process_noise(dt_s, self._psd)[0])
        self._time_s = observation.capture_time_s
        R = noise_m2(observation, self._R)
        if self._gate.accepts(observation, kf.x[:3], kf.P[:3, :3] + R):
            kf.update(observation.head_position_base_m, R=R)
            self._issued_at_s = observation.capture_time_s
        elif self._gate.lost:
            first, *others = self._gate.candidate
            self._start(first)
            for other in others:
                self.update(other)

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """Forecast the head position; see `predictors.predictor.Predictor.forecast`."""
        if self._filter is None:
            raise NotReadyError("no observation yet")
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

    def _start(self, observation: HeadObservation) -> None:
        from filterpy.kalman import KalmanFilter  # noqa: PLC0415

        kf = KalmanFilter(dim_x=9, dim_z=3)
        kf.x = np.concatenate([observation.head_position_base_m, np.zeros(6)])
        kf.P = np.diag([0.0] * 3 + [_INITIAL_SPEED_SD_M_S**2] * 3 + [_INITIAL_ACCELERATION_SD_M_S2**2] * 3)
        kf.P[:3, :3] = noise_m2(observation, self._R)
        kf.H = np.eye(3, 9)
        self._filter = kf
        self._time_s = self._issued_at_s = observation.capture_time_s
        self._gate.begin(observation)
