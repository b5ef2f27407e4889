"""What a program tells the gaze besides where people are: sounds, thinking, speech, glances."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from gazempc.people.company import Sound
from gazempc.settings import LookAwayMode
from gazempc.types import FloatArray

# Nobody tells so much between two ticks.
_WAITING_MAX = 256


@dataclass(frozen=True)
class Thinking:
    """Look away as somebody who thinks, for so long: seconds."""

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


Cue = Sound | Thinking | Speech | Glance | Rhythm


class Cues:
    """Hands cues from the thread of a program to the loop."""

    def __init__(self) -> None:
        self._waiting: deque[Cue] = deque(maxlen=_WAITING_MAX)

    def tell(self, cue: Cue) -> None:
        """Hand one over, from any thread.

        Args:
            cue: The cue.
        """
        self._waiting.append(cue)

    def take(self) -> list[Cue]:
        """All that were told since the last call."""
        return [self._waiting.popleft() for _ in range(len(self._waiting))]
