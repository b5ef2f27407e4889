"""Input stage of a live run: polls the source, transforms observations to the base frame, counts and checks them."""

from __future__ import annotations

import logging
import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.live.logs import LiveReport
from gazempc.live.mount import JointHistory
from gazempc.live.plausibility import Plausibility, Watch, out_of_place
from gazempc.live.setup import LiveSetup
from gazempc.live.sources.source import Arrived, Notice, check_range
from gazempc.live.stamps import ClockOffset, Frame, Stamps
from gazempc.loop.boundary import boundary
from gazempc.loop.events import Event
from gazempc.loop.looking_away import LookingAway
from gazempc.loop.observer import JointEstimate
from gazempc.loop.recorder import LoopRecorder
from gazempc.loop.track import AroundTarget, Target
from gazempc.people.company import Cue, check_cue
from gazempc.types import CameraView, FloatArray, Sighting
from predictors import HeadObservation

_LOGGER = logging.getLogger("gazempc.live")
# Length of the queue: older observations are outdated, and processing them would delay the tick.
_NEWEST = 16
# Two frames of twenty people.
_NEWEST_OF_SEVERAL = 40
# Period of repeated warnings about refused observations, for example from a second tracker.
_AGAIN_AFTER_S = 10.0
# Number of stored problem texts; further ones are counted.
_PROBLEMS_KEPT = 20
# Length of the queue of joint states while a part blocks.
_JOINTS_KEPT = 1000
# Share of a tick for the processing of observations: the command must be sent in time.
_TICK_SHARE = 0.2


