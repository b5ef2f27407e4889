"""Replay of a recording in real time: with a simulated sensor, or with the tracker's measurements."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from gazempc.live.clock import Clock
from gazempc.live.sources.source import Arrived
from gazempc.recordings.recording import Recording
from gazempc.sim.crowd import observe_together
from gazempc.sim.sensor import SensorSpec, observe
from gazempc.types import FloatArray, Sighting
from predictors import HeadObservation

# Long enough that the loop starts a new track for the returning person.
_PAUSE_S = 2.0
# Time in which a neck crosses its range.
_BACK_S = 2.0


class ReplaySource:
    """Provides a recording's observations at their arrival times, counted from `open`.

    Args:
        placed: The recording in the base frame.
        sensor: The simulated sensor.
        seed: Seed of the sensor's noise.
        clock: The loop's clock.
        passes: Number of repetitions, each with different noise.
        others: Other people present at the same time.
    """

    keeps_any_clock = True

    def __init__(
        self,
        placed: Recording,
        sensor: SensorSpec,
        seed: int,
        clock: Clock,
        passes: int = 1,
        others: Sequence[Recording] = (),
    ) -> None:
        all_people = (placed, *others)
        last_s = max(float(walk.times_s[-1]) for walk in all_people)

        def seen(seed: int) -> Iterable[Sighting]:
            if not others:
                return observe(placed, sensor, seed)
            return [sighting for _, sighting in observe_together(all_people, sensor, seed)]

        pass_s = last_s + _PAUSE_S
        found = [_later(sighting, k * pass_s) for k in range(passes) for sighting in seen(seed + k)]
        self._play(found, clock, (passes - 1) * pass_s + last_s, passes, pass_s)

    def _play(
        self, sightings: Iterable[Sighting], clock: Clock, end_s: float, passes: int = 1, pass_s: float = 1.0
    ) -> None:
        self._sightings, self._clock, self._end_s = deque(sightings), clock, end_s
        self._passes, self._pass_s, self.start_s = passes, pass_s, 0.0

    def open(self) -> None:
        """See `gazempc.live.sources.source.Source.open`."""
        self.start_s = self._clock.now_s()

    def poll(self) -> Arrived:
        """See `gazempc.live.sources.source.Source.poll`."""
        elapsed_s = self._clock.now_s() - self.start_s
        arrived = []
        while self._sightings and self._sightings[0].arrival_s <= elapsed_s + 1e-9:
            arrived.append(_later(self._sightings.popleft(), self.start_s))
        return Arrived(tuple(arrived))

    def own_s(self, times_s: FloatArray) -> FloatArray:
        """Convert times of the loop to the recording's time within a pass.

        Args:
            times_s: Shape (H,), seconds.

        Returns:
            Shape (H,), seconds; beyond the recording's end between two passes and during reacquisition: the true head
            is unknown there, so the jump between passes is not scored.
        """
        elapsed_s = times_s - self.start_s
        number = np.clip(np.floor(elapsed_s / self._pass_s), 0, self._passes - 1)
        own_s: FloatArray = elapsed_s - self._pass_s * number
        return np.where((number > 0) & (own_s < _BACK_S), self._pass_s, own_s)

    @property
    def finished(self) -> bool:
        """See `gazempc.live.sources.source.Source.finished`: True once the recording has ended."""
        return self._clock.now_s() - self.start_s > self._end_s

    def close(self) -> None:
        """See `gazempc.live.sources.source.Source.close`."""
        self._sightings.clear()


def _later(sighting: Sighting, by_s: float) -> Sighting:
    captured_s = by_s + sighting.observation.capture_time_s
    return Sighting(by_s + sighting.arrival_s, replace(sighting.observation, capture_time_s=captured_s))


class BagSource(ReplaySource):
    """Provides the tracker's measurements at their arrival times, counted from `open`.

    Args:
        placed: The recording in the base frame, with its measurements.
        clock: The loop's clock.
        others: Other people of the bag.
    """

    def __init__(self, placed: Recording, clock: Clock, others: Sequence[Recording] = ()) -> None:
        found = [sighting for walk in (placed, *others) for sighting in bag_sightings(walk)]
        found.sort(key=lambda sighting: sighting.arrival_s)
        self._play(found, clock, found[-1].arrival_s)

    @property
    def finished(self) -> bool:
        """See `gazempc.live.sources.source.Source.finished`: True after the last measurement."""
        return super().finished and not self._sightings


def bag_sightings(placed: Recording) -> list[Sighting]:
    """The measurements of a tracker, in order of arrival.

    Args:
        placed: The recording with its measurements, from time 0. Without recorded delays they arrive at once.

    Returns:
        A sighting for each frame with the person in view.
    """
    track = placed.truth if placed.measured is None else placed.measured
    delays_s = np.zeros_like(placed.times_s) if placed.delays_s is None else placed.delays_s
    captures_s, arrivals_s = placed.times_s.tolist(), (placed.times_s + delays_s).tolist()
    heads_m, quats, pelvises = track.head_position_m, track.head_quat_wxyz, track.pelvis_quat_wxyz
    found = [
        Sighting(arrivals_s[k], HeadObservation(captures_s[k], heads_m[k], _known(quats[k]), _known(pelvises[k])))
        for k in np.flatnonzero(track.valid)
    ]
    return sorted(found, key=lambda sighting: sighting.arrival_s)


def _known(quat_wxyz: FloatArray) -> FloatArray | None:
    return quat_wxyz if np.isfinite(quat_wxyz).all() else None
