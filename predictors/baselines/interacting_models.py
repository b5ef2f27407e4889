"""Interacting multiple models: straight walk, left turn and right turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from predictors.baselines.constant_acceleration import start_filter
from predictors.constant_velocity import process_noise
from predictors.gate import GatedFilter
from predictors.predictor import as_times
from predictors.types import FloatArray, Forecast, check_positive

_INITIAL_SPEED_SD_M_S = 1.0
_INITIAL_PROBABILITIES = np.array([0.9, 0.05, 0.05])  # straight, left, right


def turning_transition(dt_s: FloatArray | float, turn_rate_rad_s: float) -> FloatArray:
    """State transition at constant speed and known turn rate, state [x, y, z, vx, vy, vz].

    Args:
        dt_s: Time steps, any shape (...), seconds.
        turn_rate_rad_s: Turn rate about the vertical, positive to the left; 0 is constant velocity.

    Returns:
        F, shape (..., 6, 6). Bar-Shalom, Li & Kirubarajan (2001), eq. 11.7.1-4.
    """
    dt = np.asarray(dt_s)
    angle = turn_rate_rad_s * dt
    # Written with sinc, which is regular at zero turn rate.
    along, aside = dt * np.sinc(angle / np.pi), dt * np.sinc(angle / (2.0 * np.pi)) * np.sin(angle / 2.0)
    c, s = np.cos(angle), np.sin(angle)
    F = np.broadcast_to(np.eye(6), (*dt.shape, 6, 6)).copy()
    F[..., 0, 3] = F[..., 1, 4] = along
    F[..., 0, 4], F[..., 1, 3] = -aside, aside
    F[..., 2, 5] = dt
    F[..., 3, 3] = F[..., 4, 4] = c
    F[..., 3, 4], F[..., 4, 3] = -s, s
    return F


def mode_transition(dt_s: float, mode_time_s: float) -> FloatArray:
    """Transition probabilities of the modes over a time step.

    Args:
        dt_s: Time step, seconds.
        mode_time_s: Mean sojourn time of a mode, seconds; transitions to both other modes are equally probable.

    Returns:
        Shape (3, 3), from row to column: matrix exponential of the rates, exact for any division into time steps.
    """
    kept = np.exp(-1.5 * dt_s / mode_time_s)
    return np.asarray(kept * np.eye(3) + (1.0 - kept) / 3.0)


class InteractingModels(GatedFilter):
    """IMM of constant velocity and turns to the left and to the right at a known rate; see `GatedFilter`.

    Args:
        turn_rate_rad_s: Rate of the turns, rad/s.
        mode_time_s: Mean sojourn time of a mode, seconds.
        acceleration_psd: Power spectral density of the head's acceleration on each axis, in all modes, m^2/s^3.
        position_noise_m: Standard deviation of a position measurement on each axis, metres, if none is stated.
    """

    def __init__(
        self,
        turn_rate_rad_s: float = 0.5,
        mode_time_s: float = 10.0,
        acceleration_psd: float = 0.05,
        position_noise_m: float = 0.01,
    ) -> None:
        check_positive(turn_rate_rad_s=turn_rate_rad_s, mode_time_s=mode_time_s, acceleration_psd=acceleration_psd)
        self._rates_rad_s = (0.0, turn_rate_rad_s, -turn_rate_rad_s)
        self._mode_time_s = mode_time_s
        self._psd = acceleration_psd
        super().__init__(position_noise_m)

    def probabilities(self) -> FloatArray:
        """Mode probabilities.

        Returns:
            Probabilities of straight, left and right, shape (3,).

        Raises:
            NotReadyError: If there has been no observation since the last reset.
        """
        self._check_started()
        return np.array(self._imm.mu)

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """Forecast the head position; see `predictors.predictor.Predictor.forecast`.

        Each mode is extrapolated to the forecast time; mean and covariance are those of the mixture.
        """
        weights = self.probabilities()
        times = as_times(times_s)
        tau = times - self._time_s
        F = np.stack([turning_transition(tau, rate_rad_s)[:, :3] for rate_rad_s in self._rates_rad_s])
        x = np.array([kf.x for kf in self._imm.filters])[:, None, :, None]
        P = np.array([kf.P for kf in self._imm.filters])[:, None]
        each = (F @ x)[..., 0]
        means = np.sum(weights[:, None, None] * each, axis=0)
        apart = (each - means)[..., None]
        spread = F @ P @ np.swapaxes(F, -1, -2) + apart * np.swapaxes(apart, -1, -2)
        noise = self._psd * np.maximum(tau, 0.0) ** 3 / 3.0
        covariances = np.sum(weights[:, None, None, None] * spread, axis=0) + noise[:, None, None] * np.eye(3)
        return Forecast(times, means, covariances, self._issued_at_s)

    def _begin(self, position_m: FloatArray, R: FloatArray) -> None:
        from filterpy.kalman import IMMEstimator  # noqa: PLC0415

        filters = [start_filter(position_m, R, (_INITIAL_SPEED_SD_M_S,)) for _ in self._rates_rad_s]
        start = mode_transition(0.0, self._mode_time_s)
        self._imm = IMMEstimator(filters, _INITIAL_PROBABILITIES, start)

    def _predict(self, dt_s: float) -> tuple[FloatArray, FloatArray]:
        imm = self._imm
        # Transition probabilities of this time step: filterpy keeps those of its last step, which after a rejected
        # observation would leave out the transitions since.
        changes = mode_transition(dt_s, self._mode_time_s)
        imm.cbar = imm.mu @ changes
        imm.omega = imm.mu[:, None] * changes / imm.cbar
        imm.mu = imm.cbar
        for kf, rate_rad_s in zip(imm.filters, self._rates_rad_s, strict=True):
            kf.F, kf.Q = turning_transition(dt_s, rate_rad_s), process_noise(dt_s, self._psd)
        imm.predict()
        return imm.x[:3], imm.P[:3, :3]

    def _correct(self, position_m: FloatArray, R: FloatArray) -> None:
        for kf in self._imm.filters:
            kf.R = R
        self._imm.update(position_m)
