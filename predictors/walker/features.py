"""Inputs of `Walker`'s networks: the recursive estimates of a track relative to the line of its filter."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from predictors.geometry import yaw_rad
from predictors.types import FloatArray, HeadObservation
from predictors.walker import bank

# Ramp of the weight of the direction of travel: it is undefined below the first speed.
_WALKS_M_S = (0.2, 0.5)
# Rounding: a slower line, as at a first frame, has no direction.
_NO_DIRECTION_M_S = 1e-6
# Speeds above walking, between which the networks' departure fades out.
_RUNS_M_S = (2.2, 3.0)
# Time since the last observed yaw over which its weight fades out, seconds.
_YAW_FADES_S = (0.0, 0.5)
# Mean offsets of pelvis and head yaw: larger ones are attributed to the mounting of a sensor or marker and subtracted,
# ramped over these ranges of angle and numbers of frames.
_MOUNTING_RAD, _MOUNTING_FRAMES = ((0.25, 0.4), (0.35, 0.5)), (5.0, 15.0)
# Angle to the direction of travel over which a yaw's weight fades out: sideways or backward walking, or an outlier.
_NOT_FORWARD_RAD = (1.4, 1.9)
# Scales that make each input of order one for walking people.
_POSITION_SCALE_M, _VELOCITY_SCALE_M_S, _MEAN_SCALE_M, _YAW_SCALES_RAD = 0.05, 0.15, 0.1, (0.15, 0.2)
_USUAL_SPEED_M_S, _SPEED_SCALE_M_S, NOISE_SCALE_M = 1.1, 0.3, 0.01
_SWAY_SCALE_M, _LEAST_SWAY_M = 0.05, 0.002
_FAST_M_S = 1.7  # input of the stated uncertainty: faster walks are outside the fit's data
# Limit of the inputs; lower limits of noise, squared innovation and frame rate in logarithms.
_LARGEST, _SMALLEST_NOISE, _SMALLEST_RATIO2, _LEAST_RATE = 4.0, 0.1, 0.01, 1e-3
_ROUNDING_M2 = 1e-12  # a stated covariance may be nearly singular
# Distance from the newest smoothed position over which the weight of a running mean as a candidate place of staying
# fades out: after a walk, or a step of half a metre, the person stands away from the mean over it.
_MEAN_FADES_M = (0.3, 0.6)
_STRIDE_S = 1.2  # up to this length the age of a track is an input

# Order of the inputs: filters, means and sway, yaws, and nine more.
_OF_YAW_FILTERS = 6 * bank.N_FILTERS + 4 * bank.N_MEANS + np.arange(2 * bank.N_YAW)
_REST = int(_OF_YAW_FILTERS[-1]) + 1
N_INPUTS = _REST + 9
# Inputs that hold the weights of pelvis and head orientation, 0 to 1.
KNOWN = slice(_REST + 3, _REST + 5)
# Inputs that hold the measurement noise: correlation of along and across; logarithms of the standard deviations.
CORRELATION, LOG_SD = _REST, slice(_REST + 5, _REST + 8)
OF_YAWS = np.r_[_OF_YAW_FILTERS, KNOWN]
# Signs of the inputs under a left-right reflection.
MIRROR = np.ones(N_INPUTS)
MIRROR[1 : 6 * bank.N_FILTERS + 3 * bank.N_MEANS : 3] = MIRROR[_OF_YAW_FILTERS] = MIRROR[CORRELATION] = -1.0
N_PLACES, N_VELOCITIES = bank.N_FILTERS + bank.N_MEANS, bank.N_FILTERS + 1
N_SPREAD = 12 + 3 * bank.N_FILTERS


@dataclass(frozen=True)
class WalkerInputs:
    """The line of a track, and the inputs of the networks in the line's frame: along, across and up.

    Attributes:
        time_s: Capture time of the newest observation, seconds.
        origin_base_m: Position of the line at that time, shape (3,), metres.
        velocity_base_m_s: Its velocity, shape (3,), m/s.
        to_base: Rotation from the line's frame to the base frame, shape (3, 3).
        stated_m2: Stated covariance of the position in the base frame, shape (3, 3), square metres; zeros if none is
            stated.
        network: Inputs of the networks, shape (N_INPUTS,), within +-4.
        spread: Inputs of the stated uncertainty, shape (N_SPREAD,).
        places_m: Candidate places of staying relative to the line's origin, shape (N_PLACES, 3), metres: positions of
            the filters; running means, each faded to the first filter's position at 0.3 to 0.6 m from it.
        velocities_m_s: Velocities of the line and of the filters in the line's frame, the latter within 0.6 m/s of the
            first on each axis, shape (N_VELOCITIES, 3), m/s.
        on_foot: Weight of the networks, 0 to 1: 0 at a first frame and at speeds of running or riding, 1 at walking
            speeds and at rest, a ramp between.
    """

    time_s: float
    origin_base_m: FloatArray
    velocity_base_m_s: FloatArray
    to_base: FloatArray
    stated_m2: FloatArray
    network: FloatArray
    spread: FloatArray
    places_m: FloatArray
    velocities_m_s: FloatArray
    on_foot: float


# Parts of the state: filters, means and yaws of the bank; sums of unit vectors and weights of the yaws, for a circular
# mean; age of the track, frame rate in units of 30 Hz, and time of the last frame; white noise.
_PARTS = (bank.SIZES["filter"] * bank.N_FILTERS, bank.SIZES["mean"] * bank.N_MEANS, bank.SIZES["yaw"] * 2, 6, 3)
_WHITE = slice(sum(_PARTS), sum(_PARTS) + bank.WHITE_AT_START.size)


class WalkerHistory:
    """Recursive estimates of one track, and the inputs of the networks from them."""

    def __init__(self) -> None:
        self._state: FloatArray | None = None

    def white_noise_m2(self) -> FloatArray:
        """Estimated covariance of a position's white error, shape (3, 3), square metres."""
        return bank.white_noise_m2(bank.WHITE_AT_START if self._state is None else self._state[_WHITE])

    def add(self, observation: HeadObservation, line: FloatArray, covariance_m2: FloatArray) -> WalkerInputs:
        """Update with an observation and compute the inputs.

        Args:
            observation: The observation, newer than all before it.
            line: Position and velocity of the line's filter at the newest capture time, shape (6,), metres and m/s.
            covariance_m2: Covariance of the observed position, stated or estimated, shape (3, 3), square metres.

        Returns:
            The inputs at its capture time.
        """
        now_s, position_m = observation.capture_time_s, observation.head_position_base_m
        if self._state is None:
            self._state = np.r_[
                bank.at_start(position_m), np.zeros(6), 0.0, 1.0, now_s - bank.USUAL_S, bank.WHITE_AT_START
            ]
        is_stated = observation.position_covariance_m2 is not None
        quats = observation.pelvis_quat_wxyz, observation.head_quat_wxyz
        yaws = [(0.0, 0.0) if quat is None else (yaw_rad(quat), 1.0) for quat in quats]
        seen = np.concatenate([position_m, covariance_m2.ravel(), line, [now_s, is_stated], *yaws])
        self._state, network, spread, places_m, velocities_m_s, to_base, on_foot = _step(self._state, seen)
        inputs = is_stated * covariance_m2, network, spread, places_m.reshape(-1, 3), velocities_m_s.reshape(-1, 3)
        return WalkerInputs(now_s, line[:3], line[3:], to_base.reshape(3, 3), *inputs, float(on_foot[0]))


