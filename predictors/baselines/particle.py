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
# Particles sample the position far more coarsely than the sensor measures it. A likelihood as narrow as the sensor's
# noise would leave only a few of them alive after every frame.
_LIKELIHOOD_WIDENING = 1.5
# Resample when the effective number of particles is below this share.
_RESAMPLE_BELOW = 0.5
# After resampling, places are shaken by this share of the measurement noise where it is least.
_ROUGHENING = 0.3
# If even the nearest particle is so improbable (99.9 %), none explains the observation.
_UNEXPLAINED_D2 = float(chdtri(2, 1.0 - 0.999))


class ParticleFilter(Refinement):
    """Bootstrap filter (Gordon, Salmond & Smith 1993) whose particles walk like `CoordinatedTurn`.

    Refused detections, the height and the start are those of a `ConstantVelocity` filter that runs beside. If no
    particle explains an observation that it accepts, as after a long gap, the cloud is drawn anew from it. The random
    numbers are the same after each reset, so equal observations give equal forecasts.

    Args:
        particles: How many.
        acceleration_psd: Power spectral density of the acceleration along the path, m^2/s^3.
        heading_psd: Power spectral density of the heading's own rate, rad^2/s: the head's sway, which is no turn.
        turn_psd: Power spectral density of the turn rate's derivative, rad^2/s^3.
        turn_time_s: Time constant with which the turn rate dies away, seconds.
        position_noise_m: Standard deviation of a position measurement on each axis, metres, where none is stated.
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
        """Forget the person."""
        self._random = np.random.default_rng(_SEED)
        super().reset()

    def _forget(self) -> None:
        self._time_s = -math.inf

    def _take_in(self, observation: HeadObservation) -> None:
        if math.isinf(self._time_s):
            self._draw()
        else:
            self._walk(observation.capture_time_s - self._time_s)
            self._weigh(observation.head_position_base_m[:2], noise_m2(observation, self._R)[:2, :2])
        self._time_s = observation.capture_time_s

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """Forecast the head position; see `predictors.predictor.Predictor.forecast`.

        Every particle goes on as it does now; the noise on the way is added to the covariance.
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
        covariances[:, :2, :2] += self._noise_on_the_way(np.maximum(tau[:, 0], 0.0))
        return Forecast(steady.times_s, means, covariances, steady.issued_at_s)

    def _noise_on_the_way(self, tau: FloatArray) -> FloatArray:
        speed, heading, _ = self._motion.T
        along = np.stack([np.cos(heading), np.sin(heading)])
        across = speed * np.stack([-np.sin(heading), np.cos(heading)])
        along_psd, heading_psd, turn_psd = self._psd
        spread_along = along_psd * tau**3 / 3.0
        # An endless turn rate's tau^5/20, bounded by what one that dies away can do.
        turning = np.minimum(tau, self._turn_time_s) ** 2
        spread_across = heading_psd * tau**3 / 3.0 + turn_psd * tau**3 * turning / 20.0
        return np.asarray(
            spread_along[:, None, None] * ((self._weights * along) @ along.T)
            + spread_across[:, None, None] * ((self._weights * across) @ across.T)
        )

    def _draw(self) -> None:
        """Draw the cloud from the steady walk's estimate."""
        _, x, P = self._position.state()
        chosen = [0, 1, 3, 4]
        drawn = self._random.multivariate_normal(x[chosen], P[np.ix_(chosen, chosen)], self._size, method="cholesky")
        self._place = drawn[:, :2]
        turn_rate = INITIAL_TURN_RATE_SD_RAD_S * self._random.standard_normal(self._size)
        self._motion = np.column_stack(
            [np.hypot(drawn[:, 2], drawn[:, 3]), np.arctan2(drawn[:, 3], drawn[:, 2]), turn_rate]
        )
        self._weights = np.full(self._size, 1.0 / self._size)

    def _walk(self, dt_s: float) -> None:
        before = self._motion
        noise = np.sqrt(self._psd * dt_s) * self._random.standard_normal((self._size, 3))
        after = before.copy()
        after[:, 1] += before[:, 2] * turned_per_rate_s(np.array(dt_s), self._turn_time_s)
        after[:, 2] *= np.exp(-dt_s / self._turn_time_s)
        after += noise
        # The way is that of the mean motion over the step, so that noise within it moves the particle too.
        way, _ = arc(before[:, 1] + noise[:, 1] / 2.0, before[:, 2], np.array(dt_s), self._turn_time_s)
        self._place = self._place + ((before[:, 0] + after[:, 0]) / 2.0)[:, None] * way
        self._motion = after

    def _weigh(self, seen_m: FloatArray, R: FloatArray) -> None:
        off_m = seen_m - self._place
        distance2 = np.sum(off_m @ np.linalg.inv(R) * off_m, axis=1) / _LIKELIHOOD_WIDENING**2
        if not np.min(distance2) <= _UNEXPLAINED_D2:
            self._draw()
            return
        # Only differences of the logarithms count; the weights themselves may be too small for a float.
        logs = np.log(np.maximum(self._weights, np.finfo(float).tiny)) - distance2 / 2.0
        weights = np.exp(logs - logs.max())
        self._weights = weights / weights.sum()
        if 1.0 / np.sum(self._weights**2) < _RESAMPLE_BELOW * self._size:
            self._resample(math.sqrt(min(self._R[0, 0], float(np.linalg.eigvalsh(R)[0]))))

    def _resample(self, noise_m: float) -> None:
        """Systematic resampling, with a generator of our own: filterpy's draws from numpy's global one."""
        at = (self._random.random() + np.arange(self._size)) / self._size
        chosen = np.minimum(np.searchsorted(np.cumsum(self._weights), at), self._size - 1)
        self._place, self._motion = self._place[chosen], self._motion[chosen]
        # Copies would all go the same way from the same place.
        self._place = self._place + _ROUGHENING * noise_m * self._random.standard_normal((self._size, 2))
        self._weights = np.full(self._size, 1.0 / self._size)
