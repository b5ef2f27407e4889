"""What `Walker` reads of the last second: a line through the walk, and how body and head depart from it."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from predictors.types import FloatArray, HeadObservation
from predictors.yaw import wrap_rad, yaw_rad

STEP_S = 1.0 / 30.0
# A little more than a stride (two steps, about 1 s): sway and bob are seen whole.
WINDOW = 36
# The direction of the line: two thirds of a second averages most of the sway and still follows a turn.
LINE_WINDOW = 20
RECENT = 12
_LAGS_S = STEP_S * np.arange(1 - WINDOW, 1)
_FIRST_LAG_S = float(_LAGS_S[0])
# Shrinks the slope while there are few frames: noise of 2 cm against a speed of 1 m/s.
_LINE_PRIOR_S2 = 0.02**2
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
_NOISE_PRIOR_M, _NOISE_PRIOR_FRAMES, _NOISE_MEMORY_FRAMES = 0.01, 3.0, 30.0
_LARGEST_NOISE_M = 0.05
# Four frames farther apart than this bend with the walk itself, and say nothing of noise. Between the spans of four
# frames at 15 and at 14 frames a second, so that rounding does not decide.
_NOISE_SPAN_S = 0.207
# Frames closer together than any camera's: two sources, or a clock that was set.
_NOISE_STEP_S = 1e-3
# Each input is of order one over walking people.
_POSITION_SCALE_M, _PELVIS_SCALE_RAD, _HEAD_SCALE_RAD, _OFFSET_SCALE_RAD = 0.04, 0.15, 0.2, 0.1
_USUAL_SPEED_M_S, _SPEED_SCALE_M_S, _NOISE_SCALE_M = 1.1, 0.3, 0.01
_LARGEST = 4.0

_POSITIONS = slice(0, 3 * WINDOW)
_YAWS = slice(3 * WINDOW, 5 * WINDOW)
_SCALARS = 5 * WINDOW
_N_SCALARS = 9
_DETAIL = _SCALARS + _N_SCALARS
N_INPUTS = _DETAIL + 5 * RECENT
N_SPREAD = 10


def _mirror() -> FloatArray:
    signs = np.ones(N_INPUTS)
    signs[_YAWS] = -1.0
    signs[_SCALARS : _SCALARS + 2] = -1.0
    signs[_DETAIL + 3 * RECENT :] = -1.0
    for positions in (signs[_POSITIONS], signs[_DETAIL : _DETAIL + 3 * RECENT]):
        positions[1::3] = -1.0
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
        walking: 0 for somebody who stands (or runs), 1 for somebody who walks, between the two at the limits.
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
    person to person, and the noise of the positions.
    """

    def __init__(self) -> None:
        self._times_s = np.empty(0)
        self._values = np.empty((0, 5))  # x, y, z, pelvis yaw, head yaw; the yaws unwrapped, the last known one held
        self._yaw_seen_s = [-np.inf, -np.inf]
        self._offset_sums = [0j, 0j]  # unit vectors, so that an offset near pi has a mean
        self._offset_weights = [0.0, 0.0]
        self._noise_variance_m2 = _NOISE_PRIOR_M**2
        self._noise_frames = _NOISE_PRIOR_FRAMES

    def add(self, observation: HeadObservation) -> WalkerInputs:
        """Take in an observation that is newer than all before it.

        Args:
            observation: The observation.

        Returns:
            The inputs at its capture time.
        """
        time_s = observation.capture_time_s
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
        old = int(self._times_s.searchsorted(time_s + _FIRST_LAG_S - STEP_S))
        self._times_s = np.concatenate([self._times_s[old:], [time_s]])
        self._values = np.concatenate([self._values[old:], [[*observation.head_position_base_m.tolist(), *yaws_rad]]])
        self._learn_noise()
        return self._inputs(fresh, min((time_s - last_s) / STEP_S, 3.0))

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

    def _learn_noise(self) -> None:
        # The third divided difference of a walk is next to nothing, so what is left of it is noise.
        if self._times_s.size < 4:
            return
        a, b, c, d = self._times_s[-4:].tolist()
        if d - a > _NOISE_SPAN_S or min(b - a, c - b, d - c) < _NOISE_STEP_S:
            return
        weights = np.array(
            [
                1.0 / ((a - b) * (a - c) * (a - d)),
                1.0 / ((b - a) * (b - c) * (b - d)),
                1.0 / ((c - a) * (c - b) * (c - d)),
                1.0 / ((d - a) * (d - b) * (d - c)),
            ]
        )
        difference = weights @ self._values[-4:, :3]
        variance = float(difference @ difference) / 3.0 / float(weights @ weights)
        gain = 1.0 / min(_NOISE_MEMORY_FRAMES, self._noise_frames)
        self._noise_variance_m2 += gain * (min(variance, _LARGEST_NOISE_M**2) - self._noise_variance_m2)
        self._noise_frames += 1.0

    def _resampled(self) -> tuple[FloatArray, int]:
        """The window on an even grid, shape (m, 5), newest last, and m, the frames that the track reaches back."""
        times, values = self._times_s, self._values
        m = min(WINDOW, 1 + int((times[-1] - times[0]) / STEP_S + 0.03))
        if m == 1:
            return values[-1:], 1
        grid = times[-1] + _LAGS_S[WINDOW - m :]
        right = np.minimum(np.maximum(times.searchsorted(grid), 1), times.size - 1)
        left = right - 1
        begin_s, low = times[left], values[left]
        share = np.maximum((grid - begin_s) / (times[right] - begin_s), 0.0)
        return low + share[:, None] * (values[right] - low), m

    def _inputs(self, fresh: list[bool], frames: float) -> WalkerInputs:
        window, m = self._resampled()
        slope, slope_of_all, value, value_of_all = (_line(m) @ window[:, :3]).tolist()
        # Height over the whole window: it has two bobs or more, and people turn to the side, not upwards.
        velocity, origin = np.array([[slope[0], slope[1], slope_of_all[2]], [value[0], value[1], value_of_all[2]]])
        heading = math.atan2(slope[1], slope[0])
        speed = math.hypot(slope[0], slope[1])
        walks = _ramp(speed, _STANDS_BELOW_M_S, _WALKS_ABOVE_M_S)
        c, s = math.cos(heading) / _POSITION_SCALE_M, math.sin(heading) / _POSITION_SCALE_M
        to_line = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0 / _POSITION_SCALE_M]])
        now_s = float(self._times_s[-1])

        x = np.zeros(N_INPUTS)
        positions = x[_POSITIONS].reshape(WINDOW, 3)
        yaws = x[_YAWS].reshape(WINDOW, 2)
        off = window[:, :3] - origin
        off -= _LAGS_S[WINDOW - m :, None] * velocity
        positions[WINDOW - m :] = off @ to_line
        relative = np.pi - (np.pi - (window[:, 3:] - heading)) % (2.0 * np.pi)
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
        noise = math.sqrt(self._noise_variance_m2) / _NOISE_SCALE_M
        x[_SCALARS:_DETAIL] = (
            known[0] * offsets[0] / _OFFSET_SCALE_RAD,
            known[1] * offsets[1] / _OFFSET_SCALE_RAD,
            (speed - _USUAL_SPEED_M_S) / _SPEED_SCALE_M_S,
            m / WINDOW,
            min(m, 10) / 10,
            noise,
            walks,
            known[0],
            known[1],
        )
        # The less noise there is, the more the newest frames tell; the network has them a second time, so weighted.
        detail = max(0.0, 1.0 - noise)
        x[_DETAIL : _DETAIL + 3 * RECENT] = detail * positions[-RECENT:].ravel()
        x[_DETAIL + 3 * RECENT :] = detail * yaws[-RECENT:].ravel()
        np.minimum(np.maximum(x, -_LARGEST, out=x), _LARGEST, out=x)
        departure = [known[i] * walks * min(abs(wrap_rad(newest[i] - offsets[i])), 1.0) for i in range(2)]
        spread = np.array(
            [
                1.0,
                departure[0],
                departure[1],
                min(abs(float(positions[-1, 1])), _LARGEST),
                min(noise, 2.0),
                1.0 - m / WINDOW,
                1.0 / m,
                1.0 - known[0],
                1.0 - known[1],
                min(max(speed - _USUAL_SPEED_M_S, -0.6), 0.6),
            ]
        )
        walking = walks * (1.0 - _ramp(speed, _WALKS_BELOW_M_S, _RUNS_ABOVE_M_S))
        return WalkerInputs(now_s, origin, velocity, heading, walking, x, spread)


@cache
def _line(m: int) -> FloatArray:
    """Weights of the last m frames on the grid for a line with a slope shrunk towards zero.

    Returns:
        Shape (4, m): slope over `LINE_WINDOW`, slope over all m, and the line's value now, of the one and of the other.
    """
    slopes, values = np.zeros((2, m)), np.zeros((2, m))
    for i, frames in enumerate((min(m, LINE_WINDOW), m)):
        t = _LAGS_S[WINDOW - frames :]
        slopes[i, m - frames :] = (t - t.mean()) / (np.sum((t - t.mean()) ** 2) + _LINE_PRIOR_S2)
        values[i, m - frames :] = 1.0 / frames
        values[i] -= t.mean() * slopes[i]
    return np.concatenate([slopes, values])


def _ramp(value: float, low: float, high: float) -> float:
    return min(max((value - low) / (high - low), 0.0), 1.0)
