"""The track of one person: identity, motion and predictor."""

from __future__ import annotations

import contextlib
from collections import deque
from dataclasses import dataclass

import numpy as np

from gazempc.people.association import Motion, noise_of
from gazempc.people.tracker_faults import START_S, OrientationJumps, TrackStart
from gazempc.types import FloatArray
from predictors import Forecast, HeadObservation, OutOfOrderError, Predictor

# Synchronisation tolerance of cameras: people move by a centimetre in this time.
ONE_FRAME_S = 0.01
# Length of the buffer of frames: older ones do not improve a forecast. Only the attended person is
# forecast; the predictors of the others are updated lazily.
_MEMORY_S = 1.5
# Buffered sightings processed per frame: empties the buffer within half a second at 30 Hz.
CATCH_UP = 3
# Maximum age of an orientation: a head turns away in this time.
_ORIENTATION_LASTS_S = 0.5


@dataclass(frozen=True)
class PersonState:
    """Estimate of one person at one time: the input of attention policies.

    Attributes:
        number: Number of the person, from 1; unique in a run.
        tracker_id: The tracker's name; None if there is none.
        time_s: The time, seconds.
        position_base_m: Head, shape (3,), metres, base frame.
        velocity_base_m_s: Its velocity, shape (3,), m/s.
        head_quat_wxyz: Last measured orientation of the head, shape (4,); None if there is no recent one.
        seen_s: Capture time of the last sighting, seconds.
        since_s: Capture time of the first one, seconds.
    """

    number: int
    tracker_id: str | None
    time_s: float
    position_base_m: FloatArray
    velocity_base_m_s: FloatArray
    head_quat_wxyz: FloatArray | None
    seen_s: float
    since_s: float

    @property
    def distance_m(self) -> float:
        """Horizontal distance from the neck, metres."""
        return float(np.hypot(*self.position_base_m[:2]))


class TrackedPerson:
    """Track of one person: a constant-velocity filter for association, and a predictor for forecasts.

    Args:
        number: Number of the person.
        first: The first sighting.
        predictor: The person's predictor, reset.

    Attributes:
        number: Number of the person.
        tracker_id: The tracker's last name of the person.
        motion: Motion at the last sighting.
        newest: The last sighting.
        seen_s: Its capture time, seconds.
        since_s: Capture time of the first one, seconds.
        sightings: Number of sightings.
        confirmed: Whether the track is confirmed, and not a single false detection.
        start: Orders the predictor's observations, and clamps its forecasts to the reach of the person.
        jumped: Whether the orientation of the last sighting is a jump, the first one for a second; it is not used.
    """

    def __init__(self, number: int, first: HeadObservation, predictor: Predictor) -> None:
        self.number = number
        self.tracker_id: str | None = None
        self.confirmed = False
        self.sightings = 0
        self.since_s = first.capture_time_s
        self._predictor, self.start = predictor, TrackStart(predictor)
        self._jumps = OrientationJumps()
        self._waiting: deque[HeadObservation] = deque()
        self._oriented: HeadObservation | None = None
        self.take(first, Motion.begin(first.head_position_base_m, noise_of(first)))

    def take(self, observation: HeadObservation, motion: Motion) -> None:
        """Update with a sighting.

        Args:
            observation: The sighting, newer than the last one.
            motion: The motion updated with it.
        """
        self.motion, self.newest, self.seen_s = motion, observation, observation.capture_time_s
        self.tracker_id = observation.person_id or self.tracker_id
        self.sightings += 1
        observation, self.jumped = self._jumps.without(observation)
        if observation.head_quat_wxyz is not None:
            self._oriented = observation
        self._waiting.append(observation)
        while self._waiting[0].capture_time_s < observation.capture_time_s - _MEMORY_S:
            self._waiting.popleft()

    def take_late(self, observation: HeadObservation) -> bool:
        """Update with an out-of-order sighting, if the track is new and has no sighting of that time.

        Args:
            observation: The sighting.

        Returns:
            Whether it is used.
        """
        captured_s = observation.capture_time_s
        began_s = min(self.since_s, captured_s)
        if self.is_named_otherwise(observation) or self.seen_s - began_s > START_S:
            return False
        if any(abs(each.capture_time_s - captured_s) <= ONE_FRAME_S for each in self._waiting):
            return False
        self.since_s = began_s
        self.sightings += 1
        self._waiting.append(observation)
        return True

    def is_named_otherwise(self, observation: HeadObservation) -> bool:
        """Whether a sighting and the track have different tracker names; False if one of them has none."""
        return None not in (self.tracker_id, observation.person_id) and self.tracker_id != observation.person_id

    def forecast(self, times_s: FloatArray) -> Forecast:
        """Forecast the head.

        Args:
            times_s: Times, shape (H,), seconds.

        Returns:
            The forecast.

        Raises:
            Exception: Any exception of the predictor.
        """
        self.catch_up(len(self._waiting))
        return self._predictor.forecast(times_s)

    def catch_up(self, most: int) -> None:
        """Update the predictor with buffered sightings, a few per frame: processing all takes milliseconds.

        Args:
            most: Maximum number of sightings, the oldest first.

        Raises:
            Exception: Any exception of the predictor.
        """
        for _ in range(min(most, len(self._waiting))):
            with contextlib.suppress(OutOfOrderError):
                self.start.update(self._waiting.popleft())

    @property
    def refused(self) -> bool:
        """Whether the predictor rejected its last sighting."""
        return bool(getattr(self._predictor, "rejections_in_a_row", 0))

    def begin_anew(self) -> None:
        """Restart the predictor from the last sighting: the earlier ones were not of the person."""
        self.start.reset()
        while len(self._waiting) > 1:
            self._waiting.popleft()

    def position_m(self, time_s: float) -> FloatArray:
        """Position at a time, at constant velocity since the last sighting, shape (3,), metres."""
        return np.asarray(self.motion.position_m[0] + (time_s - self.seen_s) * self.motion.velocity_m_s[0])

    def state(self, time_s: float) -> PersonState:
        """The person at a time.

        Args:
            time_s: The time, seconds.

        Returns:
            The estimate.
        """
        facing = self._oriented
        if facing is not None and time_s - facing.capture_time_s > _ORIENTATION_LASTS_S:
            facing = None
        return PersonState(
            number=self.number,
            tracker_id=self.tracker_id,
            time_s=time_s,
            position_base_m=self.position_m(time_s),
            velocity_base_m_s=self.motion.velocity_m_s[0],
            head_quat_wxyz=None if facing is None else facing.head_quat_wxyz,
            seen_s=self.seen_s,
            since_s=self.since_s,
        )
