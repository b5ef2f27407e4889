"""Schedule of gaze aversion: random by published statistics, with a seed, or on request."""

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
    """Statistics of gaze aversion; means and standard deviations, seconds.

    Attributes:
        lasts_s: Duration.
        every_s: Interval between the starts of two aversions.
    """

    lasts_s: tuple[float, float]
    every_s: tuple[float, float]


# Andrist, Mutlu & Gleicher (2013), Andrist, Tan, Gleicher & Mutlu (2014): durations, intervals and directions (shares
# of side, up and down) of intimacy-regulating aversions. See docs/people.md for the checked part.
_ASIDE_UP_DOWN = (0.7, 0.1, 0.2)
RHYTHMS: Mapping[LookAwayMode, AversionRhythm] = {
    "speaking": AversionRhythm((1.14, 0.27), (7.21, 1.88)),
    "listening": AversionRhythm((1.96, 0.32), (4.75, 1.39)),
}
# Thinking people look up more often than aside (the same authors).
_THINKING_TO = (0.1, 0.7, 0.2)
# Start of the aversion that holds the floor before an utterance; it ends as the utterance begins.
_BEFORE_SPEECH_S = 1.03
# Angles outside the widest cone of perceived gaze contact (9 deg), and feasible for all shipped necks.
_ASIDE_RAD, _UP_RAD, _DOWN_RAD = math.radians(15.0), math.radians(12.0), math.radians(12.0)
# Truncation of the normal distributions, standard deviations.
_FARTHEST_SD = 2.0
# Minimum contact between two aversions.
_CONTACT_S = 0.8
# Preview: longer than dead time, servo lag and horizon of any controller.
_AHEAD_S = 4.0


