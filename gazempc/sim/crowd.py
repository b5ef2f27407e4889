"""The people of a replay: their simulated observations, mutual occlusion, and the attended one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gazempc.errors import SettingsError
from gazempc.loop.looking_away import LookingAway
from gazempc.loop.track import Target
from gazempc.recordings.recording import Recording, TrueHead
from gazempc.results.log import Log
from gazempc.sim.scene import Scene
from gazempc.sim.sensing.spec import SensorSpec
from gazempc.sim.sensor import observe
from gazempc.types import FloatArray, IntArray, Sighting
from predictors import HeadObservation, Perfect

# Half the width of shoulders (0.45 m): body and face trackers lose a person whose centre line is behind another's
# shoulders.
_COVERED_M = 0.225


def observe_together(walks: Sequence[Recording], sensor: SensorSpec, seed: int) -> list[tuple[int, Sighting]]:
    """Simulate observations of several simultaneous recordings.

    Args:
        walks: The recordings in the robot's base frame, with their own start times.
        sensor: The sensor.
        seed: Seed of its errors.

    Returns:
        Index of the recording and sighting, in order of arrival.

    Raises:
        SettingsError: If a person is never observed.
    """
    heads = [TrueHead(walk) for walk in walks]
    found: list[tuple[int, Sighting]] = []
    for k, walk in enumerate(walks):
        # Different names, for independent noise also if a recording occurs twice.
        seen = observe(replace(walk, name=f"{walk.name} {k}"), sensor, seed)
        times_s = np.array([sighting.observation.capture_time_s for sighting in seen])
        own_m = heads[k](times_s)
        range_m, hidden = np.linalg.norm(own_m, axis=1), np.zeros(times_s.size, dtype=np.bool_)
        for other, head in zip([*walks[:k], *walks[k + 1 :]], [*heads[:k], *heads[k + 1 :]], strict=True):
            plays = (other.times_s[0] <= times_s) & (times_s <= other.times_s[-1])
            nearer_m = np.linalg.norm(head(times_s), axis=1)
            # Distance of the nearer person from the line of sight to the farther one.
            along_m = np.sum(head(times_s) * own_m, axis=1) / range_m
            covers = (along_m > 0.0) & (nearer_m**2 - along_m**2 < _COVERED_M**2)
            hidden |= plays & (nearer_m < range_m) & covers
        found += [(k, sighting) for sighting, is_hidden in zip(seen, hidden.tolist(), strict=True) if not is_hidden]
    return sorted(found, key=lambda each: each[1].arrival_s)


class PerfectOfCrowd(Perfect):
    """The predictor `perfect` for several people: true future of the person nearest to its first observation.

    Args:
        heads: True head of each person.
    """

    def __init__(self, heads: Sequence[TrueHead]) -> None:
        super().__init__(heads[0])
        self._heads = heads

    def update(self, observation: HeadObservation) -> None:
        """Process one observation; see `predictors.predictor.Predictor.update`."""
        if self._last is None:
            seen_m, captured_s = observation.head_position_base_m, observation.capture_time_s
            away_m = [float(np.linalg.norm(head([captured_s])[0] - seen_m)) for head in self._heads]
            self._true_position_base_m = self._heads[int(np.argmin(away_m))]
        super().update(observation)


_NONE = -1


class Crowd:
    """All people of a scene, and the attended one; a single person is always attended.

    Args:
        scene: The scene.
        target: The target of the loop: the attended one of several people, or a single person.

    Attributes:
        heads: True head of each person.
        seen: Number in `heads` and sighting, in order of arrival.

    Raises:
        SettingsError: If there are several people and the target is for a single person.
    """

    def __init__(self, scene: Scene, target: Target) -> None:
        walks = (scene.walk, *scene.others)
        self._several = target.several if isinstance(target, LookingAway) else None
        if self._several is not None:
            self.seen = observe_together(walks, scene.sensor, scene.seed)
        elif scene.others:
            raise SettingsError(f"{scene.name}: several people: choose one by --attend, such as --attend nearest")
        else:
            self.seen = [(0, sighting) for sighting in observe(scene.walk, scene.sensor, scene.seed)]
        self.heads = [TrueHead(walk) for walk in walks]
        self._whose = {id(sighting.observation): k for k, sighting in self.seen}
        self._owners: dict[int, int] = {}
        self._swaps_s: list[float] = []
        # A single person is attended at all times.
        self._attended: list[tuple[float, int]] = [] if self._several is not None else [(-np.inf, 0), (np.inf, 0)]

    def note(self, now_s: float) -> None:
        """Record the attended person and identity swaps; called after each tick.

        Args:
            now_s: The time, seconds.
        """
        if self._several is None:
            return
        attended = _NONE
        for track in self._several.people.confirmed:
            # Identity swap: observations of another person under the same number.
            owner = self._whose[id(track.newest)]
            if self._owners.setdefault(track.number, owner) != owner:
                self._owners[track.number] = owner
                self._swaps_s.append(now_s)
            if track.number == self._several.attention.attended.number:
                attended = owner
        self._attended.append((now_s, attended))

    def attended_head(self, times_s: FloatArray) -> FloatArray:
        """True position of the attended head.

        Args:
            times_s: Times, shape (H,), seconds.

        Returns:
            Positions, shape (H, 3), metres; NaN if no person was attended, or the position is unknown.
        """
        found = np.full((times_s.size, 3), np.nan)
        whom = self._attended_at(times_s)
        for k, head in enumerate(self.heads):
            mine = (whom == k) & head.known(times_s)
            found[mine] = head(times_s[mine])
        return found

    def completed(self, log: Log) -> Log:
        """Remove comparisons of a forecast with another person from a log, and add identity swaps.

        Args:
            log: The log.

        Returns:
            The log; true heads at times of forecasts are NaN if another person was attended by then.
        """
        then = self._attended_at(log.capture_time_s)[:, None]
        ahead = log.capture_time_s[:, None] + log.forecast_horizon_s
        same = self._attended_at(ahead.ravel()).reshape(ahead.shape) == then
        return replace(
            log,
            forecast_true_base_m=np.where(same[:, :, None], log.forecast_true_base_m, np.nan),
            identity_swap_time_s=np.array(self._swaps_s),
        )

    def _attended_at(self, times_s: FloatArray) -> IntArray:
        ticks_s, whom = (np.array(values) for values in zip(*self._attended, strict=True))
        at = np.clip(np.searchsorted(ticks_s, times_s + 1e-9) - 1, 0, ticks_s.size - 1)
        return np.where(times_s <= ticks_s[-1] + 1e-9, whom[at], _NONE).astype(np.intp)
