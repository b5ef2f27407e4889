"""Frame rate, jitter and losses of a tracker, from its stamps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gazempc.types import BoolArray, FloatArray, IntArray

# Interval in periods above which frames are lost.
_LOSS_PERIODS = 1.5
# Relative standard deviation of intervals above which the rate is irregular, unless successive intervals compensate
# each other; and minimum gap of an irregular rate, periods.
_IRREGULAR, _IRREGULAR_GAP = 0.25, 3.0
# Threshold of the correlation of successive intervals: -0.5 if each late frame shortens the next interval.
_COMPENSATED = -0.25


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

    @property
    def gap_interval_s(self) -> float:
        """Mean time from the end of a gap to the start of the next; infinite without gaps."""
        return float((self.duration_s - self.gaps_s.sum()) / self.gaps_s.size) if self.gaps_s.size else float("inf")


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
    return bool(np.corrcoef(intervals_s[:-1][beside], intervals_s[1:][beside])[0, 1] > _COMPENSATED)


def _missing(intervals_s: FloatArray, period_s: float) -> IntArray:
    """Number of missing frames in each interval, shape (N - 1,).

    A late frame is followed by a short interval; a missing one is not.
    """
    beside_s = np.minimum(np.concatenate([[period_s], intervals_s, [period_s]]), period_s)
    around = np.rint((beside_s[:-2] + intervals_s + beside_s[2:]) / period_s).astype(np.intp) - 3
    return np.where(intervals_s > _LOSS_PERIODS * period_s, np.maximum(around, 0), 0)
