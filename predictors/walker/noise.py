"""Online estimate of a tracker's error: covariance of the white noise, and spectrum."""

from __future__ import annotations

import math

import numpy as np

from predictors.types import FloatArray

PRIOR_M = 0.01
_PRIOR_FRAMES, _MEMORY_FRAMES = 3.0, 30.0
_LARGEST_M, _SMALLEST_M = 0.05, 0.002
_FLOOR_M2 = _SMALLEST_M**2
_FRAMES = 4
# Longest span of four frames; the third difference over a longer one contains gait. Between the spans at 15 and at
# 14 frames a second, so rounding of the time stamps has no effect.
_SPAN_S = 0.207
# Shortest frame interval of a camera; a shorter one means two mixed sources or a clock step.
STEP_S = 1e-3


def third_difference(a: float, b: float, c: float, d: float) -> tuple[tuple[float, float, float, float], float]:
    """Weights of the third divided difference of four frames.

    Args:
        a: Time of the first frame, seconds; the others follow.
        b: Time of the second.
        c: Time of the third.
        d: Time of the fourth.

    Returns:
        The weight of each frame, and the Euclidean norm of the weights: the gain for white noise.
    """
    weights = (
        1.0 / ((a - b) * (a - c) * (a - d)),
        1.0 / ((b - a) * (b - c) * (b - d)),
        1.0 / ((c - a) * (c - b) * (c - d)),
        1.0 / ((d - a) * (d - b) * (d - c)),
    )
    return weights, math.hypot(*weights)


class MeasuredNoise:
    """Covariance of a position's white error.

    The third divided difference of a walk is small, so its residual is noise. Plain floats: NumPy is several times
    slower for arrays this small.

    Attributes:
        measured_share: Share of measurements in the covariance, 0 to 1; 0 below 14 frames a second. The rest is the
            prior.
    """

    def __init__(self) -> None:
        # xx, xy, xz, yy, yz, zz
        self._covariance_m2 = [PRIOR_M**2, 0.0, 0.0, PRIOR_M**2, 0.0, PRIOR_M**2]
        self._frames, self.measured_share = _PRIOR_FRAMES, 0.0

    def learn(self, times_s: FloatArray, positions_m: FloatArray) -> None:
        """Update with the newest position.

        Args:
            times_s: Times of the track, shape (N,), the newest last, seconds.
            positions_m: Positions, shape (N, 3), metres.
        """
        if times_s.size < _FRAMES:
            return
        a, b, c, d = times_s[-_FRAMES:].tolist()
        if d - a > _SPAN_S or min(b - a, c - b, d - c) < STEP_S:
            return
        (w_a, w_b, w_c, w_d), norm = third_difference(a, b, c, d)
        p, q, r, s = positions_m[-_FRAMES:].tolist()
        x, y, z = ((w_a * p[i] + w_b * q[i] + w_c * r[i] + w_d * s[i]) / norm for i in range(3))
        size2 = x * x + y * y + z * z
        gain = 1.0 / min(_MEMORY_FRAMES, self._frames)
        share = gain if size2 <= 3.0 * _LARGEST_M**2 else gain * 3.0 * _LARGEST_M**2 / size2
        squares = (x * x, x * y, x * z, y * y, y * z, z * z)
        self._covariance_m2 = [
            (1.0 - gain) * known + share * new for known, new in zip(self._covariance_m2, squares, strict=True)
        ]
        self._frames += 1.0
        self.measured_share += gain * (1.0 - self.measured_share)

    def covariance_m2(self) -> FloatArray:
        """Covariance, shape (3, 3), square metres; standard deviation at least 2 mm in any direction."""
        xx, xy, xz, yy, yz, zz = self._covariance_m2
        return np.array([[xx + _FLOOR_M2, xy, xz], [xy, yy + _FLOOR_M2, yz], [xz, yz, zz + _FLOOR_M2]])


_LAGS = (1, 2, 4)
# Rows of the track, counted from its end.
_LAG_ROWS = -np.array([[1 + 3 * lag, 1 + 2 * lag, 1 + lag, 1] for lag in _LAGS])
_THIRD = np.array([-1.0, 3.0, -3.0, 1.0]) / math.sqrt(20.0)  # unit gain for white noise
_COLOUR_MEMORY_FRAMES, _COLOUR_PRIOR_FRAMES = 45.0, 12.0
# Horizontal and vertical position, yaws of pelvis and head: 10 mm and 2 deg.
_UNIT2 = np.array([0.01, 0.01, 0.035, 0.035]) ** 2
_LARGEST_RATIO2, _SMALLEST_RATIO2 = 25.0, 0.01
N_COLOURS = 10


class MeasuredColour:
    """RMS third differences at lags 1, 2 and 4: equal for white noise, growing with the lag for correlated noise."""

    def __init__(self) -> None:
        self._ratio2 = np.ones((len(_LAGS), 4))
        self._frames, self._prior_share = 0, 1.0

    def learn(self, track: FloatArray) -> FloatArray:
        """Update with the newest frame.

        Args:
            track: Positions and yaws of pelvis and head on an even grid, shape (m, 5), the newest last.

        Returns:
            Logarithms of the RMS differences relative to 10 mm and 2 deg, shape (N_COLOURS,): horizontal and vertical
            over each lag, pelvis and head over the shortest and the longest.
        """
        lags = sum(len(track) > 3 * lag for lag in _LAGS)
        if lags:
            differences = _THIRD @ track[_LAG_ROWS[:lags]]
            squares = differences * differences
            squares[:, 1] = 0.5 * (squares[:, 0] + squares[:, 1])
            ratio2 = np.minimum(squares[:, 1:] / _UNIT2, _LARGEST_RATIO2)
            self._frames += 1
            known = self._ratio2[:lags]
            gain = 1.0 / min(self._frames + _COLOUR_PRIOR_FRAMES, _COLOUR_MEMORY_FRAMES)
            known += gain * (ratio2 - known)
            if lags == len(_LAGS):
                self._prior_share *= 1.0 - gain
        logs = 0.5 * np.log(self._ratio2 + _SMALLEST_RATIO2)
        colours = np.empty(N_COLOURS)
        colours[:6] = logs[:, :2].T.ravel()
        colours[6:] = logs[::2, 2:].T.ravel()
        return colours

    def wander_m(self) -> tuple[float, float]:
        """Horizontal third difference over the longest lag, without its prior, and the weight of the measurements.

        Returns:
            RMS difference, metres, infinite before the first measurement; weight of the measurements, 0 to 1.
        """
        share = 1.0 - self._prior_share
        if not share:
            return math.inf, 0.0
        measured = max(float(self._ratio2[-1, 0]) - self._prior_share, 0.0) / share
        return math.sqrt(measured * float(_UNIT2[0])), share


def without_stated(colours: FloatArray, stated_m2: FloatArray) -> FloatArray:
    """Colours relative to the stated error of the tracker.

    Args:
        colours: Result of `MeasuredColour.learn`, shape (N_COLOURS,).
        stated_m2: Stated variances along, across and up, shape (3,), square metres; zeros if none are stated.

    Returns:
        The colours, in which those of the positions are relative to the stated error; shape (N_COLOURS,).
    """
    along, across, up = stated_m2.tolist()
    relative = colours.copy()
    relative[:3] -= 0.5 * math.log1p(0.5 * (along + across) / float(_UNIT2[0]))
    relative[3:6] -= 0.5 * math.log1p(up / float(_UNIT2[1]))
    return relative
