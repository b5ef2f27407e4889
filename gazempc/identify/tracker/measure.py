"""A tracker's errors from one track: positions, yaws, times of the frames and latency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from gazempc.identify.tracker.errors import Errors, duration_s, find_jumps, measure_errors
from gazempc.identify.tracker.read import HeadTrack
from gazempc.types import BoolArray, FloatArray, IntArray

# Window and limits for a person at rest; wider than a wander of 30 mm across the line of sight, or of 5 % of the range.
_STILL_S = 4.0
_ACROSS_M, _ALONG_SHARE, _ALONG_M = 0.12, 0.2, 0.3
_YAW_RAD = np.deg2rad(40.0)
_SMOOTH_S = 0.7
# Least time at rest for the estimation of a wander of one second.
_STILL_MIN_S = 8.0
# Postural sway of heads, 5 to 10 mm (s.d.; assumed): not an error of the tracker.
_SWAY_M = 0.01
# Bounds of a plausible delay: a shorter one is due to the recorder, a longer one to different clocks.
_DELAY_MIN_S, _DELAY_MAX_S = 0.005, 5.0
# Relative standard deviation of intervals above which the rate is irregular, unless successive intervals compensate
# each other; and minimum gap of an irregular rate, periods.
_IRREGULAR, _IRREGULAR_GAP = 0.25, 3.0


@dataclass(frozen=True)
class FrameTimes:
    """Rate, jitter and losses, from the stamps.

    Attributes:
        rate_hz: Frame rate without losses.
        jitter_s: Standard deviation of the intervals without losses.
        regular: Whether the rate is constant: a late frame makes the next interval shorter.
        single_share: Share of single lost frames.
        gaps_s: Durations of losses of two frames or more, shape (K,), seconds.
        duration_s: Time from the first frame to the last, seconds.
    """

    rate_hz: float
    jitter_s: float
    regular: bool
    single_share: float
    gaps_s: FloatArray
    duration_s: float


@dataclass(frozen=True)
class TrackerErrors:
    """Measured errors of a tracker.

    Attributes:
        frames: Rate, jitter and losses.
        along: Relative error of the range.
        across: Error of the bearing on each of its two axes, radians.
        jump_durations_s: Durations of the jumps off the running median, shape (K,), seconds; 0 for a single frame.
        jump_sizes: Root mean square of each on each axis, shares of the range and radians, shape (K, 3).
        still_s: Time at rest of the person, seconds.
        range_m: Least, median and largest range, shape (3,), metres.
        head_yaw: Error of the yaw; None if unknown.
        pelvis_yaw: Error of the yaw; None if unknown.
        delay_s: Median from stamp to arrival, seconds; None if unknown.
    """

    frames: FrameTimes
    along: Errors
    across: Errors
    jump_durations_s: FloatArray
    jump_sizes: FloatArray
    still_s: float
    range_m: FloatArray
    head_yaw: Errors | None
    pelvis_yaw: Errors | None
    delay_s: float | None

    @property
    def moved(self) -> bool:
        """Whether the wander is not identifiable because of the person's motion."""
        return self.still_s < _STILL_MIN_S

    @property
    def latency_s(self) -> float | None:
        """Measured latency, seconds; None if the delay is implausible as latency."""
        return self.delay_s if self.delay_s is not None and _DELAY_MIN_S < self.delay_s < _DELAY_MAX_S else None

    @property
    def jump_sizes_m(self) -> tuple[FloatArray, FloatArray]:
        """Sizes of the jumps along and across the line of sight, each of shape (K,), metres."""
        sizes_m = self.jump_sizes * self.range_m[1]
        return sizes_m[:, 0], np.hypot(sizes_m[:, 1], sizes_m[:, 2])

    @property
    def jumps_across(self) -> bool:
        """Whether jumps have a component across the line of sight, larger than a person's sway."""
        along_m, across_m = self.jump_sizes_m
        # Least ratio of the sizes across and along the line of sight for a jump across it.
        return bool(along_m.size and np.median(across_m) > max(_SWAY_M, 0.3 * np.median(along_m)))


def measure_tracker(track: HeadTrack) -> TrackerErrors:
    """Measure a tracker.

    Args:
        track: Track of one person.

    Returns:
        Its errors.
    """
    x, y, z = track.position_m.T
    times_s, range_m, up = track.times_s, np.linalg.norm(track.position_m, axis=1), np.arctan2(z, np.hypot(x, y))
    middle_m = float(np.median(range_m))
    # Great-circle angle of an azimuth change: times the cosine of the elevation.
    left = np.unwrap(np.arctan2(y, x)) * np.cos(np.median(up))
    # Logarithm of the range (changes are relative), and both angles of the bearing.
    values = np.stack([np.log(range_m), left, up], axis=1)
    limits = np.array([max(_ALONG_SHARE, _ALONG_M / middle_m), _ACROSS_M / middle_m, _ACROSS_M / middle_m])
    stands = _stays(times_s, values, limits)
    still_s = duration_s(times_s, stands)
    is_still = still_s >= _STILL_MIN_S
    calm, jump_durations_s, jump_sizes = find_jumps(times_s, values, stands if is_still else np.ones_like(stands))
    along, across = (
        measure_errors(times_s, values[:, axes], calm, is_still, _SWAY_M / middle_m) for axes in ([0], [1, 2])
    )
    return TrackerErrors(
        frames=frame_times(times_s),
        along=along,
        across=across,
        jump_durations_s=jump_durations_s,
        jump_sizes=jump_sizes,
        still_s=still_s,
        range_m=np.array([range_m.min(), middle_m, range_m.max()]),
        head_yaw=_yaw(times_s, track.head_yaw_rad, stands),
        pelvis_yaw=_yaw(times_s, track.pelvis_yaw_rad, stands),
        delay_s=None if track.delays_s is None else float(np.median(track.delays_s)),
    )


