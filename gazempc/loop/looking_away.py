"""Gaze aversion as a wrapper of a target, which is tracked all the time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from gazempc.loop.attended import AttendedPeople
from gazempc.loop.events import Event
from gazempc.loop.recorder import LoopRecorder
from gazempc.loop.track import AroundTarget, Target
from gazempc.people.attention import AttentionState
from gazempc.people.company import Choice, Cue, Cues, Rhythm, Sound, Speech, Thinking
from gazempc.people.schedule import LookAways
from gazempc.types import FloatArray, Sighting
from predictors import Forecast


class LookingAway(AroundTarget):
    """Inserts gaze aversions into a target's forecasts, so that any controller plans the shifts with preview.

    Args:
        target: The wrapped target.
        look_aways: Schedule of gaze aversion.
        cues: Cues of a program; None for no program.
    """

    def __init__(self, target: Target, look_aways: LookAways, cues: Cues | None = None) -> None:
        super().__init__(target)
        self._look_aways = look_aways
        self._cues = cues
        self._person_base_m: FloatArray | None = None
        self._recorded_s = -float("inf")
        self._left_out = 0

    @property
    def several(self) -> AttendedPeople | None:
        """The target of several people; None for a target of one person."""
        return self._target if isinstance(self._target, AttendedPeople) else None

    def state(self, time_s: float) -> AttentionState:
        """The person attended.

        Args:
            time_s: The time, seconds.

        Returns:
            The state; this query has no side effect.
        """
        state = AttentionState(why="one") if self.several is None else self.several.state
        away = self._look_aways.going_on(time_s)
        if away is None:
            return state
        return replace(state, away_why=away.why, away_since_s=away.start_s, away_until_s=away.end_s)

    def assimilate(self, sightings: Iterable[Sighting], time_s: float, recorder: LoopRecorder) -> None:
        """See `gazempc.loop.track.Target.assimilate`."""
        for cue in () if self._cues is None else self._cues.take():
            self._take_cue(cue, time_s)
        before = self.several and self.several.attention.attended
        self._target.assimilate(sightings, time_s, recorder)
        if self.several and self.several.attention.attended is not before:
            # No aversion immediately after a switch.
            self._look_aways.set_mode(self._look_aways.mode, time_s)

    def _take_cue(self, cue: Cue, time_s: float) -> None:
        if isinstance(cue, Sound):
            if self.several is not None:
                self.several.attention.hear(Sound(time_s, cue.azimuth_rad))
        elif isinstance(cue, Choice):
            if self.several is not None:
                self.several.attention.chosen_id = cue.person_id
        elif isinstance(cue, Thinking):
            self._look_aways.think(time_s, cue.lasts_s)
        elif isinstance(cue, Speech):
            self._look_aways.speech_starts(time_s, time_s + cue.in_s)
        elif isinstance(cue, Rhythm):
            self._look_aways.set_mode(cue.mode, time_s)
        elif self._person_base_m is not None:
            self._look_aways.glance(time_s, cue.target_base_m, self._person_base_m, cue.lasts_s)

    def forecast(self, times_s: FloatArray, time_s: float, recorder: LoopRecorder) -> Forecast | None:
        """See `gazempc.loop.track.Target.forecast`: the person, or the gaze target of an aversion."""
        forecast = self._target.forecast(times_s, time_s, recorder)
        if forecast is None:
            return None
        self._person_base_m = forecast.means_base_m[0]
        composed = self._look_aways.into(forecast, time_s)
        for each in self._look_aways.planned(time_s):
            # An aversion that has begun is completed, so it can be recorded.
            if self._recorded_s < each.start_s <= time_s:
                self._recorded_s = each.start_s
                recorder.looks_away(each.start_s, each.end_s, each.why)
        if self._look_aways.left_out > self._left_out:
            self._left_out = self._look_aways.left_out
            recorder.event(time_s, Event.LOOK_AWAY_LEFT_OUT)
        return composed
