"""Frame rate, jitter and losses of a tracker, from its stamps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gazempc.types import FloatArray, IntArray

# A shorter interval has lost no frame.
_LOSS_PERIODS = 1.5


@dataclass(frozen=True)
class FrameTimes:
    """What the stamps say.

    Attributes:
        rate_hz: Frames a second where none is lost.
        jitter_s: Standard deviation of the intervals where none is lost.
        single_share: Share of frames that are missing one by one.
        gaps_s: How long the person was lost where two frames or more are missing, shape (K,), seconds.
        duration_s: From the first frame to the last.
    """

    rate_hz: float
    jitter_s: float
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
        What the stamps say.
    """
    intervals_s = np.diff(times_s)
    period_s = float(np.median(intervals_s))
    for _ in range(3):
        missing = _missing(intervals_s, period_s)
        # Over all of the track: a frame that is late makes one interval longer and the next one shorter.
        period_s = float((times_s[-1] - times_s[0]) / (intervals_s.size + missing.sum()))
    whole = missing == 0
    return FrameTimes(
        1.0 / period_s,
        float(intervals_s[whole].std()),
        float((missing == 1).sum() / (times_s.size + missing.sum())),
        missing[missing > 1] * period_s,
        float(times_s[-1] - times_s[0]),
    )


def _missing(intervals_s: FloatArray, period_s: float) -> IntArray:
    """Frames that are missing in each interval, shape (N - 1,).

    A late frame is followed by a short interval; a missing one is not.
    """
    beside_s = np.minimum(np.concatenate([[period_s], intervals_s, [period_s]]), period_s)
    around = np.rint((beside_s[:-2] + intervals_s + beside_s[2:]) / period_s).astype(np.intp) - 3
    return np.where(intervals_s > _LOSS_PERIODS * period_s, np.maximum(around, 0), 0)