def _stays(times_s: FloatArray, values: FloatArray, limits: FloatArray) -> BoolArray:
    """Mask of the frames in a window of 4 s in which the range of each value is within its limit."""
    period_s = float(np.median(np.diff(times_s)))
    grid_s = np.arange(times_s[0], times_s[-1] + 0.5 * period_s, period_s)
    window, smooth = (max(1, round(length_s / period_s)) for length_s in (_STILL_S, _SMOOTH_S))
    if grid_s.size < window:
        return np.zeros(times_s.size, dtype=np.bool_)
    quiet = np.ones(grid_s.size, dtype=np.bool_)
    for column, limit in zip(values.T, limits, strict=True):
        path = uniform_filter1d(np.interp(grid_s, times_s, column), smooth, mode="nearest")
        quiet &= maximum_filter1d(path, window) - minimum_filter1d(path, window) < limit
    # Incomplete windows at the ends.
    quiet[: window // 2] = quiet[window // 2]
    quiet[-(window // 2) :] = quiet[-(window // 2) - 1]
    around = maximum_filter1d(quiet.astype(np.uint8), window // 2) > 0
    return np.asarray(around[np.clip(np.rint((times_s - grid_s[0]) / period_s).astype(int), 0, grid_s.size - 1)])


def _yaw(times_s: FloatArray, yaw_rad: FloatArray, stands: BoolArray) -> Errors | None:
    known = np.isfinite(yaw_rad)
    if known.mean() < 0.1 or known.sum() < 30:
        return None
    at_s, angle_rad = times_s[known], np.unwrap(yaw_rad[known])
    # Threshold of the yaw change between frames for a flip.
    if (np.abs(np.angle(np.exp(1j * np.diff(angle_rad)))) > np.deg2rad(150.0)).any():
        # In twice the angle, half turns disappear.
        angle_rad = np.unwrap(2.0 * angle_rad) / 2.0
    values = angle_rad[:, None]
    stays = stands[known] & _stays(at_s, values, np.array([_YAW_RAD]))
    is_still = duration_s(at_s, stays) >= _STILL_MIN_S
    return measure_errors(at_s, values, stays if is_still else np.ones_like(stays), is_still)


def frame_times(times_s: FloatArray) -> FrameTimes:
    """Measure rate, jitter and losses.

    Args:
        times_s: Stamps, shape (N,), seconds, strictly increasing.

    Returns:
        Rate, jitter and losses.
    """
    intervals_s = np.diff(times_s)
    duration_s = float(times_s[-1] - times_s[0])
    period_s = float(np.median(intervals_s))
    usual = intervals_s < _IRREGULAR_GAP * period_s
    if _varies_freely(intervals_s, usual):
        gaps_s = intervals_s[~usual] - period_s
        kept_s = intervals_s[usual]
        return FrameTimes(1.0 / float(kept_s.mean()), float(kept_s.std()), False, 0.0, gaps_s, duration_s)
    missing = np.zeros(intervals_s.size, dtype=np.intp)
    for _ in range(3):
        missing = _missing(intervals_s, period_s)
        # Mean over the track: late frames cancel out.
        period_s = duration_s / float(intervals_s.size + missing.sum())
    return FrameTimes(
        1.0 / period_s,
        float(intervals_s[missing == 0].std()),
        True,
        float((missing == 1).sum() / (times_s.size + missing.sum())),
        np.asarray(missing[missing > 1] * period_s, dtype=np.float64),
        duration_s,
    )


def _varies_freely(intervals_s: FloatArray, usual: BoolArray) -> bool:
    kept_s = intervals_s[usual]
    if kept_s.std() < _IRREGULAR * kept_s.mean():
        return False
    # Intervals with losses at a constant rate are integer multiples of the period.
    periods = kept_s / np.quantile(kept_s, 0.2)
    if np.abs(periods - np.rint(periods)).mean() < 0.1:
        return False
    beside = usual[1:] & usual[:-1]
    # Threshold of the correlation of successive intervals: -0.5 if each late frame shortens the next interval.
    return bool(np.corrcoef(intervals_s[:-1][beside], intervals_s[1:][beside])[0, 1] > -0.25)


def _missing(intervals_s: FloatArray, period_s: float) -> IntArray:
    """Number of missing frames in each interval, shape (N - 1,).

    A late frame is followed by a short interval; a missing one is not.
    """
    beside_s = np.minimum(np.concatenate([[period_s], intervals_s, [period_s]]), period_s)
    around = np.rint((beside_s[:-2] + intervals_s + beside_s[2:]) / period_s).astype(np.intp) - 3
    # Interval in periods above which frames are lost.
    return np.where(intervals_s > 1.5 * period_s, np.maximum(around, 0), 0)
