"""Extended Kalman filter of a walker at constant speed and turn rate (CTRV); yaws of pelvis and head are optional."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from predictors.constant_velocity import ConstantVelocity, Refinement
from predictors.gate import is_near
from predictors.geometry import wrap_rad, yaw_rad
from predictors.predictor import noise_m2
from predictors.types import FloatArray, Forecast, HeadObservation, check_positive

YawCues = Literal["none", "pelvis", "both"]
_CUES_USED: dict[YawCues, int] = {"none": 0, "pelvis": 1, "both": 2}  # of pelvis, head

# Gauss-Legendre quadrature on [0, 1]: error 1e-8 with five nodes for a turn of pi. The closed form of the arc is
# singular at zero turn rate.
_nodes, _weights = np.polynomial.legendre.leggauss(5)
NODES: FloatArray = (_nodes + 1.0) / 2.0
WEIGHTS: FloatArray = _weights / 2.0

_SPEED, _HEADING, _TURN_RATE, _PELVIS_OFFSET = range(2, 6)
# Hysteresis of the speed at which a heading is defined.
_STANDS_BELOW_M_S = 0.2
_WALKS_FROM_M_S = 0.3
INITIAL_TURN_RATE_SD_RAD_S = 0.5
# Measured offsets of pelvis and head yaw from the direction of travel: prior, and random walk.
_OFFSET_SD_RAD = np.array([0.1, 0.2])
_OFFSET_WALK_RAD2_PER_S = np.array([0.0004, 0.0004])
# Standard deviation of the yaw about its mean, pelvis and head. Larger than the sensor's noise: the swing of the stride
# is correlated over many frames.
_YAW_SD_RAD = (0.15, 0.2)
# Contribution of the sensor if it states none: that of the reference sensor, 2 degrees.
_SENSOR_YAW_SD_RAD = 0.035


def turned_per_rate_s(time_s: FloatArray, decay_time_s: float) -> FloatArray:
    """Angle turned over a time, per initial turn rate.

    Args:
        time_s: Times, any shape, seconds.
        decay_time_s: Time constant of the turn rate's exponential decay, seconds.

    Returns:
        Radians per rad/s, of the same shape; the time itself where the decay is slow.
    """
    return np.asarray(-decay_time_s * np.expm1(-time_s / decay_time_s), dtype=np.float64)


def arc(
    heading_rad: FloatArray, turn_rate_rad_s: FloatArray, time_s: FloatArray, decay_time_s: float
) -> tuple[FloatArray, FloatArray]:
    """Displacement along an arc, per unit of speed.

    Args:
        heading_rad: Initial headings, from +x towards +y, radians; broadcasts with the next two.
        turn_rate_rad_s: Initial turn rates, rad/s.
        time_s: Times, seconds, of any sign.
        decay_time_s: Time constant of the turn rate's exponential decay, seconds.

    Returns:
        Displacement, metres per m/s, shape (..., 2), and its derivative with respect to the turn rate, shape (..., 2).
    """
    time = np.asarray(time_s)[..., None]
    turned = turned_per_rate_s(time * NODES, decay_time_s)
    direction = np.asarray(heading_rad)[..., None] + np.asarray(turn_rate_rad_s)[..., None] * turned
    c, s = np.cos(direction), np.sin(direction)
    weight = time * WEIGHTS
    way = np.stack([np.sum(weight * c, axis=-1), np.sum(weight * s, axis=-1)], axis=-1)
    weight = weight * turned
    return way, np.stack([-np.sum(weight * s, axis=-1), np.sum(weight * c, axis=-1)], axis=-1)


def transition(x: FloatArray, dt_s: FloatArray, turn_time_s: float) -> tuple[FloatArray, FloatArray]:
    """State transition, with its Jacobian.

    Args:
        x: State [x, y, speed, heading, turn rate, pelvis offset, head offset], shape (7,), metres, seconds, radians.
        dt_s: Time steps, any shape (...), seconds.
        turn_time_s: Time constant of the turn rate's exponential decay, seconds.

    Returns:
        The states after these times, shape (..., 7), and their Jacobians with respect to x, shape (..., 7, 7).
    """
    dt = np.asarray(dt_s)
    way, way_by_rate = arc(x[_HEADING], x[_TURN_RATE], dt, turn_time_s)
    turned, decay = turned_per_rate_s(dt, turn_time_s), np.exp(-dt / turn_time_s)
    after = np.broadcast_to(x, (*dt.shape, 7)).copy()
    after[..., :2] += x[_SPEED] * way
    after[..., _HEADING] += x[_TURN_RATE] * turned
    after[..., _TURN_RATE] *= decay
    jacobian = np.broadcast_to(np.eye(7), (*dt.shape, 7, 7)).copy()
    jacobian[..., :2, _SPEED] = way
    jacobian[..., 0, _HEADING], jacobian[..., 1, _HEADING] = -x[_SPEED] * way[..., 1], x[_SPEED] * way[..., 0]
    jacobian[..., :2, _TURN_RATE] = x[_SPEED] * way_by_rate
    jacobian[..., _HEADING, _TURN_RATE] = turned
    jacobian[..., _TURN_RATE, _TURN_RATE] = decay
    return after, jacobian


class CoordinatedTurn(Refinement):
    """CTRV filter: constant speed and a turn rate that decays.

    A `ConstantVelocity` filter provides gate, height and initialisation. Below 0.2 m/s the heading is undefined, and
    the forecast is that of the `ConstantVelocity` filter. A measured yaw is modelled as the heading plus a constant
    offset of the person, which the filter estimates. The stated variance of the yaw is added to that of the swing.

    Args:
        yaw_cues: Orientations that are used, if an observation has them.
        acceleration_psd: Power spectral density of the acceleration along the path, m^2/s^3.
        heading_psd: Power spectral density of white noise on the heading's rate, rad^2/s: lateral sway.
        turn_psd: Power spectral density of the turn rate's derivative, rad^2/s^3.
        turn_time_s: Time constant of the turn rate's exponential decay, seconds; infinite in the textbook model.
        position_noise_m: Standard deviation of a position measurement on each axis, metres, if none is stated.
    """

    def __init__(
        self,
        yaw_cues: YawCues = "none",
        acceleration_psd: float = 0.05,
        heading_psd: float = 0.1,
        turn_psd: float = 0.1,
        turn_time_s: float = 1.0,
        position_noise_m: float = 0.01,
    ) -> None:
        if yaw_cues not in get_args(YawCues):
            raise ValueError(f"yaw_cues must be one of {', '.join(get_args(YawCues))}, got {yaw_cues!r}")
        check_positive(acceleration_psd=acceleration_psd, heading_psd=heading_psd, turn_psd=turn_psd)
        check_positive(turn_time_s=turn_time_s)
        self._yaw_cues = yaw_cues
        self._psd = np.array([acceleration_psd, heading_psd, turn_psd])
        self._turn_time_s = turn_time_s
        self._R = position_noise_m**2 * np.eye(3)
        super().__init__(ConstantVelocity(position_noise_m=position_noise_m))

    def _reset_estimates(self) -> None:
        from filterpy.kalman import ExtendedKalmanFilter  # noqa: PLC0415

        self._filter = ExtendedKalmanFilter(dim_x=7, dim_z=1)
        self._filter.x, self._filter.P = np.zeros(7), np.diag([0.0] * 5 + list(_OFFSET_SD_RAD**2))
        self._walks = False
        self._time_s = -np.inf

    def _refine(self, observation: HeadObservation) -> None:
        _, x, _ = self._position.state()
        speed_m_s = float(np.hypot(x[3], x[4]))
        if self._walks:
            self._walks = speed_m_s >= _STANDS_BELOW_M_S and self._correct(observation)
        if not self._walks and speed_m_s >= _WALKS_FROM_M_S:
            self._begin()
        self._time_s = observation.capture_time_s

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """Forecast the head position; see `predictors.predictor.Predictor.forecast`."""
        steady = self._position.forecast(times_s)
        if not self._walks:
            return steady
        x, P = self._predict(steady.times_s - self._time_s)
        means, covariances = steady.means_base_m.copy(), steady.covariances_m2.copy()
        means[:, :2] = x[:, :2]
        covariances[:, :2, :2] = P[:, :2, :2]
        return Forecast(steady.times_s, means, covariances, steady.issued_at_s)

    def _predict(self, dt_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        x, F = transition(self._filter.x, dt_s, self._turn_time_s)
        # Integral over the noise's time of entry, each contribution propagated to the end, by quadrature.
        forward = np.maximum(dt_s, 0.0)[:, None]
        _, since = transition(self._filter.x, forward * NODES, self._turn_time_s)
        columns = since[..., [_SPEED, _HEADING, _TURN_RATE]] * np.sqrt((forward * WEIGHTS)[..., None, None] * self._psd)
        columns = np.moveaxis(columns, 1, 2).reshape(len(dt_s), 7, 3 * len(NODES))
        P = F @ self._filter.P @ np.swapaxes(F, 1, 2) + columns @ np.swapaxes(columns, 1, 2)
        P[:, range(5, 7), range(5, 7)] += forward * _OFFSET_WALK_RAD2_PER_S
        return x, (P + np.swapaxes(P, 1, 2)) / 2.0

    def _begin(self) -> None:
        """Initialise position, speed and heading from the constant-velocity filter, the turn rate from its prior."""
        _, steady, spread = self._position.state()
        speed, heading = np.hypot(steady[3], steady[4]), np.arctan2(steady[4], steady[3])
        c, s = np.cos(heading), np.sin(heading)
        to_polar = np.zeros((4, 6))
        to_polar[0, 0] = to_polar[1, 1] = 1.0
        to_polar[2:, 3:5] = [[c, s], [-s / speed, c / speed]]
        # The offsets are constants of the person: kept over a stop.
        self._filter.x = np.array([steady[0], steady[1], speed, heading, 0.0, *self._filter.x[5:]])
        P = np.zeros((7, 7))
        P[:4, :4], P[5:, 5:] = to_polar @ spread @ to_polar.T, self._filter.P[5:, 5:]
        P[_TURN_RATE, _TURN_RATE] = INITIAL_TURN_RATE_SD_RAD_S**2
        self._filter.P, self._walks = P, True

    def _correct(self, observation: HeadObservation) -> bool:
        """Update the state; False if it has to be initialised again: innovation outside the gate, or too slow."""
        ekf = self._filter
        since_s = observation.capture_time_s - self._time_s
        x, P = self._predict(np.array([since_s]))
        ekf.x, ekf.P = x[0], P[0]
        measured_m = observation.head_position_base_m[:2]
        R = noise_m2(observation, self._R)[:2, :2]
        spread = np.eye(3)  # the height is gated by the constant-velocity filter
        spread[:2, :2] = ekf.P[:2, :2] + R
        if not is_near(np.append(measured_m - ekf.x[:2], 0.0), spread, since_s):
            return False
        ekf.update(measured_m, lambda _: np.eye(2, 7), lambda x: x[:2], R=R)
        cues = (observation.pelvis_quat_wxyz, observation.head_quat_wxyz)
        stated_rad = (observation.pelvis_yaw_sd_rad, observation.head_yaw_sd_rad)
        for i, quat in enumerate(cues[: _CUES_USED[self._yaw_cues]]):
            if quat is None or ekf.x[_SPEED] < _STANDS_BELOW_M_S:
                continue
            H = np.zeros((1, 7))
            H[0, [_HEADING, _PELVIS_OFFSET + i]] = 1.0
            off_rad = wrap_rad(yaw_rad(quat) - float(ekf.x[_HEADING] + ekf.x[_PELVIS_OFFSET + i]))
            ekf.update(
                np.array([off_rad]),
                lambda _, H=H: H,
                lambda _: np.zeros(1),
                R=np.eye(1)
                * (_YAW_SD_RAD[i] ** 2 - _SENSOR_YAW_SD_RAD**2 + (stated_rad[i] or _SENSOR_YAW_SD_RAD) ** 2),
            )
        return bool(ekf.x[_SPEED] >= _STANDS_BELOW_M_S)
