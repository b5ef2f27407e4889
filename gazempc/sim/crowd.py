"""Simulated observations of several people by one sensor, with mutual occlusion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from gazempc.recordings.recording import Recording
from gazempc.recordings.truth import TrueHead
from gazempc.sim.sensing.spec import SensorSpec
from gazempc.sim.sensor import observe
from gazempc.types import Sighting
from predictors import Forecast, HeadObservation, Perfect

# Half the width of shoulders (0.45 m): body and face trackers lose a person whose centre line is behind another's
# shoulders.
_COVERED_M = 0.225


def observe_together(walks: Sequence[Recording], sensor: SensorSpec, seed: int) -> list[tuple[int, Sighting]]:
    """Simulate observations of several simultaneous recordings.

    Args:
        walks: The recordings in the robot's base frame, with their own start times.
        sensor: The sensor.
        seed: Seed of its errors.

    Returns:
        Index of the recording and sighting, in order of arrival.

    Raises:
        SettingsError: If a person is never observed.
    """
    heads = [TrueHead(walk) for walk in walks]
    found: list[tuple[int, Sighting]] = []
    for k, walk in enumerate(walks):
        # Different names, for independent noise also if a recording occurs twice.
        for sighting in observe(replace(walk, name=f"{walk.name} {k}"), sensor, seed):
            captured_s = sighting.observation.capture_time_s
            others = [head for j, head in enumerate(heads) if j != k and _plays(walks[j], captured_s)]
            if not _is_hidden(heads[k], others, captured_s):
                found.append((k, sighting))
    return sorted(found, key=lambda each: each[1].arrival_s)


def _plays(walk: Recording, time_s: float) -> bool:
    return bool(walk.times_s[0] <= time_s <= walk.times_s[-1])


def _is_hidden(head: TrueHead, others: Sequence[TrueHead], time_s: float) -> bool:
    own_m = head([time_s])[0]
    range_m = float(np.linalg.norm(own_m))
    for other in others:
        other_m = other([time_s])[0]
        nearer_m = float(np.linalg.norm(other_m))
        # Distance of the nearer person from the line of sight to the farther one.
        along_m = float(other_m @ own_m) / range_m
        if nearer_m < range_m and along_m > 0.0 and nearer_m**2 - along_m**2 < _COVERED_M**2:
            return True
    return False


class PerfectOfCrowd:
    """The predictor `perfect` for several people: true future of the person nearest to its first observation.

    Args:
        heads: True head of each person.
    """

    def __init__(self, heads: Sequence[TrueHead]) -> None:
        self._heads = heads
        self.reset()

    def reset(self) -> None:
        """Discard the person."""
        self._perfect: Perfect | None = None

    def update(self, observation: HeadObservation) -> None:
        """Process one observation; see `predictors.predictor.Predictor.update`."""
        if self._perfect is None:
            seen_m, captured_s = observation.head_position_base_m, observation.capture_time_s
            away_m = [float(np.linalg.norm(head([captured_s])[0] - seen_m)) for head in self._heads]
            self._perfect = Perfect(self._heads[int(np.argmin(away_m))])
        self._perfect.update(observation)

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """Forecast the head position; see `predictors.predictor.Predictor.forecast`."""
        return (self._perfect or Perfect(self._heads[0])).forecast(times_s)
