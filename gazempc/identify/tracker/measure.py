"""All errors of a tracker from one track: white error, wander, jumps, yaws, times and latency.

The errors of a direction follow from the variances of second differences over several lags. With white error r, wander
w of correlation time c (an Ornstein-Uhlenbeck process) and a person driven by white acceleration q, the variance at
lag h is

``6 r^2 + w^2 (6 - 8 exp(-h / c) + 2 exp(-2 h / c)) + 2/3 q^2 h^3``
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d, uniform_filter1d
from scipy.optimize import least_squares

from gazempc.identify.tracker.read import HeadTrack
from gazempc.identify.tracker.timing import FrameTimes, frame_times
from gazempc.types import BoolArray, FloatArray, IntArray

Groups = tuple[tuple[int, ...], ...]
# A person within these limits for this long stands or sits still. A wander of 30 mm across the line of sight, or of
# 5 % of the range, stays within them, too.
_STILL_S = 4.0
_ACROSS_M, _ALONG_SHARE, _ALONG_M = 0.12, 0.2, 0.3
_YAW_RAD = np.deg2rad(40.0)
_SMOOTH_S = 0.7
# Weak beliefs, as centre and s.d. of the logarithm: of the person's acceleration (m s^-1.5; 0.02 in the sway of a
# person who stands, 1 in walking), of the wander over the white error, and of its correlation time in seconds.
_ACCELERATION, _WANDER_RATIO, _CORRELATION_S = (np.log(0.2), 1.5), (0.0, 1.5), (0.0, 1.0)
# Half of the drop of the squared residuals that the two parameters of a wander must bring.
_WANDER_GAIN = 2.0
# Lags up to this, and up to this share of the track: a wander of two seconds shows there.
_LAGS, _LONGEST_LAG_S, _LAG_SHARE = 16, 4.0, 1 / 8
# The path of a person who walks is smooth: at longer lags its second differences grow faster than the model's.
_WALKING_LAG_S = 0.3
_FEWEST_DIFFERENCES = 20
# Overlapping second differences hold about this share of independent ones a lag.
_INDEPENDENT = 0.4
# A normal error is larger once in 150,000 frames and axes.
_GATE = 4.5
# Errors have longer tails than normal ones: within this gate they count for the standard deviation.
_OUTER_GATE = 8.0
_NORMAL = 1.4826  # standard deviation of a normal distribution over its median absolute deviation
# Jumps are found against the median of the path over this time.
_JUMP_WINDOW_S = 1.0
# Each frame of a jump, also the first, is at least this share of its size away. A person starts to move more slowly.
_STEP_SHARE = 0.5
# The variance of third differences of white noise is this many times its own. If the fitted white error is below this
# share of theirs, the person's motion or the tracker's smoothing hides it.
_THIRD_DIFFERENCES, _HIDDEN = 20.0, 0.4
_LEAST = 1e-5
# A shorter time is too short to estimate a wander of one second.
_STILL_MIN_S = 8.0
# A wander is known from this many of its correlation times on.
_CORRELATIONS = 8.0
# Heads of people who stand sway by 5 to 10 mm (s.d.; assumed): less is no error of a tracker.
_SWAY_M = 0.01
# A shorter delay comes from the recorder. A longer one means that the clocks differ.
_DELAY_MIN_S, _DELAY_MAX_S = 0.005, 5.0
# A jump counts as across the line of sight if its size there is beyond this share of its size along it.
_SIDEWAYS = 0.3
# A yaw that turns by more than this from frame to frame was flipped, not turned.
_FLIP_RAD = np.deg2rad(150.0)


@dataclass(frozen=True)
class Known:
    """A value and its standard deviation."""

    value: float
    sd: float


@dataclass(frozen=True)
class GroupFit:
    """Errors of one group of axes, in the unit of its values.

    Attributes:
        white: Standard deviation of the white error.
        wander: Standard deviation of the wander; None where the data show none.
        correlation_s: Its correlation time, seconds; None likewise.
        hidden: Whether the white error is an upper bound: the person's motion hides it, or the tracker smooths it away.
    """

    white: Known
    wander: Known | None
    correlation_s: Known | None
    hidden: bool = False


@dataclass(frozen=True)
class TrackJumps:
    """Jumps of a track: frames far from the path of the frames before and after.

    Attributes:
        durations_s: Of each, shape (K,), seconds; 0 for a single frame.
        sizes: Root mean square of each on each axis, in the unit of the values, shape (K, A).
    """

    durations_s: FloatArray
    sizes: FloatArray


@dataclass(frozen=True)
class DirectionError:
    """Error in one direction, or of a yaw.

    Attributes:
        fit: The fit, as a share of the range or in radians.
        wander: `known`, `none` (the data show none, or no more than a person's sway), or `unknown` (the person moved).
    """

    fit: GroupFit
    wander: Literal["known", "none", "unknown"]


@dataclass(frozen=True)
class YawErrors:
    """Errors of one yaw.

    Attributes:
        error: White error and wander, radians.
        known_share: Share of frames in which the yaw is known.
        flips: How often it turned by 180 degrees from one frame to the next.
        used_s: Seconds that were used.
    """

    error: DirectionError
    known_share: float
    flips: int
    used_s: float


@dataclass(frozen=True)
class TrackerErrors:
    """Measured errors of a tracker.

    Attributes:
        frames: Rate, jitter and losses.
        along: Error of the range, shares of it.
        across: Error of the bearing on each of its two axes, radians.
        jumps: Jumps of the track; sizes are shares of the range and radians.
        used_s: Seconds of data used for the position errors.
        still_s: Seconds in which the person stood or sat still.
        range_m: Least, median and largest range, shape (3,), metres.
        head_yaw: None where it is not known.
        pelvis_yaw: None where it is not known.
        delay_s: Median from stamp to arrival, seconds; None where unknown.
    """

    frames: FrameTimes
    along: DirectionError
    across: DirectionError
    jumps: TrackJumps
    used_s: float
    still_s: float
    range_m: FloatArray
    head_yaw: YawErrors | None
    pelvis_yaw: YawErrors | None
    delay_s: float | None

    @property
    def moved(self) -> bool:
        """Whether the person moved too much to separate the tracker's wander from the motion."""
        return self.still_s < _STILL_MIN_S

    @property
    def latency_s(self) -> float | None:
        """Latency, as far as it is measured: a shorter delay is that of the recorder alone."""
        return self.delay_s if self.delay_s is not None and _DELAY_MIN_S < self.delay_s < _DELAY_MAX_S else None

    @property
    def jump_sizes_m(self) -> tuple[FloatArray, FloatArray]:
        """How far each jump goes along and across the line of sight, each of shape (K,), metres."""
        sizes_m = self.jumps.sizes * self.range_m[1]
        return sizes_m[:, 0], np.hypot(sizes_m[:, 1], sizes_m[:, 2])

    @property
    def jumps_across(self) -> bool:
        """Whether jumps go across the line of sight as well as along it, farther than a person sways."""
        along_m, across_m = self.jump_sizes_m
        return bool(along_m.size and np.median(across_m) > max(_SWAY_M, _SIDEWAYS * np.median(along_m)))


def measure_tracker(track: HeadTrack, tell: Callable[[float], None]) -> TrackerErrors:
    """Measure a tracker.

    Args:
        track: Track of one person.
        tell: Called with the share that is done, 0 to 1.

    Returns:
        Its errors.
    """
    values = along_and_across(track.position_m)
    times_s, range_m = track.times_s, np.exp(values[:, 0])
    stands = still(times_s, values)
    still_s = _duration_s(times_s, stands)
    chosen = stands if (is_still := still_s >= _STILL_MIN_S) else np.ones(times_s.size, dtype=np.bool_)
    used_s = _duration_s(times_s, chosen)
    middle_m = float(np.median(range_m))
    fits, jumps = _fit_errors(times_s[chosen], values[chosen], ((0,), (1, 2)), middle_m, is_still)
    along, across = (_direction(fit, used_s, not is_still, _SWAY_M / middle_m) for fit in fits)
    tell(0.6)
    head = _yaw(times_s, track.head_yaw_rad, stands)
    tell(0.8)
    pelvis = _yaw(times_s, track.pelvis_yaw_rad, stands)
    return TrackerErrors(
        frames=frame_times(times_s),
        along=along,
        across=across,
        jumps=jumps,
        used_s=used_s,
        still_s=still_s,
        range_m=np.array([range_m.min(), middle_m, range_m.max()]),
        head_yaw=head,
        pelvis_yaw=pelvis,
        delay_s=None if track.delays_s is None else float(np.median(track.delays_s)),
    )


def along_and_across(position_m: FloatArray) -> FloatArray:
    """Logarithm of the range, and both angles of the bearing.

    Small changes of the first value are shares of the range. Those of the others are angles at the sensor, radians.

    Args:
        position_m: Shape (N, 3), metres, the sensor at the origin.

    Returns:
        Shape (N, 3).
    """
    x, y, z = position_m.T
    up = np.arctan2(z, np.hypot(x, y))
    # A change of azimuth is a smaller angle at the sensor if the elevation is large.
    left = np.unwrap(np.arctan2(y, x)) * np.cos(np.median(up))
    return np.stack([np.log(np.linalg.norm(position_m, axis=1)), left, up], axis=1)


def still(times_s: FloatArray, values: FloatArray) -> BoolArray:
    """Frames in which the person stands or sits still, shape (N,).

    Args:
        times_s: Shape (N,), seconds.
        values: As of `along_and_across`, shape (N, 3).
    """
    range_m = float(np.exp(np.median(values[:, 0])))
    along = max(_ALONG_SHARE, _ALONG_M / range_m)
    return _stays(times_s, values, np.array([along, _ACROSS_M / range_m, _ACROSS_M / range_m]))


def _stays(times_s: FloatArray, values: FloatArray, limits: FloatArray) -> BoolArray:
    """Frames in a window in which no value travels farther than its limit."""
    period_s = float(np.median(np.diff(times_s)))
    grid_s = np.arange(times_s[0], times_s[-1] + 0.5 * period_s, period_s)
    window, smooth = (max(1, round(length_s / period_s)) for length_s in (_STILL_S, _SMOOTH_S))
    if grid_s.size < window:
        return np.zeros(times_s.size, dtype=np.bool_)
    quiet = np.ones(grid_s.size, dtype=np.bool_)
    for column, limit in zip(values.T, limits, strict=True):
        path = uniform_filter1d(np.interp(grid_s, times_s, column), smooth, mode="nearest")
        quiet &= maximum_filter1d(path, window) - minimum_filter1d(path, window) < limit
    # Windows at the ends contain less than their length.
    quiet[: window // 2] = quiet[window // 2]
    quiet[-(window // 2) :] = quiet[-(window // 2) - 1]
    around = maximum_filter1d(quiet.astype(np.uint8), window // 2) > 0
    return np.asarray(around[np.clip(np.rint((times_s - grid_s[0]) / period_s).astype(int), 0, grid_s.size - 1)])


def _duration_s(times_s: FloatArray, chosen: BoolArray) -> float:
    """Seconds of the chosen frames; a gap between them counts as one period."""
    steps_s = np.diff(times_s[chosen])
    return float(np.minimum(steps_s, 3.0 * np.median(np.diff(times_s))).sum())


def _fit_errors(
    times_s: FloatArray, values: FloatArray, groups: Groups, scale_m: float, one_person: bool
) -> tuple[list[GroupFit], TrackJumps]:
    """Fit the errors of groups of axes without the jumps.

    Args:
        times_s: Shape (N,), seconds.
        values: Shape (N, A).
        groups: Axes that share their errors.
        scale_m: Metres of a unit of the values.
        one_person: Whether the person stands, with one acceleration in all groups; else wander is not fitted.

    Returns:
        One fit a group, and the jumps.
    """
    calm, jumps = _without_jumps(times_s, values)
    times_s, values = times_s[calm], values[calm]
    longest_s = _LONGEST_LAG_S if one_person else _WALKING_LAG_S
    data = [_structure(times_s, values[:, list(group)], longest_s) for group in groups]
    wanders = [one_person] * len(groups)
    logs, sds, cost = _minimum(data, wanders, scale_m, one_person)
    for g in range(len(groups)) if one_person else ():
        less = [wander and k != g for k, wander in enumerate(wanders)]
        without = _minimum(data, less, scale_m, one_person)
        if without[2] - cost < _WANDER_GAIN:
            wanders, (logs, sds, cost) = less, without
    fits = []
    for group, wander, log, sd in zip(groups, wanders, logs, sds, strict=True):
        _, white, spread, correlation = (Known(float(v), float(v * s)) for v, s in zip(np.exp(log), sd, strict=True))
        fit = GroupFit(white, spread if wander else None, correlation if wander else None)
        third = np.abs(np.diff(values[:, list(group)], 3, axis=0))
        most = max(_LEAST, _NORMAL * float(np.median(third)) / np.sqrt(_THIRD_DIFFERENCES))
        hides = not wander and white.value < _HIDDEN * most
        fits.append(replace(fit, white=Known(most, 0.0), hidden=True) if hides else fit)
    return fits, jumps


def _without_jumps(times_s: FloatArray, values: FloatArray) -> tuple[BoolArray, TrackJumps]:
    """Frames outside of jumps, shape (N,), and the jumps."""
    window = 1 + 2 * round(0.5 * _JUMP_WINDOW_S / float(np.median(np.diff(times_s))))
    aside = np.abs(values - median_filter(values, size=(window, 1), mode="nearest"))
    steps = np.abs(np.diff(values, axis=0, prepend=values[:1]))
    limits, step_limits = _gates(aside), _gates(steps)
    calm = np.ones(times_s.size, dtype=np.bool_)
    durations_s, sizes = [], []
    for first, last in _runs(np.asarray((aside > limits).any(axis=1))):
        way = aside[first:last].max(axis=0)
        axis = int(np.argmax(way / limits))
        # The others are the person's motion, or frames back on the track.
        there = np.append(aside[first:last, axis] >= _STEP_SHARE * way[axis], False)
        end = first + int(np.argmin(there))
        if end > first and steps[first, axis] > step_limits[axis]:
            calm[first:end] = False
            durations_s.append(float(times_s[end - 1] - times_s[first]))
            sizes.append(np.sqrt((aside[first:end] ** 2).mean(axis=0)))
    return calm, TrackJumps(np.array(durations_s), np.reshape(sizes, (-1, values.shape[1])))


def _gates(sizes: FloatArray) -> FloatArray:
    """Gate of each axis, shape (A,), from the sizes of deviations, shape (N, A)."""
    usual = sizes <= _OUTER_GATE * _NORMAL * np.median(sizes, axis=0)
    return np.asarray(np.maximum(_GATE * np.sqrt(np.mean(sizes**2, axis=0, where=usual)), _LEAST))


def _runs(flags: BoolArray) -> IntArray:
    """First and one past the last frame of each run of true flags, shape (K, 2)."""
    return np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]]))).reshape(-1, 2)


