"""Constant-velocity Kalman filter of the head's position: the standard forecast of the field."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from predictors.gate import Gate
from predictors.predictor import NotReadyError, as_times, check_newer, noise_m2
from predictors.symmetric import inverse
from predictors.types import FloatArray, Forecast, HeadObservation

_INITIAL_SPEED_SD_M_S = 1.0
# Elements of a matrix of shape (6, 6), row by row: position with itself, position with velocity, velocity with itself.
_POSITION, _VELOCITY = np.array([0, 7, 14]), np.array([21, 28, 35])
_POSITION_BY_VELOCITY, _VELOCITY_BY_POSITION = np.array([3, 10, 17]), np.array([18, 25, 32])
_EYE3, _EYE6 = np.eye(3), np.eye(6)
_NOTHING_M2 = np.zeros((3, 3))


def transition(dt_s: float) -> FloatArray:
    """State transition of constant velocity, state [x, y, z, vx, vy, vz].

    Args:
        dt_s: Time step, seconds.

    Returns:
        F, shape (6, 6).
    """
    F = _EYE6.copy()
    F.put(_POSITION_BY_VELOCITY, dt_s)
    return F


def process_noise(dt_s: float, acceleration_psd: float) -> FloatArray:
    """Covariance that white-noise acceleration adds to the state over a time step.

    Args:
        dt_s: Time step, seconds; of any length, so irregular time stamps and gaps are exact.
        acceleration_psd: Power spectral density of the acceleration on each axis, m^2/s^3.

    Returns:
        Q, shape (6, 6). Bar-Shalom, Li & Kirubarajan (2001), eq. 6.2.2-12.
    """
    # Filled in place, which is several times as fast as a Kronecker product; a filter does this at every frame.
    Q = np.zeros((6, 6))
    Q.put(_POSITION, acceleration_psd * (dt_s**3 / 3.0))
    Q.put(_POSITION_BY_VELOCITY, acceleration_psd * (dt_s**2 / 2.0))
    Q.put(_VELOCITY_BY_POSITION, acceleration_psd * (dt_s**2 / 2.0))
    Q.put(_VELOCITY, acceleration_psd * dt_s)
    return Q


class ConstantVelocity:
    """Constant-velocity Kalman filter driven by the time stamps of the observations.

    Observations outside the gate are refused, and refused ones that form a candidate for 0.75 s restart the track; see
    `predictors.gate.Gate`. Over a gap the state is extrapolated and its covariance grows. A stated covariance of the
    position is the measurement covariance.

    Args:
        acceleration_psd: Power spectral density of the head's acceleration on each axis, m^2/s^3. The default
            has the least error at 0.5 s over walking people at the noise below.
        position_noise_m: Standard deviation of a position measurement on each axis, metres, where none is stated.
        gated: False to take in every observation, as a plain Kalman filter does.
    """

    def __init__(self, acceleration_psd: float = 0.05, position_noise_m: float = 0.01, gated: bool = True) -> None:
        if not (acceleration_psd > 0 and position_noise_m > 0):
            raise ValueError("acceleration_psd and position_noise_m must be positive")
        self._psd = acceleration_psd
        self._R = position_noise_m**2 * _EYE3
        self._gated = gated
        self.reset()

    def reset(self) -> None:
        """Forget the person."""
        self._x, self._P = np.zeros(6), np.zeros((6, 6))
        self._time_s = -np.inf
        self._issued_at_s = -np.inf
        self._started_at_s: float | None = None
        self._taken_in: tuple[HeadObservation, ...] = ()
        self._gate = Gate()

    @property
    def started_at_s(self) -> float | None:
        """Capture time of the observation that the track began with, None before the first one."""
        return self._started_at_s

    @property
    def taken_in(self) -> tuple[HeadObservation, ...]:
        """Observations that the last update used: none if it was refused; where a track begins anew, all of its own."""
        return self._taken_in

    @property
    def rejections_in_a_row(self) -> int:
        """Number of observations refused since the last accepted one."""
        return self._gate.rejections_in_a_row

    def update(self, observation: HeadObservation) -> None:
        """Take in one observation; see `predictors.predictor.Predictor.update`."""
        self.update_with(observation, self._R, _NOTHING_M2)

    def update_with(self, observation: HeadObservation, unstated_m2: FloatArray, extra_m2: FloatArray) -> None:
        """Take in one observation, for a predictor that measures the noise itself.

        Args:
            observation: The observation.
            unstated_m2: Covariance of a position that states none, shape (3, 3), square metres.
            extra_m2: Covariance that is added to every position's, shape (3, 3), square metres.

        Raises:
            OutOfOrderError: If it is not newer than the last observation.
        """
        check_newer(observation, None if self._started_at_s is None else self._time_s)
        R = noise_m2(observation, unstated_m2) + extra_m2
        if self._started_at_s is None:
            self._start(observation, R)
            return
        dt_s = observation.capture_time_s - self._time_s
        F = transition(dt_s)
        self._x = F @ self._x
        self._P = F @ self._P @ F.T + process_noise(dt_s, self._psd)
        self._time_s = observation.capture_time_s
        spread = self._P[:3, :3] + R
        if self._gated and not self._gate.accepts(observation, self._x[:3], spread):
            self._taken_in = ()
            if self._gate.lost:
                candidate = self._gate.candidate
                self._start(candidate[0], noise_m2(candidate[0], unstated_m2) + extra_m2)
                for other in candidate[1:]:
                    self.update_with(other, unstated_m2, extra_m2)
                self._taken_in = candidate
            return
        self._correct(observation.head_position_base_m - self._x[:3], spread, R)
        self._issued_at_s = observation.capture_time_s
        self._taken_in = (observation,)

    def _correct(self, innovation_m: FloatArray, spread_m2: FloatArray, R: FloatArray) -> None:
        # The position is measured, so H = [I 0], and products with H are parts of a matrix. Joseph's form keeps the
        # covariance positive definite: Bar-Shalom, Li & Kirubarajan (2001), eq. 5.2.3-18.
        K = self._P[:, :3] @ inverse(spread_m2)
        self._x = self._x + K @ innovation_m
        left = _EYE6.copy()
        left[:, :3] -= K
        P = left @ self._P @ left.T + K @ R @ K.T
        # Removes the asymmetry of rounding, which matters where a range changes from 100 km to a metre.
        self._P = 0.5 * (P + P.T)

    def state(self) -> tuple[float, FloatArray, FloatArray]:
        """The filter's estimate.

        Returns:
            Its time in seconds, the state [x, y, z, vx, vy, vz] in metres and metres a second, shape (6,),
            and its covariance, shape (6, 6).

        Raises:
            NotReadyError: If there has been no observation since the last reset.
        """
        if self._started_at_s is None:
            raise NotReadyError("no observation yet")
        return self._time_s, self._x.copy(), self._P.copy()

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """Forecast the head position; see `predictors.predictor.Predictor.forecast`."""
        return self.forecast_turned(times_s, _EYE3)

    def forecast_turned(self, times_s: ArrayLike, velocity_map: FloatArray) -> Forecast:
        """Forecast with a linear map of the velocity, by which other predictors bend the path.

        Args:
            times_s: Times to forecast for, shape (H,), seconds.
            velocity_map: Matrix that the estimated velocity is multiplied with, shape (3, 3), or (H, 3, 3) for one
                a time: that of the mean velocity until then.

        Returns:
            The forecast; its covariance is that of the mapped state plus the acceleration noise on the way.

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

    def _start(self, observation: HeadObservation, R: FloatArray) -> None:
        self._x = np.concatenate([observation.head_position_base_m, np.zeros(3)])
        self._P = np.zeros((6, 6))
        self._P[:3, :3], self._P[3:, 3:] = R, _INITIAL_SPEED_SD_M_S**2 * _EYE3
        self._time_s = self._issued_at_s = self._started_at_s = observation.capture_time_s
        self._taken_in = (observation,)
        self._gate.begin(observation)
