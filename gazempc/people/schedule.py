"""When to look away: by published figures, seeded and repeatable, or on request."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from gazempc.neck.spec import NeckSpec
from gazempc.people.aversion import Aversion, GazeShift, angles_to, fitted, shift_of, with_aversion
from gazempc.settings import LookAwayMode
from gazempc.types import FloatArray
from predictors import Forecast


@dataclass(frozen=True)
class AversionRhythm:
    """How people look away; means and standard deviations, seconds.

    Attributes:
        lasts_s: How long a look away lasts.
        every_s: From the beginning of one to that of the next.
        to: Shares of looks to the side, up and down.
    """

    lasts_s: tuple[float, float]
    every_s: tuple[float, float]
    to: tuple[float, float, float]


# Andrist, Mutlu & Gleicher (2013), Andrist, Tan, Gleicher & Mutlu (2014): durations, intervals and directions of
# intimacy-regulating aversions. See docs/people.md for what of it could be checked.
_ASIDE_UP_DOWN = (0.7, 0.1, 0.2)
RHYTHMS: Mapping[LookAwayMode, AversionRhythm] = {
    "speaking": AversionRhythm((1.14, 0.27), (7.21, 1.88), _ASIDE_UP_DOWN),
    "listening": AversionRhythm((1.96, 0.32), (4.75, 1.39), _ASIDE_UP_DOWN),
}
# Thinking people look up more often than aside (the same authors).
_THINKING_TO = (0.1, 0.7, 0.2)
# Before an utterance the floor is held by a look away that starts so early; it ends as the utterance begins.
_BEFORE_SPEECH_S = 1.03
# Beyond the widest cone in which people feel looked at (9 deg), within what all shipped necks can do in time.
_ASIDE_RAD, _UP_RAD, _DOWN_RAD = math.radians(15.0), math.radians(12.0), math.radians(12.0)
# Draws farther from the mean than so many standard deviations are drawn again.
_FARTHEST_SD = 2.0
# Between two looks away there is contact for at least so long.
_CONTACT_S = 0.8
# Plans look ahead by a dead time, a servo's lag and a horizon: what is planned later than this, no controller sees.
_AHEAD_S = 4.0


class LookAways:
    """Plans looks away, and puts them into forecasts.

    Args:
        neck: The neck.
        mode: The rhythm; ``told`` for requests only.
        seed: Seed of times and directions: the same seed and the same times of calls give the same plan.

    Attributes:
        left_out: How many looks away could not be done in time, or clashed with one that had begun.
    """

    def __init__(self, neck: NeckSpec, mode: LookAwayMode = "told", seed: int = 0) -> None:
        self._neck, self._mode = neck, mode
        # Asked for at every plan.
        self._shift: Callable[[float, float], GazeShift] = lru_cache(64)(partial(shift_of, neck))
        self._rng = np.random.default_rng([seed, 22])
        # Earliest effect of a new plan: until then the neck follows commands already sent.
        self._lead_s = float(np.max(neck.dead_time_s[:2] + neck.servo_lag_s[:2]))
        self._planned: list[Aversion] = []
        self._rhythm_from_s: float | None = None
        self.left_out = 0

    def planned(self, now_s: float) -> tuple[Aversion, ...]:
        """Looks away that are planned within the preview of a controller, or under way.

        Args:
            now_s: The time, seconds; not less than the last one.

        Returns:
            The looks away that have not ended, in the order of time.
        """
        self._planned = [each for each in self._planned if each.end_s > now_s - 1.0]
        if self._rhythm_from_s is None:
            # The first one after part of an interval, as if a person came in between.
            self._rhythm_from_s = now_s
        while self._mode in RHYTHMS and self._rhythm_from_s < now_s + _AHEAD_S:
            self._draw_next(now_s, self._rhythm_from_s)
        return tuple(each for each in self._planned if each.end_s > now_s)

    def going_on(self, now_s: float) -> Aversion | None:
        """The look away that is under way; the plan is not changed.

        Args:
            now_s: The time, seconds.

        Returns:
            The look away; None while contact is due.
        """
        return next((each for each in self._planned if each.start_s <= now_s < each.end_s), None)

    def set_mode(self, mode: LookAwayMode, now_s: float) -> None:
        """Go on by another rhythm; what has not begun is planned anew.

        Args:
            mode: The rhythm.
            now_s: The time, seconds.
        """
        self._mode = mode
        self._planned = self._begun(now_s + self._lead_s)
        self._rhythm_from_s = max([now_s, *(each.end_s for each in self._planned)])

    def begin_anew(self, now_s: float) -> None:
        """Plan the rhythm anew for another person, so that a look away does not follow a switch at once.

        Args:
            now_s: The time, seconds.
        """
        self.set_mode(self._mode, now_s)

    def think(self, now_s: float, lasts_s: float, start_s: float | None = None) -> bool:
        """Look away as people do who think.

        Args:
            now_s: The time, seconds.
            lasts_s: For how long, seconds.
            start_s: When it starts; None for as soon as the neck can.

        Returns:
            False if it cannot be done.
        """
        start_s = now_s if start_s is None else start_s
        return self._tell(now_s, Aversion(start_s, start_s + lasts_s, *self._direction(_THINKING_TO), "thinking"))

    def speech_starts(self, now_s: float, at_s: float) -> bool:
        """Hold the floor before an utterance: look away, and back when it starts.

        Args:
            now_s: The time, seconds.
            at_s: Start of the utterance, seconds; the look away starts 1.03 s before, if that is still possible.

        Returns:
            False if it cannot be done.
        """
        return self._tell(now_s, Aversion(at_s - _BEFORE_SPEECH_S, at_s, *self._direction(_ASIDE_UP_DOWN), "speech"))

    def glance(self, now_s: float, target_base_m: FloatArray, person_base_m: FloatArray, lasts_s: float = 1.0) -> bool:
        """Glance at something.

        Args:
            now_s: The time, seconds.
            target_base_m: What to look at, shape (3,), metres.
            person_base_m: Where the person is, shape (3,), metres.
            lasts_s: For how long there is no contact, seconds.

        Returns:
            False if it cannot be done: too far for its time, or too near for a look away.
        """
        angles = angles_to(target_base_m, person_base_m)
        return self._tell(now_s, Aversion(now_s, now_s + lasts_s, *angles, "glance", target_base_m))

    def into(self, forecast: Forecast, now_s: float) -> Forecast:
        """Put what is planned into a forecast of the person.

        Args:
            forecast: The forecast.
            now_s: The time, seconds.

        Returns:
            Where to look at its times.
        """
        self.planned(now_s)
        for each in self._planned:
            forecast = with_aversion(forecast, each, self._shift(each.aside_rad, each.up_rad))
        return forecast

    def _draw_next(self, now_s: float, from_s: float) -> None:
        rhythm = RHYTHMS[self._mode]
        lasts_s = self._drawn(rhythm.lasts_s)
        start_s = from_s + max(self._drawn(rhythm.every_s) - rhythm.lasts_s[0], _CONTACT_S)
        start_s = max(start_s, now_s + self._lead_s)
        aversion = fitted(Aversion(start_s, start_s + lasts_s, *self._direction(rhythm.to), self._mode), self._neck)
        self._rhythm_from_s = start_s + lasts_s
        if aversion is None:
            self.left_out += 1
        else:
            self._planned.append(aversion)

    def _drawn(self, mean_and_sd: tuple[float, float]) -> float:
        while True:
            deviation = float(self._rng.standard_normal())
            if abs(deviation) <= _FARTHEST_SD:
                return mean_and_sd[0] + deviation * mean_and_sd[1]

    def _direction(self, shares: tuple[float, float, float]) -> tuple[float, float]:
        which = int(self._rng.choice(3, p=shares))
        side = float(self._rng.choice((-1.0, 1.0)))
        # People do not look straight up or down.
        return ((side * _ASIDE_RAD, 0.0), (0.5 * side * _UP_RAD, _UP_RAD), (0.5 * side * _DOWN_RAD, -_DOWN_RAD))[which]

    def _tell(self, now_s: float, aversion: Aversion) -> bool:
        shift = self._shift(aversion.aside_rad, aversion.up_rad)
        begun_by_s = now_s + self._lead_s
        earliest_s = begun_by_s + shift.leaves_after_s
        if aversion.start_s < earliest_s:
            moved_s = aversion.end_s if aversion.why == "speech" else aversion.end_s + earliest_s - aversion.start_s
            aversion = replace(aversion, start_s=earliest_s, end_s=moved_s)
        begun = self._begun(begun_by_s)
        possible = fitted(aversion, self._neck)
        clashes = possible is not None and any(
            each.start_s - _CONTACT_S < possible.end_s and possible.start_s < each.end_s + _CONTACT_S for each in begun
        )
        if possible is None or clashes:
            self.left_out += 1
            return False
        self._planned = sorted([*begun, possible], key=lambda each: each.start_s)
        self._rhythm_from_s = max(each.end_s for each in self._planned)
        return True

    def _begins_s(self, aversion: Aversion) -> float:
        shift = self._shift(aversion.aside_rad, aversion.up_rad)
        return aversion.start_s - shift.leaves_after_s

    def _begun(self, by_s: float) -> list[Aversion]:
        """Planned looks away that have begun by then, or were requested."""
        return [each for each in self._planned if self._begins_s(each) <= by_s or each.why not in RHYTHMS]