def _structure(times_s: FloatArray, values: FloatArray, longest_s: float) -> FloatArray:
    """Lags, variances of second differences, and their numbers of independent ones, shape (3, L)."""
    period_s = float(np.median(np.diff(times_s)))
    longest = max(2.0, min(longest_s, _LAG_SHARE * float(np.ptp(times_s))) / period_s)
    found = []
    for lag in np.unique(np.rint(np.geomspace(1, longest, _LAGS)).astype(int)).tolist():
        steps_s = np.stack([times_s[lag:-lag] - times_s[: -2 * lag], times_s[2 * lag :] - times_s[lag:-lag]])
        steady = (np.abs(steps_s - lag * period_s) < 0.5 * period_s).all(axis=0)
        second = (values[2 * lag :] - 2.0 * values[lag:-lag] + values[: -2 * lag])[steady]
        if len(second) < _FEWEST_DIFFERENCES:
            continue
        limits = np.maximum(_OUTER_GATE * _NORMAL * np.median(np.abs(second), axis=0), _LEAST)
        variance = float(np.mean(second[np.abs(second) <= limits] ** 2))
        found.append((lag * period_s, max(variance, _LEAST**2), max(2.0, _INDEPENDENT * second.size / lag)))
    return np.array(found).reshape(-1, 3).T


