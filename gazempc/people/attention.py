"""Attention: selection of one of several people, with dwell time and hysteresis."""

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
        person: Number of the person, in order of entry; None for no person, or if people are not distinguished.
        person_id: The tracker's name; None if there is none.
        why: ``policy``, ``left`` or ``no_person``, as in `gazempc.people.attention.Attended`; ``one`` if people are not
            distinguished; ``ended`` at the end of a run.
        since_s: Start of attention to the person; None before the first decision.
        stays_until_s: Earliest time of a switch; None for no person.
        away_why: Reason of the present gaze aversion, as in `gazempc.people.aversion.Aversion`; None for no aversion.
        away_since_s: End of contact.
        away_until_s: Time of renewed contact.
    """

    person: int | None = None
    person_id: str | None = None
    why: str = "no_person"
    since_s: float | None = None
    stays_until_s: float | None = None
    away_why: str | None = None
    away_since_s: float | None = None
    away_until_s: float | None = None


# Memory of sounds.
_SOUNDS_S = 2.0


@dataclass(frozen=True)
class Attended:
    """The attended person.

    Attributes:
        number: Number of the person; None for no person.
        since_s: Start of attention, seconds.
        why: ``policy`` for the policy's choice; ``left`` if the previous person had left; ``no_person`` for no person.
    """

    number: int | None = None
    since_s: float = -math.inf
    why: str = "no_person"


class Attention:
    """Selects the attended person.

    A switch has two conditions: the other person has had the higher score for `hysteresis_s` without a break, and the
    attended person has been attended for `dwell_s`. The departure of the attended person causes an immediate switch.

    Args:
        policy: Scoring of the people.
        settings: Times and distances.

    Attributes:
        policy: Scoring of the people.
        settings: Times and distances.
        attended: The attended person.
        candidate: Number of the person with a higher score than the attended one; None if there is none.
        chosen_id: The tracker's name of a person with precedence over all others while present; None for none.
    """

    def __init__(self, policy: AttentionPolicy, settings: AttentionSettings) -> None:
        self.policy = policy
        self.settings = settings
        self.policy.reset()
        self.attended = Attended()
        self.candidate: int | None = None
        self.chosen_id: str | None = None
        self._candidate_since_s = math.inf
        self._inside: set[int] = set()
        self._sounds: list[Sound] = []

    def hear(self, sound: Sound) -> None:
        """Process speech.

        Args:
            sound: Time and direction.
        """
        self._sounds.append(sound)

    def update(self, people: Sequence[PersonState], time_s: float) -> Attended:
        """Update the attended person.

        Args:
            people: All people present.
            time_s: The time, seconds; not decreasing.

        Returns:
            The attended person.

        Raises:
            Exception: Any exception of the policy; the attended person is unchanged.
        """
        self._sounds = [sound for sound in self._sounds if time_s - sound.time_s <= _SOUNDS_S]
        near = self._within_limits(people)
        gone = self.attended.number is not None and all(p.number != self.attended.number for p in people)
        if gone:
            # Before the call of the policy, which may raise: a departed person must not stay attended.
            self._attend(None, time_s, "left")
        named = (person for person in people if self.chosen_id is not None)
        chosen = next((person.number for person in named if person.tracker_id == self.chosen_id), None)
        if chosen is not None:
            if chosen != self.attended.number:
                self._attend(chosen, time_s, "policy")
            return self.attended
        company = Company(time_s, near, self.attended.number, tuple(self._sounds))
        best = self._best(company)
        if best == self.attended.number:
            self._consider(None, time_s)
        elif self.attended.number is None and best is not None:
            self._attend(best, time_s, "left" if gone else "policy")
        else:
            # A new candidate, or none.
            if best != self.candidate or math.isinf(self._candidate_since_s):
                self._consider(best, time_s)
            better_s, looked_s = time_s - self._candidate_since_s, time_s - self.attended.since_s
            if better_s >= self.settings.hysteresis_s and looked_s >= self.settings.dwell_s:
                self._attend(best, time_s, "policy" if best is not None else "no_person")
        return self.attended

    def _best(self, company: Company) -> int | None:
        scores = [float(score) for score in self.policy.scores(company)] if company.people else []
        if len(scores) != len(company.people):
            raise ValueError(f"scores() returned {len(scores)} numbers for {len(company.people)} people")
        # Of equal scores that of the attended person, then of the one who entered first.
        each = zip(scores, company.people, strict=True)
        ranked = [(score, p.number == company.attended, -p.number) for score, p in each if not math.isnan(score)]
        return -max(ranked)[2] if ranked else None

    def _within_limits(self, people: Sequence[PersonState]) -> tuple[PersonState, ...]:
        """People inside the distance limits, with hysteresis; the nearest ones, up to the maximum number."""
        enter_m = math.inf if self.settings.enter_m is None else self.settings.enter_m
        leave_m = enter_m if self.settings.leave_m is None else self.settings.leave_m
        inside = [p for p in people if p.distance_m <= (leave_m if p.number in self._inside else enter_m)]
        self._inside = {person.number for person in inside}
        nearest = sorted(inside, key=lambda person: person.distance_m)[: self.settings.most_people]
        return tuple(person for person in inside if person in nearest)

    def _consider(self, number: int | None, time_s: float) -> None:
        self.candidate, self._candidate_since_s = number, time_s

    def _attend(self, number: int | None, time_s: float, why: str) -> None:
        self.attended = Attended(number, time_s, why)
        self.candidate, self._candidate_since_s = None, math.inf
