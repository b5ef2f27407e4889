"""Input of attention policies, and cues of a program: sounds, thinking, speech, glances."""

from __future__ import annotations

import math
import numbers
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, get_args

from gazempc.people.person import PersonState
from gazempc.settings import LookAwayMode
from gazempc.types import FloatArray

# Score of a person who is excluded.
NOT_AT_ALL = math.nan


@dataclass(frozen=True)
class Sound:
    """Speech with its direction.

    Attributes:
        time_s: Time of detection, seconds.
        azimuth_rad: Direction in the base frame, radians, positive to the left.
    """

    time_s: float
    azimuth_rad: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.time_s) and math.isfinite(self.azimuth_rad)):
            raise ValueError(f"a sound has time_s {self.time_s} and azimuth_rad {self.azimuth_rad}; expected: finite")


@dataclass(frozen=True)
class Company:
    """All people present at one time.

    Attributes:
        time_s: The time, seconds.
        people: Candidates, in order of entry.
        attended: Number of the attended person; None for no person.
        sounds: Speech of the last seconds, oldest first.
    """

    time_s: float
    people: tuple[PersonState, ...]
    attended: int | None = None
    sounds: tuple[Sound, ...] = ()


class AttentionPolicy(Protocol):
    """Scores people; `gazempc.people.attention.Attention` decides on switches."""

    def reset(self) -> None:
        """Discard all state."""
        ...

    def scores(self, company: Company) -> Sequence[float]:
        """Score all people.

        Args:
            company: The people.

        Returns:
            One score per person, in the order of `company.people`: the largest is attended; NaN excludes a person.
        """
        ...


# Length of the queue: more than any program sends between two ticks.
_WAITING_MAX = 256


class Thinking(NamedTuple):
    """Gaze aversion of a thinking person; duration in seconds."""

    lasts_s: float


class Speech(NamedTuple):
    """Time until the start of an utterance, seconds."""

    in_s: float


class Glance(NamedTuple):
    """Glance at a target: base frame, shape (3,), metres; duration without contact, seconds."""

    target_base_m: FloatArray
    lasts_s: float


class Rhythm(NamedTuple):
    """Change of the rhythm of gaze aversion."""

    mode: LookAwayMode


class Choice(NamedTuple):
    """Attend the person with this tracker name while present; None: the policy's choice."""

    person_id: str | None


Cue = Sound | Thinking | Speech | Glance | Rhythm | Choice


# Longest aversion or announcement, seconds: a program that gives milliseconds is refused.
LONGEST_CUE_S = 30.0


def check_cue(cue: Cue) -> None:
    """Check the values of a cue; a `Sound` checks itself.

    Raises:
        ValueError: If a duration is not a number from 0 to `LONGEST_CUE_S`, or a rhythm or a name is invalid.
    """
    if isinstance(cue, Thinking | Glance | Speech):
        name = "in_s" if isinstance(cue, Speech) else "lasts_s"
        value: object = getattr(cue, name)
        if not (isinstance(value, numbers.Real) and 0.0 <= float(value) <= LONGEST_CUE_S):
            raise ValueError(f"{name} is {value!r:.60}; accepted: seconds from 0 to {LONGEST_CUE_S:g}")
    elif isinstance(cue, Rhythm):
        if cue.mode not in get_args(LookAwayMode):
            raise ValueError(f"rhythm is {cue.mode!r:.60}; accepted: {', '.join(get_args(LookAwayMode))}")
    elif isinstance(cue, Choice) and not isinstance(cue.person_id, str | None):
        raise ValueError(f"person_id is {cue.person_id!r:.60}; accepted: a text or None")


class Cues:
    """Thread-safe queue of cues from a program to the loop."""

    def __init__(self) -> None:
        self._waiting: deque[Cue] = deque(maxlen=_WAITING_MAX)

    def put(self, cue: Cue) -> None:
        """Add a cue, from any thread.

        Args:
            cue: The cue.

        Raises:
            ValueError: See `check_cue`.
        """
        check_cue(cue)
        self._waiting.append(cue)

    def take(self) -> list[Cue]:
        """Remove and return all cues."""
        return [self._waiting.popleft() for _ in range(len(self._waiting))]