class LookAways:
    """Schedules gaze aversions, and inserts them into forecasts.

    Args:
        neck: The neck.
        mode: The rhythm; ``told`` for requests only.
        seed: Seed of times and directions: the schedule is a function of the seed and the times of calls.

    Attributes:
        mode: The rhythm.
        left_out: Number of aversions that were infeasible, or in conflict with one that had begun.
    """

    def __init__(self, neck: NeckSpec, mode: LookAwayMode = "told", seed: int = 0) -> None:
        self._neck, self.mode = neck, mode
        # Cached: used at every plan.
        self._shift: Callable[[float, float], GazeShift] = lru_cache(64)(partial(shift_of, neck))
        self._rng = np.random.default_rng([seed, 22])
        # Earliest effect of a new plan: until then commands already sent determine the motion.
        self._lead_s = float(np.max(neck.dead_time_s[:2] + neck.servo_lag_s[:2]))
        self._planned: list[Aversion] = []
        self._rhythm_from_s: float | None = None
        self.left_out = 0

    def planned(self, now_s: float) -> tuple[Aversion, ...]:
        """Aversions in progress, or within the preview of a controller.

        Args:
            now_s: The time, seconds; not decreasing.

        Returns:
            The aversions that have not ended, in temporal order.
        """
        self._planned = [each for each in self._planned if each.end_s > now_s - 1.0]
        if self._rhythm_from_s is None:
            # Random phase: the first aversion after a part of an interval.
            self._rhythm_from_s = now_s
        while self.mode in RHYTHMS and self._rhythm_from_s < now_s + _AHEAD_S:
            self._draw_next(now_s, self._rhythm_from_s)
        return tuple(each for each in self._planned if each.end_s > now_s)

    def going_on(self, now_s: float) -> Aversion | None:
        """The aversion in progress; without side effect on the schedule.

        Args:
            now_s: The time, seconds.

        Returns:
            The aversion; None during contact.
        """
        return next((each for each in self._planned if each.start_s <= now_s < each.end_s), None)

    def set_mode(self, mode: LookAwayMode, now_s: float) -> None:
        """Change the rhythm; aversions that have not begun are rescheduled.

        Args:
            mode: The rhythm.
            now_s: The time, seconds.
        """
        self.mode = mode
        self._planned = self._begun(now_s + self._lead_s)
        self._rhythm_from_s = max([now_s, *(each.end_s for each in self._planned)])

    def think(self, now_s: float, lasts_s: float, start_s: float | None = None) -> bool:
        """Request the aversion of a thinking person.

        Args:
            now_s: The time, seconds.
            lasts_s: Duration, seconds.
            start_s: Start time; None for the earliest feasible one.

        Returns:
            False if it is infeasible.
        """
        start_s = now_s if start_s is None else start_s
        return self._request(now_s, Aversion(start_s, start_s + lasts_s, *self._direction(_THINKING_TO), "thinking"))

    def speech_starts(self, now_s: float, at_s: float) -> bool:
        """Hold the floor before an utterance, by an aversion that ends when it starts.

        Args:
            now_s: The time, seconds.
            at_s: Start of the utterance, seconds; the aversion starts 1.03 s before, if that is feasible.

        Returns:
            False if it is infeasible.
        """
        return self._request(now_s, Aversion(at_s - _BEFORE_SPEECH_S, at_s, *self._direction(_ASIDE_UP_DOWN), "speech"))

    def glance(self, now_s: float, target_base_m: FloatArray, person_base_m: FloatArray, lasts_s: float = 1.0) -> bool:
        """Glance at a target.

        Args:
            now_s: The time, seconds.
            target_base_m: Position of the target, shape (3,), metres.
            person_base_m: Position of the person, shape (3,), metres.
            lasts_s: Duration without contact, seconds.

        Returns:
            False if it is infeasible: the angle is too large for the duration, or too small for an aversion.
        """
        angles = angles_to(target_base_m, person_base_m)
        return self._request(now_s, Aversion(now_s, now_s + lasts_s, *angles, "glance", target_base_m))

    def into(self, forecast: Forecast, now_s: float) -> Forecast:
        """Insert the schedule into a forecast of the person.

        Args:
            forecast: The forecast.
            now_s: The time, seconds.

        Returns:
            Forecast of the gaze target, at the same times.
        """
        self.planned(now_s)
        for each in self._planned:
            forecast = with_aversion(forecast, each, self._shift(each.aside_rad, each.up_rad))
        return forecast

    def _draw_next(self, now_s: float, from_s: float) -> None:
        rhythm = RHYTHMS[self.mode]
        lasts_s = self._drawn(rhythm.lasts_s)
        start_s = from_s + max(self._drawn(rhythm.every_s) - rhythm.lasts_s[0], _CONTACT_S)
        start_s = max(start_s, now_s + self._lead_s)
        self._rhythm_from_s = end_s = start_s + lasts_s
        aversion = fitted(Aversion(start_s, end_s, *self._direction(_ASIDE_UP_DOWN), self.mode), self._neck)
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
        # Oblique: people do not look straight up or down.
        return ((side * _ASIDE_RAD, 0.0), (0.5 * side * _UP_RAD, _UP_RAD), (0.5 * side * _DOWN_RAD, -_DOWN_RAD))[which]

    def _request(self, now_s: float, aversion: Aversion) -> bool:
        shift = self._shift(aversion.aside_rad, aversion.up_rad)
        begun_by_s = now_s + self._lead_s
        earliest_s = begun_by_s + shift.leaves_after_s
        if aversion.start_s < earliest_s:
            moved_s = aversion.end_s if aversion.why == "speech" else aversion.end_s + earliest_s - aversion.start_s
            aversion = replace(aversion, start_s=earliest_s, end_s=moved_s)
        begun = self._begun(begun_by_s)
        possible = fitted(aversion, self._neck)
        if possible is None or any(
            each.start_s - _CONTACT_S < possible.end_s and possible.start_s < each.end_s + _CONTACT_S for each in begun
        ):
            self.left_out += 1
            return False
        self._planned = sorted([*begun, possible], key=lambda each: each.start_s)
        self._rhythm_from_s = max(each.end_s for each in self._planned)
        return True

    def _begun(self, by_s: float) -> list[Aversion]:
        """Scheduled aversions that have begun by a time, or were requested."""
        return [
            each
            for each in self._planned
            if each.why not in RHYTHMS or each.start_s - self._shift(each.aside_rad, each.up_rad).leaves_after_s <= by_s
        ]