class Arrivals:
    """Polls the source at every tick; an exception of the source becomes an event.

    Args:
        setup: The parts of the run.
        report: Receives the counts.

    Attributes:
        heads_seen: Called with each reported head and its time, seconds, also implausible ones; None for no listener.
    """

    def __init__(self, setup: LiveSetup, report: LiveReport) -> None:
        self._source, self._mount, self._geometry = setup.source, setup.mount, setup.neck.geometry
        self._sources = [setup.source, *setup.more_sources]
        self._report = report
        self._use_ids, self._cues = setup.use_ids, setup.cues
        people = setup.several.several if isinstance(setup.several, LookingAway) else None
        self._one_person = people is None
        self._newest = _NEWEST if people is None else _NEWEST_OF_SEVERAL
        self._watch = Watch(setup.clock, setup.stamps, setup.mount, setup.loop, setup.hints, people is not None)
        self._joints = JointHistory()
        self._noted: deque[tuple[float, FloatArray, FloatArray]] = deque(maxlen=_JOINTS_KEPT)
        self._waiting: deque[Sighting] = deque()
        # Processing takes no time on a simulated clock.
        self._longest_s = _TICK_SHARE * setup.neck.servo_period_s if setup.clock.is_real else math.inf
        self._plausibility = Plausibility()
        latency_s = (Stamps() if setup.stamps is None else setup.stamps.stamps).latency_s
        self._offset = ClockOffset(latency_s, setup.hints)
        self._warned_s: dict[Event, float] = {}
        self.heads_seen: Callable[[Iterable[Sighting], float], None] | None = None

    def note_joints(self, now_s: float, joints: JointEstimate) -> None:
        """Record the joint angles, for the pose of a moving sensor; may be called by another thread.

        Args:
            now_s: The time, seconds.
            joints: The joints at this time.
        """
        self._noted.append((now_s, joints.position_rad, joints.velocity_rad_s))

    def take(self, now_s: float, recorder: LoopRecorder) -> Iterable[Sighting]:
        """Observations since the last tick.

        Args:
            now_s: The time, seconds.
            recorder: Records events.

        Returns:
            Observations in the base frame, generated lazily within the time budget of the tick.
        """
        while self._noted:
            self._joints.add(*self._noted.popleft())
        for source in self._sources:
            arrived = Arrived()
            with boundary(source, "poll", partial(recorder.event, now_s, Event.SOURCE_FAILED)):
                arrived = _checked(source.poll())
            self._sort(arrived, now_s, recorder)
        shifted = () if self._offset.finding is None else (self._offset.finding,)
        for finding in (*shifted, *self._watch.findings(now_s)):
            self._warn(now_s, recorder, *finding)
        return self._in_time(now_s, recorder)

    def _sort(self, arrived: Arrived, now_s: float, recorder: LoopRecorder) -> None:
        """Distribute observations, problems, notices and cues."""
        for cue in arrived.cues:
            self._cues.put(cue)
        self._waiting += arrived.sightings
        while len(self._waiting) > self._newest:
            self._waiting.popleft()
            self._report.observations += 1
            recorder.refuse(Event.OBSERVATIONS_DROPPED, now_s)
        for problem in arrived.problems:
            self._report.observations += 1
            self._problem(now_s, recorder, problem)
        for notice in arrived.notices:
            if notice.count:
                self._report.observations += notice.count
                recorder.refused(notice.event, notice.count)
            self._warn(now_s, recorder, notice.event, notice.text, _AGAIN_AFTER_S if notice.count else 0.0)

    def _in_time(self, now_s: float, recorder: LoopRecorder) -> Iterator[Sighting]:
        """Queued observations within the time budget of the tick; the others remain queued."""
        until_s = time.perf_counter() + self._longest_s
        while self._waiting:
            sighting = self._waiting.popleft()
            self._report.observations += 1
            try:
                in_base = self._in_base(sighting)
            except Exception as error:  # observations of user-defined sources are untrusted
                self._problem(now_s, recorder, str(error))
                continue
            if self.heads_seen is not None:
                self.heads_seen((in_base,), now_s)
            head_m, whose = in_base.observation.head_position_base_m, in_base.observation.person_id
            if whose is None and not self._one_person:
                # The person is unknown before association, so speed cannot be judged.
                why = out_of_place(head_m)
            else:
                why = self._plausibility.refusal(in_base.observation.capture_time_s, head_m, whose)
            if why:
                recorder.refused(Event.IMPLAUSIBLE_PERSON)
                self._warn(now_s, recorder, Event.IMPLAUSIBLE_PERSON, why)
            else:
                yield in_base
            if time.perf_counter() > until_s:
                return

    def _problem(self, now_s: float, recorder: LoopRecorder, text: str) -> None:
        recorder.refuse(Event.BAD_OBSERVATION, now_s)
        if not self._report.problems:
            _LOGGER.warning("%s: %s", Event.BAD_OBSERVATION, text)
        if len(self._report.problems) < _PROBLEMS_KEPT:
            self._report.problems.append(text)

    def _warn(self, now_s: float, recorder: LoopRecorder, event: Event, text: str, again_s: float = math.inf) -> None:
        """Record an event, and log its text as a rate-limited warning."""
        recorder.event(now_s, event)
        warned_s = self._warned_s.get(event, -math.inf)
        if now_s - warned_s >= again_s or warned_s == -math.inf:
            self._warned_s[event] = now_s
            _LOGGER.warning("%s: %s", event, text)
            if warned_s == -math.inf or not again_s:
                self._report.warnings.append(f"{event}: {text}")

    def finished(self, now_s: float, recorder: LoopRecorder) -> bool:
        """Whether the source has ended.

        Args:
            now_s: The time, seconds.
            recorder: Records events.

        Returns:
            True after the end of the source.
        """
        with boundary(self._source, "finished", partial(recorder.event, now_s, Event.SOURCE_FAILED)):
            return bool(self._source.finished) and not self._waiting
        return False

    def _in_base(self, sighting: Sighting) -> Sighting:
        seen = self._mount.in_sensor(sighting.observation)
        if not self._use_ids:
            seen = replace(seen, person_id=None)
        head_m, stated_s = seen.head_position_base_m, seen.capture_time_s
        check_range(head_m)
        shift_s = self._offset.shift_s(sighting.arrival_s, stated_s)
        self._report.least_age_s = min(self._report.least_age_s, self._offset.age_s)
        self._report.greatest_age_s = max(self._report.greatest_age_s, self._offset.age_s)
        if shift_s:
            seen = replace(seen, capture_time_s=stated_s + shift_s)
        moves = self._mount.moves
        angles_rad = self._joints.at(seen.capture_time_s) if moves else None
        known = angles_rad is not None or not moves
        in_base = self._mount.to_base(seen, self._geometry, angles_rad) if known else None
        # Also checked without a position in the base frame, to find the cause of a wrong stamp.
        base_m = None if in_base is None else in_base.head_position_base_m
        self._watch.observe(Frame(sighting.arrival_s, stated_s, head_m, base_m, seen.person_id))
        if in_base is None:
            on = self._mount.on
            raise ValueError(f"the sensor moves with the {on}, whose angles at the capture time are unknown")
        return Sighting(sighting.arrival_s, in_base, head_m if moves else None, self._view(angles_rad))

    def _view(self, angles_rad: FloatArray | None) -> CameraView | None:
        """The view of a source with `half_view_rad`: half of the width and height of its pictures."""
        half_rad = getattr(self._source, "half_view_rad", None)
        if half_rad is None:
            return None
        ahead = HeadObservation(0.0, np.array([1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]))
        placed = self._mount.to_base(ahead, self._geometry, angles_rad)
        assert placed.head_quat_wxyz is not None
        axes = Rotation.from_quat(placed.head_quat_wxyz, scalar_first=True).as_matrix()
        return CameraView(placed.head_position_base_m - axes[:, 0], axes, half_rad)


class ArrivingTarget(AroundTarget):
    """A target that polls the sources in the planner's thread.

    Args:
        target: The person to look at.
        arrivals: Polls the sources.

    Attributes:
        finished: Whether the source has ended.
        stopped: Set to end polling.
    """

    def __init__(self, target: Target, arrivals: Arrivals) -> None:
        super().__init__(target)
        self._arrivals = arrivals
        self.finished = self.stopped = False

    def assimilate(self, sightings: Iterable[Sighting], time_s: float, recorder: LoopRecorder) -> None:
        """See `gazempc.loop.track.Target.assimilate`; processes the observations of the sources."""
        if not self.stopped:
            self._target.assimilate(self._arrivals.take(time_s, recorder), time_s, recorder)
            self.finished = self._arrivals.finished(time_s, recorder)


def _checked(arrived: object) -> Arrived:
    """Validate types and cues; observations are validated individually."""
    if not isinstance(arrived, Arrived):
        raise TypeError(f"poll() returned {type(arrived).__name__}, expected an Arrived")
    kinds: dict[str, Any] = {"sightings": object, "problems": str, "notices": Notice, "cues": Cue}
    for name, kind in kinds.items():
        values = getattr(arrived, name)
        if not isinstance(values, tuple | list) or not all(isinstance(each, kind) for each in values):
            raise TypeError(f"poll() returned {name} {values!r:.100}, see gazempc.live.sources.source.Arrived")
    for cue in arrived.cues:
        check_cue(cue)
    return arrived
