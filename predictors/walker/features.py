"""Inputs of `Walker`'s networks: the recursive estimates of a track relative to the line of its filter."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from predictors.geometry import yaw_rad
from predictors.types import FloatArray, HeadObservation
from predictors.walker import bank
from predictors.walker.compiled import Compiled
from predictors.walker.noise import NEVER_S, PRIOR_M, SHARE, WHITE_AT_START, white_noise, white_noise_m2

# Ramp of the weight of the direction of travel: it is undefined below the first speed.
_WALKS_M_S = (0.2, 0.5)
# Rounding: a slower line, as at a first frame, has no direction.
_NO_DIRECTION_M_S = 1e-6
# Speeds above walking, between which the networks' departure fades out.
_RUNS_M_S = (2.2, 3.0)
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
_LARGEST, _SMALLEST_NOISE, _SMALLEST_RATIO2, _LEAST_RATE = 4.0, 0.1, 0.01, 1e-3
# Precise trackers, such as motion capture: ramps from full to zero weight over the white error of the position (at
# least 2 mm, the floor of the estimate) and over the horizontal RMS innovation of the fastest filter, metres.
_PRECISE_WHITE_M, _PRECISE_INNOVATION_M = (0.0025, 0.0032), (0.012, 0.015)
_ROUNDING_M2 = 1e-12  # a stated covariance may be nearly singular
# Lengths of a track, seconds: a stride, and the first frames.
_STRIDE_S, _FIRST_S = 1.2, 0.33

_OF_FILTERS = slice(0, 6 * bank.N_FILTERS)
_OF_MEANS = slice(_OF_FILTERS.stop, _OF_FILTERS.stop + 4 * bank.N_MEANS)
_OF_YAW_FILTERS = slice(_OF_MEANS.stop, _OF_MEANS.stop + 2 * bank.N_YAW)
_SCALARS = _OF_YAW_FILTERS.stop
N_INPUTS = _SCALARS + 12
# Inputs that hold the weights of pelvis and head orientation, 0 to 1.
KNOWN = slice(_SCALARS + 5, _SCALARS + 7)
# Inputs that hold the measurement noise: correlation of along and across; logarithms of the standard deviations.
CORRELATION, LOG_SD = _SCALARS, slice(_SCALARS + 7, _SCALARS + 10)
OF_YAWS = np.r_[_OF_YAW_FILTERS, KNOWN]
N_PLACES = bank.N_FILTERS + bank.N_MEANS
N_SPREAD = 12 + 3 * bank.N_FILTERS


def _mirror() -> FloatArray:
    signs = np.ones(N_INPUTS)
    signs[1 : 6 * bank.N_FILTERS + 3 * bank.N_MEANS : 3] = -1.0
    signs[_OF_YAW_FILTERS] = signs[CORRELATION] = -1.0
    return signs


# Signs of the inputs under a left-right reflection.
MIRROR = _mirror()


@dataclass(frozen=True)
class WalkerInputs:
    """The line of a track, and the inputs of the networks in the line's frame: along, across and up.

    Attributes:
        time_s: Capture time of the newest observation.
        origin_base_m: Position of the line at that time, shape (3,).
        velocity_base_m_s: Its velocity, shape (3,).
        to_base: Rotation from the line's frame to the base frame, shape (3, 3).
        stated_m2: Stated covariance of the position in the base frame, shape (3, 3), square metres; zeros if none is
            stated.
        network: Inputs of the networks, shape (N_INPUTS,), within +-4.
        spread: Inputs of the stated uncertainty, shape (N_SPREAD,).
        places_m: Candidate places of staying relative to the line's origin, shape (N_PLACES, 3), metres.
        line_m_s: Velocity of the line, shape (3,).
        on_foot: Weight of the networks, 0 to 1: 0 at a first frame and at speeds of running or riding, 1 at walking
            speeds and at rest, a ramp between.
        precise: Weight of the networks for precise trackers, 0 to 1, from the measured or stated error.
    """

    time_s: float
    origin_base_m: FloatArray
    velocity_base_m_s: FloatArray
    to_base: FloatArray
    stated_m2: FloatArray
    network: FloatArray
    spread: FloatArray
    places_m: FloatArray
    line_m_s: FloatArray
    on_foot: float
    precise: float


# Parts of the state: filters, means and yaws of the bank; sums of unit vectors and weights of the yaws, for a circular
# mean; age of the track, and frame rate in units of 30 Hz; white noise.
_PARTS = (bank.SIZES["filter"] * bank.N_FILTERS, bank.SIZES["mean"] * bank.N_MEANS, bank.SIZES["yaw"] * 2, 6, 2)
_WHITE = slice(sum(_PARTS), sum(_PARTS) + WHITE_AT_START.size)


class WalkerHistory:
    """Recursive estimates of one track, and the inputs of the networks from them."""

    def __init__(self) -> None:
        self._state: FloatArray | None = None
        self._last_s = 0.0

    def white_noise_m2(self) -> FloatArray:
        """Estimated covariance of a position's white error, shape (3, 3), square metres."""
        return white_noise_m2(WHITE_AT_START if self._state is None else self._state[_WHITE])

    def add(self, observation: HeadObservation, line: FloatArray, covariance_m2: FloatArray) -> WalkerInputs:
        """Update with an observation and compute the inputs.

        Args:
            observation: The observation, newer than all before it.
            line: Position and velocity of the line's filter at the newest capture time, shape (6,), metres and m/s.
            covariance_m2: Covariance of the observed position, shape (3, 3), square metres.

        Returns:
            The inputs at its capture time.
        """
        now_s, position_m = observation.capture_time_s, observation.head_position_base_m
        if self._state is None:
            self._state = np.concatenate([bank.at_start(position_m), np.zeros(7), [1.0], WHITE_AT_START])
            self._last_s = now_s - bank.USUAL_S
        is_stated = observation.position_covariance_m2 is not None
        quats = observation.pelvis_quat_wxyz, observation.head_quat_wxyz
        yaws = [(0.0, 0.0) if quat is None else (yaw_rad(quat), 1.0) for quat in quats]
        scalars = [now_s - self._last_s, is_stated, *yaws[0], *yaws[1]]
        seen = np.concatenate([position_m, covariance_m2.ravel(), line, scalars])
        self._state, network, spread, places_m, frame = _STEP(self._state, seen)
        self._last_s = now_s
        stated_m2 = covariance_m2 if is_stated else _NOT_STATED_M2
        inputs = stated_m2, network, spread, places_m.reshape(N_PLACES, 3), frame[9:12]
        return WalkerInputs(now_s, line[:3], line[3:], frame[:9].reshape(3, 3), *inputs, *frame[12:].tolist())


