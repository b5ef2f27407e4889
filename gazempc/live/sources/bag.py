"""A person in a ROS 2 bag as if they were there now, with the delays of the recording."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from gazempc.live.clock import Clock
from gazempc.live.sources.replay import ReplaySource
from gazempc.recordings.recording import Recording
from gazempc.types import FloatArray, Sighting
from predictors import HeadObservation


class BagSource(ReplaySource):
    """Gives what the tracker measured when it arrived, counted from `open`.

    Args:
        placed: The recording in the base frame, with what was measured.
        clock: The loop's clock.
        others: Other people of the bag.
    """

    def __init__(self, placed: Recording, clock: Clock, others: Sequence[Recording] = ()) -> None:
        found = [sighting for walk in (placed, *others) for sighting in bag_sightings(walk)]
        self._sightings = deque(sorted(found, key=lambda sighting: sighting.arrival_s))
        self._end_s = self._sightings[-1].arrival_s
        self._clock = clock
        self.start_s = 0.0

    @property
    def finished(self) -> bool:
        """See `gazempc.live.sources.source.Source.finished`: True once all that was recorded has been given."""
        return super().finished and not self._sightings


def bag_sightings(placed: Recording) -> list[Sighting]:
    """What a tracker measured, in the order of arrival.

    Args:
        placed: The recording, with what was measured; time starts at 0. Without delays all arrives at once.

    Returns:
        A sighting for each frame in which the person was seen.
    """
    track = placed.truth if placed.measured is None else placed.measured
    delays_s = np.zeros_like(placed.times_s) if placed.delays_s is None else placed.delays_s
    found = [
        Sighting(
            float(placed.times_s[k] + delays_s[k]),
            HeadObservation(
                capture_time_s=float(placed.times_s[k]),
                head_position_base_m=track.head_position_m[k],
                head_quat_wxyz=_known(track.head_quat_wxyz[k]),
                pelvis_quat_wxyz=_known(track.pelvis_quat_wxyz[k]),
            ),
        )
        for k in np.flatnonzero(track.valid)
    ]
    return sorted(found, key=lambda sighting: sighting.arrival_s)


def _known(quat_wxyz: FloatArray) -> FloatArray | None:
    return quat_wxyz if np.isfinite(quat_wxyz).all() else None
