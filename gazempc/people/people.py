"""Multi-person tracker: association of detections, birth and death of tracks, re-identification."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from enum import StrEnum

import numpy as np

from gazempc.neck.kinematics import pan_tilt_rad, unit_vector, wrapped_rad
from gazempc.people.association import Motion, assign
from gazempc.people.person import ONE_FRAME_S, PersonState, TrackedPerson
from gazempc.types import FloatArray, Sighting
from predictors import Forecast, HeadObservation, Predictor

# Detections that confirm a track: false ones rarely last for three frames.
_CONFIRMED_BY = 3
# Timeout of a tentative track that has missed a frame.
_TENTATIVE_S = 0.3
# Detections within this distance, less than between two heads, are duplicates of one person.
_ONE_PERSON_M = 0.25
# Reachability gate of re-identification by name: speed and position error.
_RETURN_SPEED_M_S, _RETURN_ERROR_M = 2.0, 0.5
# Re-identification without a name: longest occlusion, and growth of the distance from the extrapolated position.
_WALKED_ON_S, _STRAYED_M_S = 3.0, 0.2
# End of a lost track; trackers may reuse its name afterwards.
_FORGOTTEN_AFTER_S = 30.0


class Became(StrEnum):
    """Result of the association of a detection."""

    USED = "used"
    TENTATIVE = "tentative"
    ENTERED = "entered"
    RETURNED = "returned"
    RENAMED = "renamed"
    DUPLICATE = "duplicate"
    OUT_OF_ORDER = "out_of_order"
    LATE = "late"


def frames_of(sightings: Sequence[Sighting]) -> Iterator[tuple[Sighting, ...]]:
    """Group sightings by capture time.

    Args:
        sightings: The sightings, in any order.

    Yields:
        Sightings of one instant, within 10 ms; the oldest first.
    """
    frame: list[Sighting] = []
    for sighting in sorted(sightings, key=lambda each: each.observation.capture_time_s):
        if frame and sighting.observation.capture_time_s - frame[0].observation.capture_time_s > ONE_FRAME_S:
            yield tuple(frame)
            frame = []
        frame.append(sighting)
    if frame:
        yield tuple(frame)


class People:
    """Keeps a track of each person.

    Detections of one instant are assigned to the predicted positions. A track without a detection coasts. After
    `coast_s` the person is considered absent, and may be re-identified.

    Args:
        make_predictor: Factory of a predictor for each person.
        coast_s: Time without a detection after which a track ends, seconds.
    """

    def __init__(self, make_predictor: Callable[[], Predictor], coast_s: float = 1.0) -> None:
        self._make_predictor = make_predictor
        self._coast_s = coast_s
        self._tracks: list[TrackedPerson] = []
        self._gone: list[TrackedPerson] = []
        self._count = 0
        self._newest_s = -math.inf

    def observe(self, observations: Sequence[HeadObservation]) -> list[tuple[int, Became]]:
        """Process detections of one frame.

        Args:
            observations: Detections of one instant (`frames_of`), in the base frame; may be a part of the frame.

        Returns:
            For each detection, the number of the person (0 for none) and the result of the association.
        """
        if not observations:
            return []
        capture_s = min(seen.capture_time_s for seen in observations)
        frame_before_s, self._newest_s = self._newest_s, max(self._newest_s, capture_s)
        self._remove_ended(self._newest_s, frame_before_s)
        found: dict[int, tuple[int, Became]] = {}
        # Confirmed tracks have precedence over tentative ones.
        for confirmed in (True, False):
            tracks = [t for t in self._tracks if t.confirmed is confirmed and t.seen_s < capture_s]
            left = [k for k in range(len(observations)) if k not in found]
            for track, which in self._assigned(tracks, [observations[k] for k in left], capture_s):
                became = self._updated(track, observations[left[which]])
                found[left[which]] = (track.number, became)
        return [found.get(k) or self._unassigned(seen) for k, seen in enumerate(observations)]

    def present(self, time_s: float) -> tuple[PersonState, ...]:
        """All people present.

        Args:
            time_s: The time, seconds.

        Returns:
            The people in order of entry.
        """
        there = sorted(self.confirmed, key=lambda track: track.number)
        return tuple(track.state(time_s) for track in there if time_s - track.seen_s <= self._coast_s)

    def track(self, number: int) -> TrackedPerson | None:
        """The track of a person.

        Args:
            number: Number of the person.

        Returns:
            The track; None after its end.
        """
        return next((t for t in self.confirmed if t.number == number), None)

    @property
    def confirmed(self) -> list[TrackedPerson]:
        """The confirmed tracks."""
        return [track for track in self._tracks if track.confirmed]

    def _remove_ended(self, time_s: float, frame_before_s: float) -> None:
        # A person detected in the previous frame is not missed yet, also at a low frame rate.
        lasts = {t: self._coast_s if t.confirmed or t.seen_s >= frame_before_s else _TENTATIVE_S for t in self._tracks}
        self._tracks = [t for t, lasts_s in lasts.items() if time_s - t.seen_s <= lasts_s]
        gone = (*self._gone, *(t for t in lasts if t.confirmed and t not in self._tracks))
        self._gone = [t for t in gone if time_s - t.seen_s <= _FORGOTTEN_AFTER_S]

    def _assigned(
        self, tracks: Sequence[TrackedPerson], observations: Sequence[HeadObservation], capture_s: float
    ) -> list[tuple[TrackedPerson, int]]:
        """Tracks, with updated motion, and the indices of their observations."""
        if not (tracks and observations):
            return []
        unseen_s: FloatArray = np.array([capture_s - track.seen_s for track in tracks])
        expected = Motion.stack([track.motion for track in tracks]).after(unseen_s)
        found = assign(expected, unseen_s, [track.tracker_id for track in tracks], observations)
        for row, _, motion in found:
            tracks[row].motion = motion
        return [(tracks[row], column) for row, column, _ in found]

    def _updated(self, track: TrackedPerson, observation: HeadObservation) -> Became:
        renamed = track.is_named_otherwise(observation)
        track.take(observation, track.motion)
        if track.confirmed:
            return Became.RENAMED if renamed else Became.USED
        if track.sightings < _CONFIRMED_BY or self._is_duplicate(track):
            return Became.TENTATIVE
        track.confirmed = True
        earlier = self._earlier(track)
        if earlier is None:
            self._count += 1
            track.number = self._count
            return Became.ENTERED
        # Re-identification of a lost track, or of one that jumped.
        self._tracks = [t for t in self._tracks if t is not track and t is not earlier]
        self._gone = [t for t in self._gone if t is not earlier]
        track.number, track.since_s = earlier.number, earlier.since_s
        self._tracks.append(track)
        return Became.RETURNED

    def _unassigned(self, observation: HeadObservation) -> tuple[int, Became]:
        where, capture_s = observation.head_position_base_m, observation.capture_time_s
        near = [
            track
            for track in self._tracks
            if (late_s := track.seen_s - capture_s) >= 0.0
            and math.dist(where, track.position_m(capture_s)) < _ONE_PERSON_M + _RETURN_SPEED_M_S * late_s
        ]
        if near and near[0].seen_s == capture_s:
            return (near[0].number, Became.DUPLICATE)
        if near:
            # Between two people who stand together it is ambiguous.
            used = len(near) == 1 and near[0].take_late(observation)
            return (near[0].number, Became.LATE if used else Became.OUT_OF_ORDER)
        self._tracks.append(TrackedPerson(0, observation, self._make_predictor()))
        return (0, Became.TENTATIVE)

    def _is_duplicate(self, track: TrackedPerson) -> bool:
        others = [t for t in self.confirmed if abs(t.seen_s - track.seen_s) <= _TENTATIVE_S]
        return any(math.dist(t.motion.position_m[0], track.motion.position_m[0]) < _ONE_PERSON_M for t in others)

    def _earlier(self, track: TrackedPerson) -> TrackedPerson | None:
        """The earlier track of this person: the last one with the same name, or one extrapolated to this position."""
        before = [t for t in (*self._gone, *self.confirmed) if t is not track and t.seen_s < track.since_s]
        for earlier in sorted(before, key=lambda t: -t.seen_s):
            named = None not in (earlier.tracker_id, track.tracker_id)
            if named and earlier.tracker_id != track.tracker_id:
                continue
            away_s = track.since_s - earlier.seen_s
            if not named and away_s > _WALKED_ON_S:
                continue
            expected_m = earlier.position_m(earlier.seen_s if named else track.seen_s)
            error_m_s = _RETURN_SPEED_M_S if named else _STRAYED_M_S
            if math.dist(expected_m, track.motion.position_m[0]) <= _RETURN_ERROR_M + error_m_s * away_s:
                return earlier
        return None


def middle_of(forecasts: Sequence[Forecast]) -> Forecast:
    """Centre of the angular bounding box of several people.

    Args:
        forecasts: One per person, for the same times.

    Returns:
        Midpoints of the ranges of pan and of tilt, at the mean distance; all else from the first forecast.
    """
    means_m = np.array([forecast.means_base_m for forecast in forecasts])
    pans_rad, tilts_rad = np.moveaxis(pan_tilt_rad(means_m), -1, 0)
    # Relative to the first person's pan, to avoid the wrap at +-180 deg.
    aside_rad = wrapped_rad(pans_rad - pans_rad[0])
    pan_rad = pans_rad[0] + 0.5 * (aside_rad.min(axis=0) + aside_rad.max(axis=0))
    tilt_rad = 0.5 * (tilts_rad.min(axis=0) + tilts_rad.max(axis=0))
    directions = np.stack(unit_vector(pan_rad, tilt_rad), axis=-1)
    ranges_m = np.linalg.norm(means_m, axis=-1).mean(axis=0)
    return replace(forecasts[0], means_base_m=ranges_m[:, None] * directions)
