"""Several people in a replay: what is seen of them, who is looked at, and where that one really is."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np

from gazempc.errors import SettingsError
from gazempc.loop.attended import AttendedPeople
from gazempc.loop.build import Person, make_predictor
from gazempc.people.attention import Attention
from gazempc.people.policies import make_policy
from gazempc.recordings.truth import TrueHead
from gazempc.results.log import Log
from gazempc.settings import GazeSettings
from gazempc.sim.crowd import PerfectOfCrowd, observe_together
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
        heads: Everybody's true head.
        seen: Whom the sensor sees, as a number in `heads`, and the sighting, in the order of arrival.
        target: Whom the loop looks at.
    """

    def __init__(self, scene: Scene, target: AttendedPeople) -> None:
        walks = (scene.walk, *scene.others)
        self.seen = observe_together(walks, scene.sensor, scene.seed)
        self.target = target
        self.heads = [TrueHead(walk) for walk in walks]
        self._whose = {id(sighting.observation): k for k, sighting in self.seen}
        self._owners: dict[int, int] = {}
        self._swaps_s: list[float] = []
        self._whom: list[tuple[float, int]] = []

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
            SettingsError: If several people are there and nothing says whom to look at.
        """
        if settings.attend is None:
            if scene.others:
                raise SettingsError(
                    f"{scene.name}: several people are there: say whom to look at, such as --attend nearest"
                )
            return None
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
        """Keep who is looked at, and who has become somebody else; called after each tick.

        Args:
            now_s: The time, seconds.
        """
        attended = _NOBODY
        for track in self.target.people.confirmed:
            # Whose observations they are may change while their number does not.
            owner = self._whose[id(track.newest)]
            if self._owners.setdefault(track.number, owner) != owner:
                self._owners[track.number] = owner
                self._swaps_s.append(now_s)
            if track.number == self.target.attention.attended.number:
                attended = owner
        self._whom.append((now_s, attended))

    def attended_head(self, times_s: FloatArray) -> FloatArray:
        """True position of the head that was looked at.

        Args:
            times_s: Times, shape (H,), seconds.

        Returns:
            Positions, shape (H, 3), metres; NaN where nobody was looked at, or it is not known.
        """
        found = np.full((times_s.size, 3), np.nan)
        whom = self._whom_at(times_s)
        for k, head in enumerate(self.heads):
            mine = (whom == k) & head.known(times_s)
            if mine.any():
                found[mine] = head(times_s[mine])
        return found

    def completed(self, log: Log) -> Log:
        """Take out of a log what would compare a forecast of one person with another one, and add whom it mixed up.

        Args:
            log: The log.

        Returns:
            The log; true heads at times of forecasts are NaN where somebody else was looked at by then.
        """
        then = self._whom_at(log.capture_time_s)[:, None]
        ahead = log.capture_time_s[:, None] + log.forecast_horizon_s
        same = self._whom_at(ahead.ravel()).reshape(ahead.shape) == then
        return replace(
            log,
            forecast_true_base_m=np.where(same[:, :, None], log.forecast_true_base_m, np.nan),
            identity_swap_time_s=np.array(self._swaps_s),
        )

    def _whom_at(self, times_s: FloatArray) -> IntArray:
        ticks_s, whom = (np.array(values) for values in zip(*self._whom, strict=True))
        at = np.clip(np.searchsorted(ticks_s, times_s + 1e-9) - 1, 0, ticks_s.size - 1)
        return np.where(times_s <= ticks_s[-1] + 1e-9, whom[at], _NOBODY).astype(np.intp)
