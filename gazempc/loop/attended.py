"""Multi-person target: tracks all people and forecasts the attended one."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from functools import partial

from gazempc.loop.boundary import boundary
from gazempc.loop.events import Event
from gazempc.loop.recorder import LoopRecorder
from gazempc.loop.track import RECORDED_HORIZONS_S, forecast_of, why_not_usable
from gazempc.people.attention import Attention, AttentionState
from gazempc.people.people import Became, People, frames_of, middle_of
from gazempc.people.person import CATCH_UP, TrackedPerson
from gazempc.people.tracker_faults import FrozenPeople
from gazempc.settings import LoopSettings
from gazempc.types import CameraView, FloatArray, Sighting
from predictors import Forecast, HeadObservation, Predictor

# Period of decisions: half the frame period of a camera, or less.
_DECIDED_EVERY_S = 0.02
_EVENTS = {
    Became.ENTERED: Event.PERSON_ENTERED,
    Became.RETURNED: Event.PERSON_RETURNED,
    Became.RENAMED: Event.PERSON_RENAMED,
}
_REFUSED = {Became.DUPLICATE: Event.SEEN_TWICE, Became.OUT_OF_ORDER: Event.OUT_OF_ORDER}


class AttendedPeople:
    """Tracks all people, chooses the attended one, and forecasts that person.

    Args:
        make_predictor: Factory of a predictor for each person.
        attention: Chooses the attended person.
        settings: Maximum ages of observations and tracks.
        everyone: Forecast the centre of the bounding box of all people present, in place of the attended person.

    Attributes:
        predictor: An instance of the predictors in use.
        newest_capture_s: Capture time of the newest observation of the person attended now or last,
            seconds; None before the first one.
        newest: The newest observation of the attended person; None before the first one.
        people: All tracked people.
        attention: Chooses the attended person.
    """

    def __init__(
        self,
        make_predictor: Callable[[], Predictor],
        attention: Attention,
        settings: LoopSettings,
        everyone: bool = False,
    ) -> None:
        self._everyone = everyone
        self.predictor = make_predictor()
        self.newest: HeadObservation | None = None
        self.newest_capture_s: float | None = None
        self.people = People(make_predictor, settings.lost_after_s)
        self.attention = attention
        self._settings = settings
        self._view: CameraView | None = None
        self._decided_s = -math.inf
        self._frozen = FrozenPeople()

    @property
    def state(self) -> AttentionState:
        """The attended person, and the reason."""
        attended, track = self.attention.attended, self._attended()
        return AttentionState(
            person=attended.number,
            person_id=None if track is None else track.tracker_id,
            why=attended.why,
            since_s=attended.since_s if math.isfinite(attended.since_s) else None,
            stays_until_s=None if attended.number is None else attended.since_s + self.attention.settings.dwell_s,
        )

    def assimilate(self, sightings: Iterable[Sighting], time_s: float, recorder: LoopRecorder) -> None:
        """Update the tracks with the observations that have arrived, and choose the attended person.

        Args:
            sightings: Observations of all people, in the base frame.
            time_s: The time, seconds.
            recorder: Records new people, changes of attention, and observations of the attended person.
        """
        usable = []
        for sighting in sightings:
            event = why_not_usable(sighting, time_s, self._settings)
            if event is None:
                self._view = sighting.view
                usable.append(sighting)
            else:
                recorder.refuse(event, time_s)
        for frame in frames_of(usable):
            with boundary(self.predictor, "update", partial(recorder.refuse, Event.FORECAST_FAILED, time_s)):
                self._take_frame(frame, time_s, recorder)
        if usable or time_s - self._decided_s >= _DECIDED_EVERY_S:
            self._decided_s = time_s
            self._decide(time_s, recorder)

    def forecast(self, times_s: FloatArray, time_s: float, recorder: LoopRecorder) -> Forecast | None:
        """Forecast the attended person, or all; see `gazempc.loop.track.PersonTrack.forecast`."""
        attended = self._attended()
        if attended is None:
            return None
        found = forecast_of(self.predictor, attended.forecast, attended.start, self._view, times_s, time_s, recorder)
        if found is None or not self._everyone:
            return found
        others = [track for track in self.people.confirmed if track is not attended]
        theirs = [
            forecast_of(self.predictor, t.forecast, t.start, self._view, times_s, time_s, recorder) for t in others
        ]
        return middle_of([found, *(each for each in theirs if each is not None)])

    def _take_frame(self, frame: tuple[Sighting, ...], time_s: float, recorder: LoopRecorder) -> None:
        fresh = [sighting for sighting in frame if not self._frozen.repeats(sighting)]
        if len(fresh) < len(frame):
            recorder.refused(Event.TRACKER_FROZEN, len(frame) - len(fresh))
        started = time.perf_counter()
        found = self.people.observe([sighting.observation for sighting in fresh])
        update_ms = 1e3 * (time.perf_counter() - started)
        for sighting, (number, became) in zip(fresh, found, strict=True):
            if became in _EVENTS:
                recorder.event(time_s, _EVENTS[became])
            if became in _REFUSED:
                recorder.refuse(_REFUSED[became], time_s)
                continue
            track = self.people.track(number)
            is_attended = number == self.attention.attended.number
            if track is not None and is_attended and became is Became.LATE:
                recorder.observation(time_s, sighting.observation, None, update_ms)
            elif track is not None and self._guarded(track, sighting, time_s, recorder):
                recorder.refuse(Event.TRACKER_FROZEN, time_s)
            elif track is not None and is_attended:
                seen = self.newest = sighting.observation
                self.newest_capture_s = seen.capture_time_s
                forecast = self.forecast(seen.capture_time_s + RECORDED_HORIZONS_S, time_s, recorder)
                if track.refused:
                    recorder.refuse(Event.GATE_REFUSED, time_s)
                recorder.observation(time_s, seen, forecast, update_ms, used=not track.refused)
            else:
                recorder.refused(Event.ANOTHER_PERSON)

    def _guarded(self, track: TrackedPerson, sighting: Sighting, time_s: float, recorder: LoopRecorder) -> bool:
        """Update the fault detectors with a sighting; returns whether the tracker is frozen."""
        if track.jumped:
            recorder.event(time_s, Event.ORIENTATION_JUMPED)
        frozen, goes_on = self._frozen.observe(track.number, sighting)
        if goes_on:
            # The last half second of the track is repeated frames, a false standstill.
            track.begin_anew()
        return frozen

    def _decide(self, time_s: float, recorder: LoopRecorder) -> None:
        before = self.attention.attended
        with boundary(self.attention.policy, "scores", partial(recorder.event, time_s, Event.POLICY_FAILED)):
            self.attention.update(self.people.present(time_s), time_s)
        now = self.attention.attended
        if now is not before:
            recorder.attended(time_s, now.number or 0, now.why)
            track = self._attended()
            if track is not None:
                recorder.event(time_s, Event.ATTENTION_SWITCHED)
                self.newest_capture_s = track.seen_s
            elif now.number is None:
                recorder.event(time_s, Event.NO_PERSON_ATTENDED)
        soon = None if self.attention.candidate is None else self.people.track(self.attention.candidate)
        if soon is not None:
            with boundary(self.predictor, "update", partial(recorder.event, time_s, Event.FORECAST_FAILED)):
                soon.catch_up(CATCH_UP)

    def _attended(self) -> TrackedPerson | None:
        number = self.attention.attended.number
        return None if number is None else self.people.track(number)