_NOT_STATED_M2 = np.zeros((3, 3))


@cache
def _step() -> ca.Function:
    """Function of state and observation to the new state and the parts of `WalkerInputs`."""
    state, seen = ca.SX.sym("state", _WHITE.stop), ca.SX.sym("seen", 24)
    filters, means, yaws, mountings, clock, white = ca.vertsplit(state, [0, *np.cumsum(_PARTS), _WHITE.stop])
    position_m, noise_m2, origin_m, velocity_m_s = (seen[rows] for rows in np.split(np.arange(18), [3, 12, 15]))
    dt_s, is_stated, of_yaws = seen[18], seen[19], seen[20:]
    noise_m2 = ca.reshape(noise_m2, 3, 3)
    speed_m_s = ca.norm_2(velocity_m_s[:2])
    heading_rad = ca.atan2(velocity_m_s[1], velocity_m_s[0])
    c, s = ca.cos(heading_rad), ca.sin(heading_rad)
    to_line = ca.blockcat([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    walks = bank.ramp(speed_m_s, *_WALKS_M_S)

    age_s, rate = ca.vertsplit(clock)
    filters = bank.filtered(ca.reshape(filters, -1, bank.N_FILTERS), position_m, noise_m2, dt_s, age_s, to_line)
    means = bank.averaged(ca.reshape(means, -1, bank.N_MEANS), position_m, dt_s, age_s)
    rate += (bank.USUAL_S - rate * dt_s) / (ca.fmin(age_s, 1.0) + dt_s)
    split = ca.vertsplit(yaws, bank.SIZES["yaw"]), ca.vertsplit(mountings, 3), ca.vertsplit(of_yaws, 2)
    followed = [_follow(i, *each, dt_s, age_s, heading_rad, walks) for i, each in enumerate(zip(*split, strict=True))]
    new_yaws, new_mountings, known, angles_rad = zip(*followed, strict=True)
    # The time before the first frame counts as an interval for the rates, but not for the noise.
    new_white = white_noise(white, position_m, ca.if_else(age_s > 0.0, dt_s, NEVER_S))
    age_s += dt_s
    new_state = ca.vertcat(ca.vec(filters), ca.vec(means), *new_yaws, *new_mountings, age_s, rate, new_white)

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
        ca.fmin(age_s / _FIRST_S, 1.0),
        walks,
        *known,
        ca.log(ca.fmax(sd_m / NOISE_SCALE_M, _SMALLEST_NOISE)),
        is_stated,
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
        ca.fmin(ca.fmax(speed_m_s - _USUAL_SPEED_M_S, -_USUAL_SPEED_M_S), 0.6),
        1.0 - walks,
        frames,
        is_stated,
        ca.vec(errors - of_stated),
    )
    innovation_m = bank.INNOVATION_M * ca.sqrt(0.5 * (filters[-3, 0] + filters[-2, 0]))
    precise = _precision(ca.diag(noise_m2), ca.if_else(is_stated, 1.0, white[SHARE]), innovation_m)
    on_foot = ca.if_else(speed_m_s > _NO_DIRECTION_M_S, 1.0 - bank.ramp(speed_m_s, *_RUNS_M_S), 0.0)
    frame = ca.vertcat(ca.vec(to_line), speed_m_s, 0.0, velocity_m_s[2], on_foot, precise)
    network = ca.fmin(ca.fmax(network, -_LARGEST), _LARGEST)
    places_m = ca.vec(ca.horzcat(apart_m, means_m))
    return ca.Function("step", [state, seen], [new_state, network, spread, places_m, frame])


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
    return yaw, mounting, known, walks * known * ca.vertcat(newest_rad + yaw[2:-2], yaw[-2:])


def _precision(noise_m2: ca.SX, measured: ca.SX, innovation_m: ca.SX) -> ca.SX:
    """Weight of the networks for precise trackers, from a white error of which a share is measured."""
    white_m2 = (noise_m2 - (1.0 - measured) * PRIOR_M**2) / measured
    x_m2, y_m2, z_m2 = ca.vertsplit(ca.fmax(white_m2, _ROUNDING_M2))
    weight = 1.0 - bank.ramp((x_m2 * y_m2 * z_m2) ** (1.0 / 6.0), *_PRECISE_WHITE_M)
    weight *= 1.0 - bank.ramp(innovation_m, *_PRECISE_INNOVATION_M)
    # The white error is not measured below 15 frames a second; there the networks for precise trackers have 25 % more
    # error (`reference` at 10 Hz).
    return ca.if_else(measured > 0.0, weight, 0.0)


_STEP = Compiled(_step)