def _follow(
    i: int, yaw: ca.SX, mounting: ca.SX, seen: ca.SX, dt_s: ca.SX, age_s: ca.SX, heading_rad: ca.SX, walks: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """New states of a yaw and of its mounting, its weight, and weighted angles of the filters to the heading."""
    yaw = bank.followed(yaw, seen[0], seen[1], dt_s, age_s)
    relative_rad = yaw[0] - heading_rad
    weight = seen[1] * walks * ca.fmin(dt_s / bank.USUAL_S, 3.0)
    mounting = mounting + weight * ca.vertcat(ca.cos(relative_rad), ca.sin(relative_rad), 1.0)
    mean_rad = ca.atan2(mounting[1], mounting[0])
    share = bank.ramp(ca.fabs(mean_rad), *_MOUNTING_RAD[i]) * bank.ramp(mounting[2], *_MOUNTING_FRAMES)
    newest_rad = bank.wrap(relative_rad - share * mean_rad)
    known = 1.0 - bank.ramp(ca.fabs(newest_rad), *_NOT_FORWARD_RAD)
    known *= 1.0 - bank.ramp(yaw[1], *_YAW_FADES_S)
    return yaw, mounting, known, walks * known * (newest_rad + yaw[2:])


@bank.Compiled
@cache
def _step() -> ca.Function:
    """Function of state and observation to the new state and the parts of `WalkerInputs`."""
    state, seen = ca.SX.sym("state", _WHITE.stop), ca.SX.sym("seen", 24)
    filters, means, yaws, mountings, clock, white = ca.vertsplit(state, [0, *np.cumsum(_PARTS), _WHITE.stop])
    position_m, noise_m2, origin_m, velocity_m_s = (seen[rows] for rows in np.split(np.arange(18), [3, 12, 15]))
    now_s, is_stated, of_yaws = seen[18], seen[19], seen[20:]
    noise_m2 = ca.reshape(noise_m2, 3, 3)
    speed_m_s = ca.norm_2(velocity_m_s[:2])
    heading_rad = ca.atan2(velocity_m_s[1], velocity_m_s[0])
    c, s = ca.cos(heading_rad), ca.sin(heading_rad)
    to_line = ca.blockcat([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    walks = bank.ramp(speed_m_s, *_WALKS_M_S)

    age_s, rate, last_s = ca.vertsplit(clock)
    dt_s = now_s - last_s
    filters = bank.filtered(ca.reshape(filters, -1, bank.N_FILTERS), position_m, noise_m2, dt_s, age_s, to_line)
    means = bank.averaged(ca.reshape(means, -1, bank.N_MEANS), position_m, dt_s, age_s)
    rate += (bank.USUAL_S - rate * dt_s) / (ca.fmin(age_s, 1.0) + dt_s)
    split = ca.vertsplit(yaws, bank.SIZES["yaw"]), ca.vertsplit(mountings, 3), ca.vertsplit(of_yaws, 2)
    followed = [_follow(i, *each, dt_s, age_s, heading_rad, walks) for i, each in enumerate(zip(*split, strict=True))]
    new_yaws, new_mountings, known, angles_rad = zip(*followed, strict=True)
    # The time before the first frame counts as an interval for the rates, but not for the noise.
    new_white = bank.white_noise(white, position_m, ca.if_else(age_s > 0.0, dt_s, bank.NEVER_S))
    age_s += dt_s
    new_state = ca.vertcat(ca.vec(filters), ca.vec(means), *new_yaws, *new_mountings, age_s, rate, now_s, new_white)

    apart_m, off_m_s = to_line @ (filters[:3, :] - origin_m), to_line @ (filters[3:6, :] - velocity_m_s)
    means_m = to_line @ (means[:3, :] - origin_m)
    sway_m = ca.sqrt(ca.fmax(means[3, :], _LEAST_SWAY_M**2))
    errors = 0.5 * ca.log(filters[-3:, :] + _SMALLEST_RATIO2)
    noise_m2 = to_line @ noise_m2 @ to_line.T
    sd_m = ca.sqrt(ca.fmax(ca.diag(noise_m2), _ROUNDING_M2))
    of_age, frames = ca.fmin(age_s / _STRIDE_S, 1.0), ca.log(ca.fmax(rate, _LEAST_RATE))
    network = ca.vertcat(
        ca.vec(ca.vertcat(apart_m / _POSITION_SCALE_M, off_m_s / _VELOCITY_SCALE_M_S)),
        ca.vec(means_m) / _MEAN_SCALE_M,
        ca.log(sway_m / _SWAY_SCALE_M).T,
        *(angle_rad / scale_rad for angle_rad, scale_rad in zip(angles_rad, _YAW_SCALES_RAD, strict=True)),
        noise_m2[0, 1] / (sd_m[0] * sd_m[1]),
        (speed_m_s - _USUAL_SPEED_M_S) / _SPEED_SCALE_M_S,
        of_age,
        *known,
        ca.log(ca.fmax(sd_m / NOISE_SCALE_M, _SMALLEST_NOISE)),
        frames,
    )
    # The stated covariance enters the forecast's covariance separately, with its principal axes.
    of_stated = 0.5 * ca.log1p(is_stated * ca.diag(noise_m2) / bank.INNOVATION_M**2)
    spread = ca.vertcat(
        1.0,
        *(ca.fmin(ca.fabs(angle_rad[0]), 1.0) for angle_rad in angles_rad),
        ca.fmin(ca.fabs(apart_m[1, 0]) / _POSITION_SCALE_M, _LARGEST),
        1.0 - of_age,
        bank.USUAL_S / ca.fmax(age_s, bank.USUAL_S),
        *(1.0 - each for each in known),
        ca.fmin(speed_m_s, _FAST_M_S) - _USUAL_SPEED_M_S,
        1.0 - walks,
        frames,
        is_stated,
        ca.vec(errors - of_stated),
    )
    on_foot = ca.if_else(speed_m_s > _NO_DIRECTION_M_S, 1.0 - bank.ramp(speed_m_s, *_RUNS_M_S), 0.0)
    network = ca.fmin(ca.fmax(network, -_LARGEST), _LARGEST)
    from_newest_m = means_m - apart_m[:, 0]
    weight = 1.0 - bank.ramp(ca.sqrt(ca.sum1(from_newest_m**2)), *_MEAN_FADES_M)
    places_m = ca.vec(ca.horzcat(apart_m, apart_m[:, 0] + from_newest_m @ ca.diag(weight)))
    # Offsets from the line's velocity, limited, as the inputs, to 4 x 0.15 = 0.6 m/s on each axis.
    limited_m_s = _VELOCITY_SCALE_M_S * ca.reshape(network[: 6 * bank.N_FILTERS], 6, -1)[3:, :]
    velocities_m_s = ca.vec(to_line @ velocity_m_s + ca.horzcat(ca.DM.zeros(3), limited_m_s))
    return ca.Function("step", [state, seen], [new_state, network, spread, places_m, velocities_m_s, to_line, on_foot])
