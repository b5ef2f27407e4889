"""Bootstrap particle filter of a walker with speed, heading and turn rate."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

from predictors.baselines.coordinated_turn import INITIAL_TURN_RATE_SD_RAD_S, arc, turned_per_rate_s
from predictors.constant_velocity import ConstantVelocity, Refinement
from predictors.predictor import noise_m2
from predictors.types import FloatArray, Forecast, HeadObservation, check_positive

_SEED = 0
# Factor on the standard deviation of the likelihood: the particles are sparse relative to the sensor's noise, and its
# true likelihood would leave few effective particles after every frame.
_LIKELIHOOD_WIDENING = 1.5
# Resample when the effective number of particles is below this share.
_RESAMPLE_BELOW = 0.5
# Roughening after resampling: jitter of the positions as a share of the least standard deviation of the measurement.
_ROUGHENING = 0.3
# Chi-square quantile (99.9 %): if the nearest particle is farther, the cloud is inconsistent with the observation.
_UNEXPLAINED_D2 = float(chdtri(2, 1.0 - 0.999))


class ParticleFilter(Refinement):
    """Bootstrap filter (Gordon, Salmond & Smith 1993) with the motion model of `CoordinatedTurn`.

    A parallel `ConstantVelocity` filter provides gate, height and initialisation. If no particle is consistent with an
    accepted observation, as after a long gap, the cloud is drawn again from that filter's estimate. Each reset restores
    the seed, so equal observations give equal forecasts.

    Args:
        particles: Number of particles.
        acceleration_psd: Power spectral density of the acceleration along the path, m^2/s^3.
        heading_psd: Power spectral density of white noise on the heading's rate, rad^2/s: lateral sway.
        turn_psd: Power spectral density of the turn rate's derivative, rad^2/s^3.
        turn_time_s: Time constant of the turn rate's exponential decay, seconds.
        position_noise_m: Standard deviation of a position measurement on each axis, metres, if none is stated.
    """

    def __init__(
        self,
        particles: int = 400,
        acceleration_psd: float = 0.05,
        heading_psd: float = 0.1,
        turn_psd: float = 0.1,
        turn_time_s: float = 1.0,
        position_noise_m: float = 0.01,
    ) -> None:
        if particles < 2:
            raise ValueError(f"at least 2 particles are needed, got {particles}")
        check_positive(acceleration_psd=acceleration_psd, heading_psd=heading_psd, turn_psd=turn_psd)
        check_positive(turn_time_s=turn_time_s)
        self._size = particles
        self._psd = np.array([acceleration_psd, heading_psd, turn_psd])
        self._turn_time_s = turn_time_s
        self._R = position_noise_m**2 * np.eye(3)
        super().__init__(ConstantVelocity(position_noise_m=position_noise_m))

    def reset(self) -> None:
        """Return to the initial state."""
        self._random = np.random.default_rng(_SEED)
        super().reset()

    def _reset_estimates(self) -> None:
        self._time_s = -math.inf

    def _refine(self, observation: HeadObservation) -> None:
        if math.isinf(self._time_s):
            self._initialise()
        else:
            self._propagate(observation.capture_time_s - self._time_s)
            self._update_weights(observation.head_position_base_m[:2], noise_m2(observation, self._R)[:2, :2])
        self._time_s = observation.capture_time_s

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """Forecast the head position; see `predictors.predictor.Predictor.forecast`.

        Particles are extrapolated without noise; the process noise is added to the covariance.
        """
        steady = self._position.forecast(times_s)
        tau = (steady.times_s - self._time_s)[:, None]
        speed, heading, rate = self._motion.T
        way, _ = arc(heading, rate, tau, self._turn_time_s)
        places = self._place + speed[:, None] * way
        means, covariances = steady.means_base_m.copy(), steady.covariances_m2.copy()
        means[:, :2] = np.sum(self._weights[:, None] * places, axis=1)
        apart = places - means[:, None, :2]
        covariances[:, :2, :2] = np.swapaxes(self._weights[:, None] * apart, 1, 2) @ apart
        covariances[:, :2, :2] += self._process_noise(np.maximum(tau[:, 0], 0.0))
        return Forecast(steady.times_s, means, covariances, steady.issued_at_s)

    def _process_noise(self, tau: FloatArray) -> FloatArray:
        speed, heading, _ = self._motion.T
        along = np.stack([np.cos(heading), np.sin(heading)])
        across = speed * np.stack([-np.sin(heading), np.cos(heading)])
        along_psd, heading_psd, turn_psd = self._psd
        spread_along = along_psd * tau**3 / 3.0
        # tau^5/20 for a constant turn rate; tau is limited to the decay time for a decaying one.
        turning = np.minimum(tau, self._turn_time_s) ** 2
        spread_across = heading_psd * tau**3 / 3.0 + turn_psd * tau**3 * turning / 20.0
        return np.asarray(
            spread_along[:, None, None] * ((self._weights * along) @ along.T)
            + spread_across[:, None, None] * ((self._weights * across) @ across.T)
        )

    def _initialise(self) -> None:
        """Draw the cloud from the estimate of the constant-velocity filter."""
        _, x, P = self._position.state()
        chosen = [0, 1, 3, 4]
        drawn = self._random.multivariate_normal(x[chosen], P[np.ix_(chosen, chosen)], self._size, method="cholesky")
        self._place = drawn[:, :2]
        turn_rate = INITIAL_TURN_RATE_SD_RAD_S * self._random.standard_normal(self._size)
        self._motion = np.column_stack(
            [np.hypot(drawn[:, 2], drawn[:, 3]), np.arctan2(drawn[:, 3], drawn[:, 2]), turn_rate]
        )
        self._weights = np.full(self._size, 1.0 / self._size)

    def _propagate(self, dt_s: float) -> None:
        before = self._motion
        noise = np.sqrt(self._psd * dt_s) * self._random.standard_normal((self._size, 3))
        after = before.copy()
        after[:, 1] += before[:, 2] * turned_per_rate_s(np.array(dt_s), self._turn_time_s)
        after[:, 2] *= np.exp(-dt_s / self._turn_time_s)
        after += noise
        # Displacement at the mean speed and heading of the step, so that its noise moves the particle, too.
        way, _ = arc(before[:, 1] + noise[:, 1] / 2.0, before[:, 2], np.array(dt_s), self._turn_time_s)
        self._place = self._place + ((before[:, 0] + after[:, 0]) / 2.0)[:, None] * way
        self._motion = after

    def _update_weights(self, measured_m: FloatArray, R: FloatArray) -> None:
        off_m = measured_m - self._place
        distance2 = np.sum(off_m @ np.linalg.inv(R) * off_m, axis=1) / _LIKELIHOOD_WIDENING**2
        if not np.min(distance2) <= _UNEXPLAINED_D2:
            self._initialise()
            return
        # Log domain: the weights themselves may underflow.
        logs = np.log(np.maximum(self._weights, np.finfo(float).tiny)) - distance2 / 2.0
        weights = np.exp(logs - logs.max())
        self._weights = weights / weights.sum()
        if 1.0 / np.sum(self._weights**2) < _RESAMPLE_BELOW * self._size:
            self._resample(math.sqrt(min(self._R[0, 0], float(np.linalg.eigvalsh(R)[0]))))

    def _resample(self, noise_m: float) -> None:
        """Systematic resampling with the filter's own random generator: filterpy uses the global one of NumPy."""
        at = (self._random.random() + np.arange(self._size)) / self._size
        chosen = np.minimum(np.searchsorted(np.cumsum(self._weights), at), self._size - 1)
        self._place, self._motion = self._place[chosen], self._motion[chosen]
        # Roughening: separates the copies of a particle.
        self._place = self._place + _ROUGHENING * noise_m * self._random.standard_normal((self._size, 2))
        self._weights = np.full(self._size, 1.0 / self._size)
