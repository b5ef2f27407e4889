"""What arrives at a tick of a live run: asked for, brought into the base frame, and counted."""

from __future__ import annotations

from gazempc.live.mount import JointHistory
from gazempc.live.parts import LiveParts
from gazempc.live.report import LiveReport
from gazempc.live.sources.source import Arrived, check_range
from gazempc.loop.events import Event
from gazempc.loop.observer import JointEstimate
from gazempc.loop.recorder import LoopRecorder
from gazempc.types import Sighting

# What has piled up beyond this is old. Taking it in holds up the tick.
_NEWEST = 16


class Arrivals:
    """Asks the source at every tick. A source that raises is survived: its exception is an event.

    Args:
        parts: The parts of the run.
        report: Where to count.
    """

    def __init__(self, parts: LiveParts, report: LiveReport) -> None:
        self._source, self._mount, self._geometry = parts.source, parts.mount, parts.neck.geometry
        self._report = report
        self._joints = JointHistory()

    def note_joints(self, now_s: float, joints: JointEstimate) -> None:
        """Keep where the joints were: a sensor on the head is turned by them.

        Args:
            now_s: The time, seconds.
            joints: The joints then.
        """
        self._joints.add(now_s, joints.position_rad, joints.velocity_rad_s)

    def take(self, now_s: float, recorder: LoopRecorder) -> list[Sighting]:
        """What has arrived since the last tick.

        Args:
            now_s: The time, seconds.
            recorder: Where events go.

        Returns:
            Observations in the base frame.
        """
        try:
            arrived = self._source.poll()
            if not isinstance(arrived, Arrived):
                raise TypeError(f"poll() returned {type(arrived).__name__}, needed is an Arrived")
        except Exception as error:
            recorder.event(now_s, Event.SOURCE_FAILED, error)
            return []
        found, problems = [], list(arrived.problems)
        if len(arrived.sightings) > _NEWEST:
            recorder.event(now_s, Event.OBSERVATIONS_DROPPED)
        for sighting in arrived.sightings[-_NEWEST:]:
            try:
                found.append(self._in_base(sighting))
            except (ValueError, AttributeError, TypeError) as error:
                problems.append(str(error))
        self._report.observations += len(arrived.sightings)
        for problem in problems:
            recorder.event(now_s, Event.BAD_OBSERVATION)
            self._report.problem(problem)
        return found

    def finished(self, now_s: float, recorder: LoopRecorder) -> bool:
        """Whether the source has ended.

        Args:
            now_s: The time, seconds.
            recorder: Where events go.

        Returns:
            True once nothing more will come.
        """
        try:
            return bool(self._source.finished)
        except Exception as error:
            recorder.event(now_s, Event.SOURCE_FAILED, error)
            return False

    def _in_base(self, sighting: Sighting) -> Sighting:
        observation = sighting.observation
        check_range(observation.head_position_base_m)
        moves = self._mount.on == "head"
        angles_rad = self._joints.at(observation.capture_time_s) if moves else None
        in_base = self._mount.to_base(observation, self._geometry, angles_rad)
        return Sighting(sighting.arrival_s, in_base, observation.head_position_base_m if moves else None)
