"""What a live run was like, in constant memory."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from gazempc.live.lateness import Lateness

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
        warnings: What is probably wrong with the set-up: each kind's event, what it looks like, and what mends it.
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
