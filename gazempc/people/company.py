"""What may be known when it is decided whom to look at."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from gazempc.people.person import PersonState

# A score for somebody who is not to be looked at.
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
    """Everybody who is there at one time.

    Attributes:
        time_s: The time, seconds.
        people: Who may be looked at, in the order in which they entered.
        attended: Number of the person who is looked at; None for nobody.
        sounds: Speech of the last seconds, oldest first.
    """

    time_s: float
    people: tuple[PersonState, ...]
    attended: int | None = None
    sounds: tuple[Sound, ...] = ()


class AttentionPolicy(Protocol):
    """Says who is worth looking at. How long and how often to switch is not its business."""

    def reset(self) -> None:
        """Forget everybody."""
        ...

    def scores(self, company: Company) -> Sequence[float]:
        """Judge everybody.

        Args:
            company: Who is there.

        Returns:
            One number a person, in the order of `company.people`: the largest is looked at; NaN for not at all.
        """
        ...
