"""Nearest neighbour, as in simple trackers: no motion, no spread. What `People` is compared with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from predictors import HeadObservation

# Simple trackers let a person move so far from one frame to the next, and forget them after so long.
_FARTHEST_M, _FORGOTTEN_AFTER_S = 0.7, 1.0


class NearestNeighbour:
    """Gives each detection to the person whose last position is nearest."""

    def __init__(self) -> None:
        self._count = 0
        self._last: dict[int, HeadObservation] = {}

    def numbers(self, observations: Sequence[HeadObservation]) -> list[int]:
        """Take in a frame.

        Args:
            observations: Detections of one instant.

        Returns:
            Each detection's person.
        """
        now_s = observations[0].capture_time_s
        self._last = {n: o for n, o in self._last.items() if now_s - o.capture_time_s <= _FORGOTTEN_AFTER_S}
        known = list(self._last)
        found = [0] * len(observations)
        if known:
            lasts_m = np.array([self._last[number].head_position_base_m for number in known])
            apart_m = cdist(lasts_m, np.array([seen.head_position_base_m for seen in observations]))
            rows, columns = linear_sum_assignment(np.where(apart_m <= _FARTHEST_M, apart_m, 1e6))
            for row, column in zip(rows, columns, strict=True):
                if apart_m[row, column] <= _FARTHEST_M:
                    found[column] = known[row]
        for k, observation in enumerate(observations):
            if not found[k]:
                self._count += 1
                found[k] = self._count
            self._last[found[k]] = observation
        return found
