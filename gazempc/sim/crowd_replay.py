"""Several people in a replay: what is seen of them, who is looked at, and where that one really is."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np

from gazempc.errors import SettingsError
from gazempc.loop.attended import AttendedPeople
from gazempc.loop.build import Person, make_predictor
from gazempc.people.attention import Attention
from gazempc.people.build import make_policy
from gazempc.recordings.truth import TrueHead
from gazempc.results.log import Log
from gazempc.settings import GazeSettings
from gazempc.sim.crowd import PerfectOfCrowd, nearest_of, observe_together
from gazempc.sim.scene import Scene
from gazempc.types import FloatArray, IntArray
from predictors import Predictor

_NOBODY = -1


class Crowd:
    """All people of a scene, and the one who is looked at.

    Args:
        scene: The scene.
        target: Whom the loop looks at.

    Attributes:
        sightings: What the sensor sees of everybody, in the order of arrival.
        target: Whom the loop looks at.
    """

    def __init__(self, scene: Scene, target: AttendedPeople) -> None:
        walks = (scene.walk, *scene.others)
        self.sightings = [sighting for _, sighting in observe_together(walks, scene.sensor, scene.seed)]
        self.target = target
        self._heads = [TrueHead(walk) for walk in walks]
        self._whom: list[tuple[float, int]] = []
        self._last = (0, -np.inf, _NOBODY)

    @staticmethod
    def of(scene: Scene, predictor: Predictor | str, settings: GazeSettings) -> Crowd | None:
        """Make one where the settings say whom to look at.

        Args:
            scene: The scene.
            predictor: A predictor, which is copied for everybody, or its name.
            settings: Parameters of the parts.

        Returns:
            The crowd; None where all observations are one person's.

        Raises:
            SettingsError: If several people are there and nothing says whom to look at, or the sensor turns with the
                head.
        """
        if settings.attend is None:
            if scene.others:
                raise SettingsError(
                    f"{scene.name}: several people are there: say whom to look at, such as --attend nearest"
                )
            return None
        if scene.sensor.view.on == "head" and scene.sensor.view.limited:
            raise SettingsError(
                f"--attend: sensor {scene.sensor.name!r} turns with the head; accepted: one on the base"
            )
        options = dict(getattr(settings, "options", {}))
        attention = Attention(make_policy(settings.attend, options), settings.attention)
        heads = [TrueHead(walk) for walk in (scene.walk, *scene.others)]

        def make() -> Predictor:
            if predictor == "perfect":
                return PerfectOfCrowd(heads)
            if not isinstance(predictor, str):
                return copy.deepcopy(predictor)
            return make_predictor(predictor, settings, Person(), options)

        return Crowd(scene, AttendedPeople(make, attention, settings.loop))

    def note(self, now_s: float) -> None:
        """Keep who is looked at; called after each tick.

        Args:
            now_s: The time, seconds.
        """
        number = self.target.attention.attended.number
        track = None if number is None else self.target.people.track(number)
        if number is None or track is None:
            self._last = (0, -np.inf, _NOBODY)
        elif (number, track.seen_s) != self._last[:2]:
            # Whose detections they are may change while their number does not.
            self._last = (number, track.seen_s, nearest_of(self._heads, track.seen_s, track.motion.position_m[0]))
        self._whom.append((now_s, self._last[2]))

    def attended_head(self, times_s: FloatArray) -> FloatArray:
        """Where the head of whoever was looked at then really was.

        Args:
            times_s: Times, shape (H,), seconds.

        Returns:
            Positions, shape (H, 3), metres; NaN where nobody was looked at, or it is not known.
        """
        found = np.full((times_s.size, 3), np.nan)
        whom = self._whom_at(times_s)
        for k, head in enumerate(self._heads):
            mine = (whom == k) & head.known(times_s)
            if mine.any():
                found[mine] = head(times_s[mine])
        return found

    def of_one_person(self, log: Log) -> Log:
        """Take out of a log what would compare a forecast of one person with another one.

        Args:
            log: The log.

        Returns:
            The log; true heads at times of forecasts are NaN where somebody else was looked at by then.
        """
        then = self._whom_at(log.capture_time_s)[:, None]
        ahead = log.capture_time_s[:, None] + log.forecast_horizon_s
        same = self._whom_at(ahead.ravel()).reshape(ahead.shape) == then
        return replace(log, forecast_true_base_m=np.where(same[:, :, None], log.forecast_true_base_m, np.nan))

    def _whom_at(self, times_s: FloatArray) -> IntArray:
        ticks_s, whom = (np.array(values) for values in zip(*self._whom, strict=True))
        at = np.clip(np.searchsorted(ticks_s, times_s + 1e-9) - 1, 0, ticks_s.size - 1)
        return np.where(times_s <= ticks_s[-1] + 1e-9, whom[at], _NOBODY).astype(np.intp)
