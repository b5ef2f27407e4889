"""One person of several: identity, motion and predictor."""

from __future__ import annotations

import contextlib
from collections import deque
from dataclasses import dataclass

import numpy as np

from gazempc.people.association import Motion
from gazempc.people.tracker_faults import START_S, OrientationJumps, TrackStart
from gazempc.types import FloatArray
from predictors import Forecast, HeadObservation, OutOfOrderError, Predictor
from predictors.predictor import noise_m2

# Cameras that look at the same time are not exact; people move by a centimetre meanwhile.
ONE_FRAME_S = 0.01
# Older frames do not improve a forecast. Only the person who is looked at needs forecasts: what the
# others do is kept for so long, and taken in when it is their turn.
_MEMORY_S = 1.5
# With so many sightings a frame a predictor has caught up within half a second at 30 frames a second.
CATCH_UP = 3
# Where a tracker states no error, positions are taken to be this wrong: they wander with posture, too.
_POSITION_NOISE_M2 = 0.03**2 * np.eye(3)
# A head turns away within less.
_ORIENTATION_LASTS_S = 0.5


@dataclass(frozen=True)
class PersonState:
    """Estimate of one person at one time: the input of attention policies.

    Attributes:
        number: Which person, from 1 on; never given twice in a run.
        tracker_id: The tracker's name; None where it gives none.
        time_s: The time, seconds.
        position_base_m: Head, shape (3,), metres, base frame.
        velocity_base_m_s: Its velocity, shape (3,), m/s.
        head_quat_wxyz: Orientation of the head as seen last, shape (4,); None where it was not seen lately.
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
    """Where one person is, by a plain filter, and where they will be, by a predictor.

    Args:
        number: Which person.
        first: The first sighting.
        predictor: A predictor of their own, reset.

    Attributes:
        number: Which person.
        tracker_id: Last name that the tracker gave them.
        motion: Their motion when they were seen last.
        newest: The last sighting.
        seen_s: Its capture time, seconds.
        since_s: Capture time of the first one, seconds.
        sightings: How many there were.
        confirmed: Whether the track is confirmed: no single false detection.
        start: Gives the predictor its observations, and keeps its forecasts within reach.
        jumped: Whether the orientation of the last sighting jumped, the first time for a second; it is not used.
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
        """Take in a sighting.

        Args:
            observation: The sighting, newer than the last one.
            motion: Their motion, corrected by it.
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
        """Take in a sighting that is older than the last one: if the track has only begun, and has none of that time.

        Args:
            observation: The sighting.

        Returns:
            Whether it is taken in.
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
        """Whether a sighting has another name of the tracker than the track; False where one of them has none."""
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
        """Let the predictor take in what was seen meanwhile, before it is their turn: all at once takes milliseconds.

        Args:
            most: Not more than so many sightings, the oldest first.

        Raises:
            Exception: Any exception of the predictor.
        """
        for _ in range(min(most, len(self._waiting))):
            with contextlib.suppress(OutOfOrderError):
                self.start.update(self._waiting.popleft())

    @property
    def refused(self) -> bool:
        """Whether the predictor has refused the last sighting that it was given."""
        return bool(getattr(self._predictor, "rejections_in_a_row", 0))

    def begin_anew(self) -> None:
        """Forecast from the last sighting on: what was seen before was not the person."""
        self.start.reset()
        while len(self._waiting) > 1:
            self._waiting.popleft()

    def state(self, time_s: float, position_base_m: FloatArray) -> PersonState:
        """The person at a time.

        Args:
            time_s: The time, seconds.
            position_base_m: Where they are then, shape (3,), metres.

        Returns:
            The estimate.
        """
        facing = self._oriented
        lately = facing is not None and time_s - facing.capture_time_s <= _ORIENTATION_LASTS_S
        return PersonState(
            number=self.number,
            tracker_id=self.tracker_id,
            time_s=time_s,
            position_base_m=position_base_m,
            velocity_base_m_s=self.motion.velocity_m_s[0],
            head_quat_wxyz=facing.head_quat_wxyz if facing is not None and lately else None,
            seen_s=self.seen_s,
            since_s=self.since_s,
        )


def noise_of(observation: HeadObservation) -> FloatArray:
    """Covariance of a position's error, as stated or as assumed, shape (3, 3), square metres."""
    return noise_m2(observation, _POSITION_NOISE_M2)
