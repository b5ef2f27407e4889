"""The shipped attention policies."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from gazempc.neck.kinematics import wrapped_rad
from gazempc.part_options import make, options_for
from gazempc.parts import BY_NAME, POLICY, check_members
from gazempc.people.company import NOT_AT_ALL, AttentionPolicy, Company
from gazempc.people.engagement import Engagement
from gazempc.people.person import PersonState

# Score of first choices: larger than the scores of all others, which are distances.
_FIRST = 1e3
# Minimum closing speed of an approach: slower motion is postural sway.
_APPROACHES_M_S = 0.3
# Gate of sound direction (error about 10 deg), and longest pause of a speaker.
_SPEAKER_WITHIN_RAD, _PAUSE_S = math.radians(20.0), 2.0


class Nearest:
    """The nearest person."""

    def reset(self) -> None:
        """See `AttentionPolicy.reset`."""

    def scores(self, company: Company) -> list[float]:
        """See `AttentionPolicy.scores`."""
        return [-person.distance_m for person in company.people]


class Approaching:
    """The person who approaches fastest; if none does, the nearest."""

    def reset(self) -> None:
        """See `AttentionPolicy.reset`."""

    def scores(self, company: Company) -> list[float]:
        """See `AttentionPolicy.scores`."""
        return [
            _FIRST + speed if (speed := closing_m_s(person)) >= _APPROACHES_M_S else -person.distance_m
            for person in company.people
        ]


class Engaged:
    """The nearest person engaged with the robot; if there is none, the nearest person."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """See `AttentionPolicy.reset`."""
        self._engagement = Engagement()

    def scores(self, company: Company) -> list[float]:
        """See `AttentionPolicy.scores`."""
        engaged = self._engagement.update(company)
        return [(_FIRST if engaged[p.number] else 0.0) - p.distance_m for p in company.people]


class Speaker:
    """The last speaker, by the direction of the sound; before any speech, the nearest person."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """See `AttentionPolicy.reset`."""
        self._spoke_s: dict[int, float] = {}
        self._heard_s = -math.inf

    def scores(self, company: Company) -> list[float]:
        """See `AttentionPolicy.scores`."""
        for sound in company.sounds:
            if sound.time_s <= self._heard_s or company.time_s - sound.time_s > _PAUSE_S:
                continue
            self._heard_s = sound.time_s
            xy_m = np.array([person.position_base_m[:2] for person in company.people]).reshape(-1, 2)
            off_rad = np.abs(wrapped_rad(np.arctan2(xy_m[:, 1], xy_m[:, 0]) - sound.azimuth_rad))
            if off_rad.min(initial=np.inf) <= _SPEAKER_WITHIN_RAD:
                self._spoke_s[company.people[int(off_rad.argmin())].number] = sound.time_s
        return [
            _FIRST - (company.time_s - self._spoke_s[person.number])
            if company.time_s - self._spoke_s.get(person.number, -math.inf) < _FIRST
            else -person.distance_m
            for person in company.people
        ]


class Named:
    """The person with a given tracker name only.

    Args:
        name: The name.
    """

    def __init__(self, name: str) -> None:
        self._name = name

    def reset(self) -> None:
        """See `AttentionPolicy.reset`."""

    def scores(self, company: Company) -> list[float]:
        """See `AttentionPolicy.scores`."""
        return [0.0 if person.tracker_id == self._name else NOT_AT_ALL for person in company.people]


def closing_m_s(person: PersonState) -> float:
    """Horizontal closing speed of a person, m/s."""
    distance_m = max(person.distance_m, 1e-6)
    return -float(person.position_base_m[:2] @ person.velocity_base_m_s[:2]) / distance_m


def make_policy(choice: str | AttentionPolicy, options: dict[str, Any]) -> AttentionPolicy:
    """Construct a policy.

    Args:
        choice: A shipped name, ``id:NAME``, ``module:Class``, or a policy.
        options: Parameters of a user-defined policy.

    Returns:
        The policy.

    Raises:
        SettingsError: If construction fails, or a method is missing.
    """
    if not isinstance(choice, str):
        check_members(POLICY, choice)
        return choice
    if choice.startswith(BY_NAME):
        return Named(choice.removeprefix(BY_NAME))
    policy: AttentionPolicy = make(POLICY, choice, {}, options_for(POLICY, choice, options))
    return policy
