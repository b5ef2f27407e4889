"""Input of attention policies, and cues of a program: sounds, thinking, speech, glances."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from gazempc.people.person import PersonState
from gazempc.settings import LookAwayMode
from gazempc.types import FloatArray

# Score of a person who is excluded.
NOT_AT_ALL = math.nan


@dataclass(frozen=True)
class Sound:
    """Speech, and where it came from.

    Attributes:
        time_s: When it was heard, seconds.
        azimuth_rad: Its direction in the base frame, radians, positive to the left.
    """

    time_s: float
    azimuth_rad: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.time_s) and math.isfinite(self.azimuth_rad)):
            raise ValueError(f"a sound has time_s {self.time_s} and azimuth_rad {self.azimuth_rad}: needed are numbers")


@dataclass(frozen=True)
class Company:
    """All people who are there at one time.

    Attributes:
        time_s: The time, seconds.
        people: Candidates, in the order in which they entered.
        attended: Number of the person who is looked at; None for no person.
        sounds: Speech of the last seconds, oldest first.
    """

    time_s: float
    people: tuple[PersonState, ...]
    attended: int | None = None
    sounds: tuple[Sound, ...] = ()


class AttentionPolicy(Protocol):
    """Scores people; `gazempc.people.attention.Attention` decides on switches."""

    def reset(self) -> None:
        """Forget all people."""
        ...

    def scores(self, company: Company) -> Sequence[float]:
        """Score all people.

        Args:
            company: The people.

        Returns:
            One number a person, in the order of `company.people`: the largest is looked at; NaN for not at all.
        """
        ...


# More than any program sends between two ticks.
_WAITING_MAX = 256


@dataclass(frozen=True)
class Thinking:
    """A look away as while thinking; duration in seconds."""

    lasts_s: float


@dataclass(frozen=True)
class Speech:
    """An utterance starts so much later than now: seconds."""

    in_s: float


@dataclass(frozen=True)
class Glance:
    """Glance at something: base frame, shape (3,), metres; without contact for so long, seconds."""

    target_base_m: FloatArray
    lasts_s: float


@dataclass(frozen=True)
class Rhythm:
    """Look away by this rhythm from now on."""

    mode: LookAwayMode


@dataclass(frozen=True)
class Choice:
    """Look at the person with this name of the tracker, as long as they are there; None: whom the policy prefers."""

    person_id: str | None


Cue = Sound | Thinking | Speech | Glance | Rhythm | Choice


class Cues:
    """Hands cues from the thread of a program to the loop."""

    def __init__(self) -> None:
        self._waiting: deque[Cue] = deque(maxlen=_WAITING_MAX)

    def put(self, cue: Cue) -> None:
        """Hand one over, from any thread.

        Args:
            cue: The cue.
        """
        self._waiting.append(cue)

    def take(self) -> list[Cue]:
        """All cues since the last call."""
        return [self._waiting.popleft() for _ in range(len(self._waiting))]
