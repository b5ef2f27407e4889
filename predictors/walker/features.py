"""Input features of `Walker`: deviations of the path and of body and head yaw from a line through the last 1.2 s."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np

from predictors.geometry import wrap_rad
from predictors.types import FloatArray, HeadObservation
from predictors.walker.line import N_ERRORS, Line, LineErrors
from predictors.walker.memories import MEMORIES_MIRROR, N_MEMORIES, Memories
from predictors.walker.noise import N_COLOURS, PRIOR_M, MeasuredColour, without_stated
from predictors.walker.window import LAGS_S, STEP_S, WINDOW, TrackWindow

# Ramp of the weight of the direction of travel: it is undefined below the first speed.
_STANDS_BELOW_M_S, _WALKS_ABOVE_M_S = 0.2, 0.5
# Rounding: a slower line, as at a first frame, has no direction.
_NO_DIRECTION_M_S = 1e-6
# Speeds above walking, between which the networks' departure fades out.
_WALKS_BELOW_M_S, _RUNS_ABOVE_M_S = 2.2, 3.0
_YAW_FADES_IN_S = 0.5
_OFFSET_PRIOR_FRAMES = 15.0
# Mean offsets of pelvis and head yaw: larger ones are attributed to the mounting of a sensor or marker and subtracted,
# ramped over these ranges of angle and numbers of frames.
_MOUNTING_RAD, _MOUNTING_FRAMES = ((0.25, 0.4), (0.35, 0.5)), (5.0, 15.0)
# Angle to the direction of travel over which a yaw's weight fades out: sideways or backward walking, or an outlier.
_NOT_FORWARD_RAD = (1.4, 1.9)
# Scales that make each input of order one for walking people.
_POSITION_SCALE_M, _PELVIS_SCALE_RAD, _HEAD_SCALE_RAD, _OFFSET_SCALE_RAD = 0.04, 0.15, 0.2, 0.1
_USUAL_SPEED_M_S, _SPEED_SCALE_M_S, NOISE_SCALE_M = 1.1, 0.3, 0.01
_LARGEST, _SMALLEST_NOISE = 4.0, 0.1
_NOTHING_STATED_M2 = np.zeros(3)
_ROUNDING_M2 = 1e-12  # a stated covariance may be nearly singular

_POSITIONS = slice(0, 3 * WINDOW)
_YAWS = slice(3 * WINDOW, 5 * WINDOW)
_SCALARS = 5 * WINDOW
_ODD_SCALARS = 3  # the first scalars are odd under a left-right reflection
_COLOURS = slice(_SCALARS + 14, _SCALARS + 14 + N_COLOURS)
_MEMORIES = slice(_COLOURS.stop, _COLOURS.stop + N_MEMORIES)
N_INPUTS = _MEMORIES.stop
# Inputs that hold the weights of pelvis and head orientation, 0 to 1.
KNOWN = slice(_SCALARS + 7, _SCALARS + 9)
# Inputs that hold the measurement noise: correlation of along and across; logarithms of the standard deviations.
CORRELATION, LOG_SD = _SCALARS + 2, slice(_SCALARS + 9, _SCALARS + 12)
OF_YAWS = np.r_[_YAWS, _SCALARS : _SCALARS + 2, KNOWN, _COLOURS.start + 6 : _COLOURS.stop]
N_SPREAD = 12 + N_ERRORS + N_COLOURS


# Precise trackers, such as motion capture: ramps from full to zero weight over the white error of the position (at
# least 2 mm, the floor of `MeasuredNoise`) and over third differences of four frames, gait alone there; metres.
# Chosen on 13 walks: trackers with at most 2 mm of white error and 8 to 20 mm of wander have 0.1 % more error in the
# mean, 1.3 % in one walk.
_PRECISE_WHITE_M, _PRECISE_WANDER_M = (0.0025, 0.0032), (0.0065, 0.008)
# Share of measurements in both estimates at which the weight is full: for the wander a quarter of a second. The weight
# is zero below 14 frames a second, where the white error is not measured: with `reference` at 10 Hz the networks for
# precise trackers have 25 % more error.
_MEASURED_SHARE = 0.25


def _mirror() -> FloatArray:
    signs = np.ones(N_INPUTS)
    signs[_POSITIONS][1::3] = -1.0
    signs[_YAWS] = -1.0
    signs[_SCALARS : _SCALARS + _ODD_SCALARS] = -1.0
    signs[_MEMORIES] = MEMORIES_MIRROR
    return signs


# Signs of the inputs under a left-right reflection.
MIRROR = _mirror()


@dataclass(frozen=True)
class WalkerInputs:
    """A line fitted to the recent walk, and the inputs of the networks in the line's frame.

    Attributes:
        line: The line.
        on_foot: Weight of the networks, 0 to 1: 0 at a first frame and at speeds of running or riding, 1 at walking
            speeds and at rest, a ramp between.
        network: Inputs of the network, shape (N_INPUTS,), within +-4.
        spread: Inputs of the stated uncertainty, shape (N_SPREAD,).
        stated_sd_m: Stated standard deviation of the observed position along, across and up, shape (3,), metres; zeros
            if none is stated.
        stated_base_m2: Stated covariance of the position in the base frame, shape (3, 3), square metres.
        line_m_s: Velocity of the line along, across and up, shape (3,).
        places_m: Candidate places of staying relative to the line's origin, along, across and up, shape
            (N_PLACES, 3), metres.
        precise: Weight of the networks for precise trackers, 0 to 1, from the measured or stated error.
    """

    line: Line
    on_foot: float
    network: FloatArray
    spread: FloatArray
    stated_sd_m: FloatArray
    stated_base_m2: FloatArray
    line_m_s: FloatArray
    places_m: FloatArray
    precise: float


class WalkerHistory:
    """The last 1.2 s of one person, and parameters of person and tracker estimated online.

    The parameters are the constant offsets of head and pelvis yaw from the direction of travel, the spectrum of the
    tracker's error, and the errors of the straight-line forecast.
    """

    def __init__(self) -> None:
        self.window = TrackWindow()
        self._offset_sums = [0j, 0j]  # sums of unit vectors: circular mean
        self._offset_weights = [0.0, 0.0]
        self._colour = MeasuredColour()
        self._errors = LineErrors()
        self._memories = Memories()

    def add(
        self, observation: HeadObservation, state: FloatArray, covariance_m2: FloatArray, measured_share: float
    ) -> WalkerInputs:
        """Update with an observation and compute the inputs.

        Args:
            observation: The observation, newer than all before it.
            state: Position and velocity of the line's filter at the capture time, shape (6,), metres and m/s.
            covariance_m2: Covariance of the observed position, shape (3, 3), square metres.
            measured_share: Share of measurements in a covariance that is not stated, see `MeasuredNoise`.

        Returns:
            The inputs at its capture time.
        """
        window = self.window
        last_s = float(window.times_s[-1]) if window.times_s.size else observation.capture_time_s - STEP_S
        fresh = window.add(observation, covariance_m2)
        now_s = observation.capture_time_s
        line = Line(now_s, state[:3], state[3:], math.atan2(state[4], state[3]))
        path, seen = window.on_grid()
        m = len(path)
        speed = math.hypot(state[3], state[4])
        walks = _ramp(speed, _STANDS_BELOW_M_S, _WALKS_ABOVE_M_S)

        x = np.zeros(N_INPUTS)
        to_line = line.to_base()  # rows times this matrix are in the line's frame
        off = path - line.origin_base_m
        off -= LAGS_S[WINDOW - m :, None] * line.velocity_base_m_s
        positions = x[_POSITIONS].reshape(WINDOW, 3)
        np.matmul(off, to_line / _POSITION_SCALE_M, out=positions[WINDOW - m :])
        relative = np.pi - (np.pi - (seen[:, 3:] - line.heading_rad)) % (2.0 * np.pi)
        weight = min((now_s - last_s) / STEP_S, 3.0) * walks
        known, offsets = self._estimate_offsets(relative, fresh, weight, now_s)
        yaws = x[_YAWS].reshape(WINDOW, 2)
        scales = [walks * known[0] / _PELVIS_SCALE_RAD, walks * known[1] / _HEAD_SCALE_RAD]
        np.multiply(relative, scales, out=yaws[WINDOW - m :])

        noise = to_line.T @ covariance_m2 @ to_line
        noise_m2 = noise.diagonal().tolist()
        sd_m = [math.sqrt(max(m2, _ROUNDING_M2)) for m2 in noise_m2]
        log_sd = [math.log(max(sd / NOISE_SCALE_M, _SMALLEST_NOISE)) for sd in sd_m]
        frames = math.log(max(window.times_s.size - 1, 1) / max(m - 1, 1))
        colours = self._colour.learn(seen)
        stated = observation.position_covariance_m2 is not None
        x[_SCALARS : _COLOURS.start] = (
            known[0] * offsets[0] / _OFFSET_SCALE_RAD,
            known[1] * offsets[1] / _OFFSET_SCALE_RAD,
            float(noise[0, 1]) / (sd_m[0] * sd_m[1]),
            (speed - _USUAL_SPEED_M_S) / _SPEED_SCALE_M_S,
            m / WINDOW,
            min(m, 10) / 10,
            walks,
            *known,
            *log_sd,
            float(stated),
            frames,
        )
        x[_COLOURS] = colours
        self._memories.add(now_s, window.values[-1, :3])
        x[_MEMORIES], places_m = self._memories.inputs(line, path[-1])
        np.minimum(np.maximum(x, -_LARGEST, out=x), _LARGEST, out=x)
        newest = relative[-1].tolist()
        # The stated covariance enters the forecast's covariance separately, with its principal axes.
        stated_m2 = noise.diagonal() if stated else _NOTHING_STATED_M2
        of_track = (
            1.0,
            *(known[i] * walks * min(abs(wrap_rad(newest[i] - offsets[i])), 1.0) for i in range(2)),
            min(abs(float(positions[-1, 1])), _LARGEST),
            1.0 - m / WINDOW,
            1.0 / m,
            1.0 - known[0],
            1.0 - known[1],
            min(max(speed - _USUAL_SPEED_M_S, -_USUAL_SPEED_M_S), 0.6),
            1.0 - walks,
            frames,
            float(stated),
        )
        errors = self._errors.learn(path[-1], line, stated_m2)
        spread = np.concatenate([of_track, errors, without_stated(colours, stated_m2)])
        on_foot = 1.0 - _ramp(speed, _WALKS_BELOW_M_S, _RUNS_ABOVE_M_S) if speed > _NO_DIRECTION_M_S else 0.0
        line_m_s = np.array([speed, 0.0, float(state[5])])
        stated_sd_m, stated_base_m2 = (np.array(sd_m), covariance_m2) if stated else (np.zeros(3), np.zeros((3, 3)))
        precise = self._precision(noise_m2, 1.0 if stated else measured_share)
        return WalkerInputs(line, on_foot, x, spread, stated_sd_m, stated_base_m2, line_m_s, places_m, precise)

    def _precision(self, noise_m2: list[float], share: float) -> float:
        measured_m2 = ((m2 - (1.0 - share) * PRIOR_M**2) / max(share, _ROUNDING_M2) for m2 in noise_m2)
        white_m2 = math.prod(max(m2, _ROUNDING_M2) for m2 in measured_m2)
        wander_m, wander_share = self._colour.wander_m()
        weight = 1.0 - _ramp(math.sqrt(white_m2 ** (1.0 / 3.0)), *_PRECISE_WHITE_M)
        weight *= 1.0 - _ramp(wander_m, *_PRECISE_WANDER_M)
        return weight * min(share / _MEASURED_SHARE, wander_share / _MEASURED_SHARE, 1.0)

    def _estimate_offsets(
        self, relative: FloatArray, fresh: list[bool], weight: float, now_s: float
    ) -> tuple[list[float], list[float]]:
        """Estimate the yaw offsets, subtract mountings from `relative`; weight and offset of each yaw."""
        known, offsets = [0.0, 0.0], [0.0, 0.0]
        for i in range(2):
            newest = float(relative[-1, i])
            if fresh[i]:
                self._offset_sums[i] += weight * cmath.rect(1.0, newest)
                self._offset_weights[i] += weight
            total = self._offset_weights[i]
            mean = cmath.phase(self._offset_sums[i])
            mounting = mean * _ramp(abs(mean), *_MOUNTING_RAD[i]) * _ramp(total, *_MOUNTING_FRAMES)
            if mounting != 0.0:
                relative[:, i] = np.pi - (np.pi - (relative[:, i] - mounting)) % (2.0 * np.pi)
                newest = float(relative[-1, i])
            offsets[i] = (mean - mounting) * total / (total + _OFFSET_PRIOR_FRAMES)
            known[i] = 1.0 - _ramp(now_s - self.window.yaw_seen_s[i], 0.0, _YAW_FADES_IN_S)
            known[i] *= 1.0 - _ramp(abs(newest), *_NOT_FORWARD_RAD)
        return known, offsets


def _ramp(value: float, low: float, high: float) -> float:
    return min(max((value - low) / (high - low), 0.0), 1.0)