def _minimum(
    data: list[FloatArray], wanders: list[bool], scale_m: float, one_person: bool
) -> tuple[FloatArray, FloatArray, float]:
    """Least squares of the logarithms of variances.

    Returns:
        Logarithms of acceleration, white error, wander and correlation time of each group, shape (G, 4); their standard
        deviations; and half of the squared residuals.
    """
    # In the vector of parameters the acceleration of all groups may be one.
    at = [[0 if one_person else 4 * g, *range(4 * g + 1, 4 * g + 4)] for g in range(len(data))]

    def residual(theta: FloatArray) -> FloatArray:
        parts = []
        for index, (lag_s, variance, number), wander in zip(at, data, wanders, strict=True):
            log = theta[index]
            q, white, spread, correlation_s = np.exp(log)
            decay = np.exp(-lag_s / correlation_s)
            model = 6.0 * white**2 + 2.0 / 3.0 * (q / scale_m) ** 2 * lag_s**3
            model += wander * spread**2 * (6.0 - 8.0 * decay + 2.0 * decay**2)
            beliefs = np.array([log[0], log[2] - log[1], log[3]])
            centres, sds = np.transpose([_ACCELERATION, _WANDER_RATIO, _CORRELATION_S])
            parts += [np.sqrt(0.5 * number) * np.log(model / variance), (beliefs - centres) / sds]
        return np.concatenate(parts)

    results = []
    for correlation_s in (0.3, 1.5):
        white = [np.sqrt(variance[0] / 6.0) for _, variance, _ in data]
        start = np.log(np.concatenate([[0.02, size, size, correlation_s] for size in white]))
        results.append(least_squares(residual, start))
    best = min(results, key=lambda result: float(result.cost))
    jacobian = np.asarray(best.jac)
    covariance = np.linalg.pinv(jacobian.T @ jacobian)
    return best.x[at], np.sqrt(np.maximum(np.diag(covariance), 0.0))[at], float(best.cost)


