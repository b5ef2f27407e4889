"""Attention: choice of one of several people, with dwell time and hysteresis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gazempc.people.company import AttentionPolicy, Company, Sound
from gazempc.people.person import PersonState
from gazempc.settings import AttentionSettings


@dataclass(frozen=True)
class AttentionState:
    """The attended person. Times are on the loop's clock, seconds.

    Attributes:
        person: Number of the person, in the order in which they entered; None for no person, or where people are
            not distinguished.
        person_id: The tracker's name; None where it gives none.
        why: ``policy``, ``left`` or ``nobody``, as in `gazempc.people.attention.Attended`; ``one`` where people are
            not distinguished; ``ended`` at the end of a run.
        since_s: Since when they are looked at; None before the first decision.
        stays_until_s: Earliest time of a switch; None without a person.
        away_why: Why it looks away just now, as in `gazempc.people.aversion.Aversion`; None while it does not.
        away_since_s: Since when there is no contact.
        away_until_s: When contact is due again.
    """

    person: int | None = None
    person_id: str | None = None
    why: str = "nobody"
    since_s: float | None = None
    stays_until_s: float | None = None
    away_why: str | None = None
    away_since_s: float | None = None
    away_until_s: float | None = None


# Sounds are kept for so long.
_SOUNDS_S = 2.0


@dataclass(frozen=True)
class Attended:
    """The attended person.

    Attributes:
        number: Number of the person; None for no person.
        since_s: Since when, seconds.
        why: ``policy`` for the policy's choice; ``left`` where the person before had left; ``nobody`` for no person.
    """

    number: int | None = None
    since_s: float = -math.inf
    why: str = "nobody"


class Attention:
    """Chooses the person at whom the robot looks.

    The robot switches to another person under two conditions. This person has been the better choice for `hysteresis_s`
    without a break, and the robot has looked at the present person for `dwell_s`. If the present person has gone, the
    robot switches at once.

    Args:
        policy: Scores the people.
        settings: Times and distances.

    Attributes:
        policy: Scores the people.
        attended: The person at whom the robot looks now.
        candidate: Number of the person who is the better choice now; None if there is none.
        chosen_id: The tracker's name of a person who outranks all others while present; None for no such person.
    """

    def __init__(self, policy: AttentionPolicy, settings: AttentionSettings) -> None:
        self.policy = policy
        self._settings = settings
        self.policy.reset()
        self.attended = Attended()
        self.candidate: int | None = None
        self.chosen_id: str | None = None
        self._candidate_since_s = math.inf
        self._inside: set[int] = set()
        self._sounds: list[Sound] = []

    @property
    def dwell_s(self) -> float:
        """Dwell time: least time at one person who does not leave, seconds."""
        return self._settings.dwell_s

    def hear(self, sound: Sound) -> None:
        """Take in speech.

        Args:
            sound: When, and from where.
        """
        self._sounds.append(sound)

    def update(self, people: Sequence[PersonState], time_s: float) -> Attended:
        """Decide.

        Args:
            people: All people who are there.
            time_s: The time, seconds; not less than the last one.

        Returns:
            The attended person from now on.

        Raises:
            Exception: Any exception of the policy; the attended person stays the same.
        """
        self._sounds = [sound for sound in self._sounds if time_s - sound.time_s <= _SOUNDS_S]
        near = self._within_limits(people)
        gone = self.attended.number is not None and all(p.number != self.attended.number for p in people)
        if gone:
            # Before the policy is asked: it may raise, and a person who is gone must not stay attended.
            self._look_at(None, time_s, "left")
        if self.chosen_id is not None:
            chosen = next((person.number for person in people if person.tracker_id == self.chosen_id), None)
            if chosen is not None:
                if chosen != self.attended.number:
                    self._look_at(chosen, time_s, "policy")
                return self.attended
        company = Company(time_s, near, self.attended.number, tuple(self._sounds))
        best = self._best(company)
        if best == self.attended.number:
            self._consider(None, time_s)
        elif self.attended.number is None and best is not None:
            self._look_at(best, time_s, "left" if gone else "policy")
        else:
            # Another person, or none.
            if best != self.candidate or math.isinf(self._candidate_since_s):
                self._consider(best, time_s)
            better_s, looked_s = time_s - self._candidate_since_s, time_s - self.attended.since_s
            if better_s >= self._settings.hysteresis_s and looked_s >= self._settings.dwell_s:
                self._look_at(best, time_s, "policy" if best is not None else "nobody")
        return self.attended

    def _best(self, company: Company) -> int | None:
        scores = [float(score) for score in self.policy.scores(company)] if company.people else []
        if len(scores) != len(company.people):
            raise ValueError(f"scores() returned {len(scores)} numbers for {len(company.people)} people")
        judged = [(score, p.number) for score, p in zip(scores, company.people, strict=True) if not math.isnan(score)]
        most = max((score for score, _ in judged), default=math.nan)
        best = [number for score, number in judged if score == most]
        # A draw keeps the attended person.
        return company.attended if company.attended in best else min(best, default=None)

    def _within_limits(self, people: Sequence[PersonState]) -> tuple[PersonState, ...]:
        """People inside the limits of distance, with hysteresis; the nearest ones, up to the largest number."""
        enter_m = math.inf if self._settings.enter_m is None else self._settings.enter_m
        leave_m = enter_m if self._settings.leave_m is None else self._settings.leave_m
        self._inside = {
            person.number
            for person in people
            if person.distance_m <= (leave_m if person.number in self._inside else enter_m)
        }
        inside = [person for person in people if person.number in self._inside]
        nearest = sorted(inside, key=lambda person: person.distance_m)[: self._settings.most_people]
        return tuple(person for person in inside if person in nearest)

    def _consider(self, number: int | None, time_s: float) -> None:
        self.candidate, self._candidate_since_s = number, time_s

    def _look_at(self, number: int | None, time_s: float, why: str) -> None:
        self.attended = Attended(number, time_s, why)
        self.candidate, self._candidate_since_s = None, math.inf
