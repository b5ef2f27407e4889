"""A recording as if it happened now."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from gazempc.live.clock import Clock
from gazempc.live.sources.source import Arrived
from gazempc.recordings.recording import Recording
from gazempc.sim.sensor import SensorSpec, observe
from gazempc.types import Sighting


class ReplaySource:
    """Gives a recording's observations when they would have arrived, counted from `open`.

    Args:
        placed: The recording in the base frame.
        sensor: What is seen of it.
        seed: Seed of the sensor's noise.
        clock: The loop's clock.
    """

    keeps_any_clock = True

    def __init__(self, placed: Recording, sensor: SensorSpec, seed: int, clock: Clock) -> None:
        self._sightings = deque(observe(placed, sensor, seed))
        self._end_s = float(placed.times_s[-1])
        self._clock = clock
        self.start_s = 0.0

    def open(self) -> None:
        """See `gazempc.live.sources.source.Source.open`."""
        self.start_s = self._clock.now_s()

    def poll(self) -> Arrived:
        """See `gazempc.live.sources.source.Source.poll`."""
        elapsed_s = self._clock.now_s() - self.start_s
        arrived = []
        while self._sightings and self._sightings[0].arrival_s <= elapsed_s + 1e-9:
            sighting = self._sightings.popleft()
            captured_s = self.start_s + sighting.observation.capture_time_s
            observation = replace(sighting.observation, capture_time_s=captured_s)
            arrived.append(Sighting(self.start_s + sighting.arrival_s, observation))
        return Arrived(tuple(arrived))

    @property
    def finished(self) -> bool:
        """See `gazempc.live.sources.source.Source.finished`: True once the recording has ended."""
        return self._clock.now_s() - self.start_s > self._end_s

    def close(self) -> None:
        """See `gazempc.live.sources.source.Source.close`."""
        self._sightings.clear()