def _direction(fit: GroupFit, used_s: float, moved: bool, sway: float) -> DirectionError:
    wander: Literal["known", "none", "unknown"] = "known"
    if moved or (fit.correlation_s is not None and used_s < _CORRELATIONS * fit.correlation_s.value):
        wander = "unknown"
    elif fit.wander is None or fit.wander.value < sway:
        wander = "none"
    return DirectionError(fit, wander)


def _yaw(times_s: FloatArray, yaw_rad: FloatArray, stands: BoolArray) -> YawErrors | None:
    known = np.isfinite(yaw_rad)
    if known.mean() < 0.1 or known.sum() < 30:
        return None
    at_s, angle_rad = times_s[known], np.unwrap(yaw_rad[known])
    turns = np.abs(np.angle(np.exp(1j * np.diff(angle_rad)))) > _FLIP_RAD
    if turns.any():
        # In twice the angle, half turns disappear.
        angle_rad = np.unwrap(2.0 * angle_rad) / 2.0
    chosen = stands[known] & _stays(at_s, angle_rad[:, None], np.array([_YAW_RAD]))
    if moved := _duration_s(at_s, chosen) < _STILL_MIN_S:
        chosen = np.ones(at_s.size, dtype=np.bool_)
    used_s = _duration_s(at_s, chosen)
    (fit,), _ = _fit_errors(at_s[chosen], angle_rad[chosen, None], ((0,),), 1.0, not moved)
    return YawErrors(_direction(fit, used_s, moved, 0.0), float(known.mean()), int(turns.sum()), used_s)
