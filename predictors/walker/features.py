"""What `Walker` reads of the last second: a line through the walk, and how body and head depart from it."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np

from predictors.types import FloatArray, HeadObservation
from predictors.walker.colour import ErrorColour
from predictors.walker.errors import ForecastMemory
from predictors.walker.noise import MeasuredNoise
from predictors.walker.smoothing import smooth_path
from predictors.yaw import wrap_rad, yaw_rad

STEP_S = 1.0 / 30.0
# A little more than a stride (two steps, about 1 s): sway and bob are seen whole.
WINDOW = 36
_LAGS_S = STEP_S * np.arange(1 - WINDOW, 1)
_FIRST_LAG_S = float(_LAGS_S[0])
# Acceleration of the path that the network sees: lets gait through (1.2 m/s2 of sway at 1 Hz), and little more.
_PATH_PSD = 5.0
# The line: constant velocity, with gait (s.d. of sway and bob) counted as noise of the positions.
_LINE_PSD, _GAIT_SD_M = 0.05, 0.02
# A position this many standard deviations off the path counts half: tails of a t distribution.
_HALF_AT_SD = 3.0
_ROBUST_FLOOR_M = 0.01
# Below the first speed a direction of travel means nothing; from the second on it is trusted.
_STANDS_BELOW_M_S, _WALKS_ABOVE_M_S = 0.2, 0.5
# Nobody walks that fast; what was learned of walkers fades out for runners and riders.
_WALKS_BELOW_M_S, _RUNS_ABOVE_M_S = 2.2, 3.0
_YAW_FADES_IN_S = 0.5
_OFFSET_PRIOR_FRAMES = 15.0
# A person's own offset, of pelvis and of head, is less than this; a larger one is how a sensor or a marker is mounted,
# and is taken away once it has been seen for a while.
_MOUNTING_RAD, _MOUNTING_FRAMES = ((0.25, 0.4), (0.35, 0.5)), (5.0, 15.0)
# Whose body or head points farther aside walks sideways or backwards, or is measured wrongly.
_NOT_FORWARD_RAD = (1.4, 1.9)
# Each input is of order one over walking people.
_POSITION_SCALE_M, _PELVIS_SCALE_RAD, _HEAD_SCALE_RAD, _OFFSET_SCALE_RAD = 0.04, 0.15, 0.2, 0.1
_USUAL_SPEED_M_S, _SPEED_SCALE_M_S, _NOISE_SCALE_M = 1.1, 0.3, 0.01
_LARGEST = 4.0

_POSITIONS = slice(0, 3 * WINDOW)
_YAWS = slice(3 * WINDOW, 5 * WINDOW)
_SCALARS = 5 * WINDOW
_ODD_SCALARS = (0, 1, 2)
_N_SCALARS = 24
N_INPUTS = _SCALARS + _N_SCALARS
N_SPREAD = 30


def _mirror() -> FloatArray:
    signs = np.ones(N_INPUTS)
    signs[_YAWS] = -1.0
    for i in _ODD_SCALARS:
        signs[_SCALARS + i] = -1.0
    signs[_POSITIONS][1::3] = -1.0
    return signs


# The network's inputs for the same walk with left and right exchanged: these signs times the inputs.
MIRROR = _mirror()


@dataclass(frozen=True)
class WalkerInputs:
    """A line through the recent walk, and the inputs of the network in the line's frame (along, across, up).

    Attributes:
        time_s: Capture time of the newest observation.
        origin_base_m: Point of the line at that time, shape (3,).
        velocity_base_m_s: Slope of the line, shape (3,).
        heading_rad: Horizontal direction of the slope, about the vertical from +x.
        walking: 0 for somebody who runs, 1 for somebody who walks or stands, between the two at the limits.
        network: Inputs of the network, shape (N_INPUTS,), within +-4.
        spread: Inputs of the stated uncertainty, shape (N_SPREAD,).
    """

    time_s: float
    origin_base_m: FloatArray
    velocity_base_m_s: FloatArray
    heading_rad: float
    walking: float
    network: FloatArray
    spread: FloatArray


class WalkerHistory:
    """The last 1.2 s of one person, whatever the frame rate and the gaps, with what was learned of them on the way.

    On the way means: the constant offsets of head and pelvis yaw from the direction of travel, which differ from
    person to person, the noise of the positions, and how far the line's own forecasts were off.
    """

    def __init__(self) -> None:
        self._times_s = np.empty(0)
        self._values = np.empty((0, 5))  # x, y, z, pelvis yaw, head yaw; the yaws unwrapped, the last known one held
        self._information = np.empty((0, 3, 3))
        self._weights = np.empty(0)
        self._yaw_seen_s = [-np.inf, -np.inf]
        self._offset_sums = [0j, 0j]  # unit vectors, so that an offset near pi has a mean
        self._offset_weights = [0.0, 0.0]
        self._noise = MeasuredNoise()
        self._errors = ForecastMemory()
        self._colour = ErrorColour()
        self._line: tuple[float, FloatArray, FloatArray] | None = None

    def add(self, observation: HeadObservation) -> WalkerInputs:
        """Take in an observation that is newer than all before it.

        Args:
            observation: The observation.

        Returns:
            The inputs at its capture time.
        """
        time_s = observation.capture_time_s
        position = observation.head_position_base_m
        yaws_rad = self._values[-1, 3:].tolist() if len(self._values) else [0.0, 0.0]
        fresh = [False, False]
        for i, quat in enumerate((observation.pelvis_quat_wxyz, observation.head_quat_wxyz)):
            if quat is not None:
                yaws_rad[i] += wrap_rad(yaw_rad(quat) - yaws_rad[i])
                self._bridge(3 + i, self._yaw_seen_s[i], yaws_rad[i], time_s)
                self._yaw_seen_s[i] = time_s
                fresh[i] = True
        last_s = float(self._times_s[-1]) if self._times_s.size else time_s - STEP_S
        # In this order: whether a frame right at the end of the window stays hangs on the last bit.
        old = int(self._times_s.searchsorted(time_s + _FIRST_LAG_S - 1e-6))
        self._times_s = np.concatenate([self._times_s[old:], [time_s]])
        self._values = np.concatenate([self._values[old:], [[*position.tolist(), *yaws_rad]]])
        self._noise.learn(self._times_s, self._values[:, :3])
        covariance = observation.position_covariance_m2
        stated = covariance is not None
        covariance = self._noise.covariance_m2() if covariance is None else covariance
        self._information = np.concatenate([self._information[old:], np.linalg.inv(covariance)[None]])
        self._weights = np.append(self._weights[old:], self._first_weight(time_s, position, covariance))
        return self._inputs(fresh, min((time_s - last_s) / STEP_S, 3.0), covariance, stated)

    def _bridge(self, column: int, seen_s: float, value: float, time_s: float) -> None:
        # Where an orientation was missing it was held; now that it is back, the way between is known better.
        if not self._times_s.size or self._times_s[-1] <= seen_s:
            return
        missing = self._times_s > seen_s
        if seen_s == -np.inf:
            self._values[:, column] = value
        else:
            held = self._values[missing, column]
            self._values[missing, column] += (self._times_s[missing] - seen_s) / (time_s - seen_s) * (value - held)

    def _first_weight(self, time_s: float, position_m: FloatArray, covariance_m2: FloatArray) -> float:
        if self._line is None:
            return 1.0
        line_s, origin, velocity = self._line
        dt_s = time_s - line_s
        off = position_m - origin - dt_s * velocity
        # Gait and a turn that has begun: 5 m/s2 is more than anybody does.
        spread = covariance_m2 + (4 * _GAIT_SD_M**2 + (2.5 * dt_s**2) ** 2) * np.eye(3)
        return 1.0 / (1.0 + float(off @ np.linalg.solve(spread, off)) / _HALF_AT_SD**2 / 3.0)

    def _resampled(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, int]:
        """Path, line's origin and slope, yaws on the grid, and the frames that the track reaches back."""
        times, values = self._times_s, self._values
        m = min(WINDOW, 1 + math.ceil((times[-1] - times[0]) / STEP_S - 0.03))
        if m == 1:
            self._colours = self._colour.learn(values[-1:])
            return values[-1:, :3], values[-1, :3], np.zeros(3), values[-1:, 3:], 1
        at = np.maximum((times - times[-1]) / STEP_S + (m - 1), 0.0)
        y = values[:, :3]
        psd, line_psd = (_PATH_PSD, STEP_S), (_LINE_PSD, STEP_S)
        path = smooth_path(at, y, self._weights[:, None, None] * self._information, psd, m)
        # Positions that lie far off the path are believed less, and the path is made again.
        left = np.minimum(at.astype(np.intp), m - 2)
        share = (at - left)[:, None]
        off = y - path[left] - share * (path[left + 1] - path[left])
        covariance = np.linalg.inv(self._information)
        diagonal = np.arange(3)
        floored = covariance.copy()
        floored[:, diagonal, diagonal] += _ROBUST_FLOOR_M**2
        d2 = np.einsum("ni,ni->n", off, np.linalg.solve(floored, off[:, :, None])[:, :, 0])
        self._weights = 1.0 / (1.0 + d2 / (3.0 * _HALF_AT_SD**2))
        path = smooth_path(at, y, self._weights[:, None, None] * self._information, psd, m)
        covariance[:, diagonal, diagonal] += _GAIT_SD_M**2
        line = smooth_path(at, y, self._weights[:, None, None] * np.linalg.inv(covariance), line_psd, m)
        grid = times[-1] + _LAGS_S[WINDOW - m :]
        raw = np.stack([np.interp(grid, times, values[:, i]) for i in range(5)], axis=1)
        yaws = raw[:, 3:]
        self._colours = self._colour.learn(raw)
        return path, line[-1], (line[-1] - line[-2]) / STEP_S, yaws, m

    def _inputs(self, fresh: list[bool], frames: float, covariance: FloatArray, stated: bool) -> WalkerInputs:
        path, origin, velocity, window_yaws, m = self._resampled()
        now_s = float(self._times_s[-1])
        self._line = now_s, origin, velocity
        heading = math.atan2(velocity[1], velocity[0])
        speed = math.hypot(velocity[0], velocity[1])
        walks = _ramp(speed, _STANDS_BELOW_M_S, _WALKS_ABOVE_M_S)
        c, s = math.cos(heading), math.sin(heading)
        to_line = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

        x = np.zeros(N_INPUTS)
        positions = x[_POSITIONS].reshape(WINDOW, 3)
        yaws = x[_YAWS].reshape(WINDOW, 2)
        off = path - origin - _LAGS_S[WINDOW - m :, None] * velocity
        positions[WINDOW - m :] = off @ (to_line / _POSITION_SCALE_M)
        relative = np.pi - (np.pi - (window_yaws - heading)) % (2.0 * np.pi)
        newest = relative[-1].tolist()
        known, offsets = [0.0, 0.0], [0.0, 0.0]
        for i, scale in enumerate((_PELVIS_SCALE_RAD, _HEAD_SCALE_RAD)):
            if fresh[i]:
                self._offset_sums[i] += frames * walks * cmath.rect(1.0, newest[i])
                self._offset_weights[i] += frames * walks
            weight = self._offset_weights[i]
            mean = cmath.phase(self._offset_sums[i])
            mounting = mean * _ramp(abs(mean), *_MOUNTING_RAD[i]) * _ramp(weight, *_MOUNTING_FRAMES)
            if mounting != 0.0:
                relative[:, i] = np.pi - (np.pi - (relative[:, i] - mounting)) % (2.0 * np.pi)
                newest[i] = float(relative[-1, i])
            offsets[i] = (mean - mounting) * weight / (weight + _OFFSET_PRIOR_FRAMES)
            known[i] = 1.0 - _ramp(now_s - self._yaw_seen_s[i], 0.0, _YAW_FADES_IN_S)
            known[i] *= 1.0 - _ramp(abs(newest[i]), *_NOT_FORWARD_RAD)
            yaws[WINDOW - m :, i] = (walks * known[i] / scale) * relative[:, i]
        noise = to_line.T @ covariance @ to_line
        sd = np.sqrt(noise.diagonal()) / _NOISE_SCALE_M
        log_sd = np.log(np.maximum(sd, 0.1))
        skew = float(noise[0, 1] / math.sqrt(noise[0, 0] * noise[1, 1]))
        wrong = self._errors.learn(self._times_s, path[-1], now_s, origin, velocity, to_line)
        rate = math.log(max(len(self._times_s) - 1, 1) / max(m - 1, 1))
        x[_SCALARS:] = (
            known[0] * offsets[0] / _OFFSET_SCALE_RAD,
            known[1] * offsets[1] / _OFFSET_SCALE_RAD,
            skew,
            (speed - _USUAL_SPEED_M_S) / _SPEED_SCALE_M_S,
            m / WINDOW,
            min(m, 10) / 10,
            walks,
            known[0],
            known[1],
            *log_sd,
            float(stated),
            rate,
            *self._colours,
        )
        np.minimum(np.maximum(x, -_LARGEST, out=x), _LARGEST, out=x)
        departure = [known[i] * walks * min(abs(wrap_rad(newest[i] - offsets[i])), 1.0) for i in range(2)]
        spread = np.array(
            [
                1.0,
                departure[0],
                departure[1],
                min(abs(float(positions[-1, 1])), _LARGEST),
                *log_sd,
                1.0 - m / WINDOW,
                1.0 / m,
                1.0 - known[0],
                1.0 - known[1],
                min(max(speed - _USUAL_SPEED_M_S, -1.1), 0.6),
                1.0 - walks,
                rate,
                *wrong,
            *self._colours,
            ]
        )
        walking = 1.0 - _ramp(speed, _WALKS_BELOW_M_S, _RUNS_ABOVE_M_S)
        return WalkerInputs(now_s, origin, velocity, heading, walking, x, spread)


def _ramp(value: float, low: float, high: float) -> float:
    return min(max((value - low) / (high - low), 0.0), 1.0)
