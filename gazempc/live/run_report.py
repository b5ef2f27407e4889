"""Counts of a live run, in constant memory: lateness of ticks, observations, warnings."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

_BIN_MS = 0.01
_BINS = 100_000  # up to 1 s; the last one holds all that is later


class Lateness:
    """A histogram of times with bins of 10 microseconds."""

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, dtype=np.int64)
        self._max_ms = 0.0

    def add(self, late_ms: float) -> None:
        """Take note of one time, milliseconds; a negative one counts as 0."""
        self._counts[min(max(int(late_ms / _BIN_MS), 0), _BINS - 1)] += 1
        self._max_ms = max(self._max_ms, late_ms)

    @property
    def count(self) -> int:
        """How many were noted."""
        return int(self._counts.sum())

    @property
    def max_ms(self) -> float:
        """The largest, milliseconds."""
        return self._max_ms

    def beyond(self, limit_ms: float) -> int:
        """How many were later than a limit, up to 1 s, to 10 microseconds."""
        return int(self._counts[int(limit_ms / _BIN_MS) :].sum())

    def percentile_ms(self, percent: float) -> float:
        """The upper edge of the bin that a percentile is in.

        Args:
            percent: 0 to 100.

        Returns:
            Milliseconds; 0 if nothing was noted, and the largest where it is beyond 1 s.
        """
        if not self.count:
            return 0.0
        k = int(np.searchsorted(np.cumsum(self._counts), max(percent / 100.0 * self.count, 1.0)))
        return self._max_ms if k == _BINS - 1 else min((k + 1) * _BIN_MS, self._max_ms)


_PROBLEMS_KEPT = 20


@dataclass
class LiveReport:
    """What a live run was like; grows with the number of kinds of trouble only, not with time.

    Attributes:
        ticks: Number of ticks done.
        skipped_ticks: Ticks left out, as the one before took too long.
        lateness: How much later than due the ticks began.
        observations: Number of observations that arrived, readable or not.
        problems: What arrived and could not be used, the first 20.
        n_problems: How many there were.
        warnings: What is probably wrong with the set-up: event, finding and correction of each kind.
        least_age_s: Least age of the frames that come soonest, by their stamps, over the run, seconds; below 0 if they
            are of the future.
        greatest_age_s: The greatest.
        stopped_by: Why the run ended.
    """

    ticks: int = 0
    skipped_ticks: int = 0
    lateness: Lateness = field(default_factory=Lateness)
    observations: int = 0
    problems: list[str] = field(default_factory=list)
    n_problems: int = 0
    warnings: list[str] = field(default_factory=list)
    least_age_s: float = math.inf
    greatest_age_s: float = -math.inf
    stopped_by: str = ""

    def problem(self, text: str) -> None:
        """Take note of something that arrived and could not be used.

        Args:
            text: What, and why.
        """
        self.n_problems += 1
        if len(self.problems) < _PROBLEMS_KEPT:
            self.problems.append(text)
