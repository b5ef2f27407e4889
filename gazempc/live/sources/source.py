"""The one interface that all sources of observations have."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from gazempc.errors import GazempcError
from gazempc.loop.events import Event
from gazempc.people.company import Cue
from gazempc.types import FloatArray, Sighting

# A tenth of a head's width: nearer is no measurement.
_NEAREST_M = 0.01


class SourceError(GazempcError):
    """A source cannot be opened: names it, and what to check."""


def check_range(position_m: FloatArray) -> None:
    """Refuse a head at the sensor itself, which some trackers send when no person is seen.

    Args:
        position_m: In the sensor's frame, shape (3,), metres.

    Raises:
        ValueError: If it is within 1 cm of the sensor.
    """
    if np.linalg.norm(position_m) < _NEAREST_M:
        raise ValueError(
            f"the head is at the sensor itself ({position_m.tolist()}), which is impossible: a tracker without "
            "a person in view must send nothing"
        )


@dataclass(frozen=True)
class Notice:
    """Something about what comes that the source finds out itself.

    Attributes:
        event: Its kind.
        text: The finding, and the setting that corrects it.
        count: How many observations are not used for it.
    """

    event: Event
    text: str
    count: int = 1


@dataclass(frozen=True)
class Arrived:
    """What has come since a source was last asked.

    Attributes:
        sightings: Observations in the order of arrival, positions and orientations in the sensor's frame; times on the
            loop's clock.
        problems: What came and could not be used, and why, a sentence each.
        notices: What else is to be known, and what was not used for reasons of other names.
        cues: Cues, such as sounds.
    """

    sightings: tuple[Sighting, ...] = ()
    problems: tuple[str, ...] = field(default=())
    notices: tuple[Notice, ...] = ()
    cues: tuple[Cue, ...] = ()


class Source(Protocol):
    """Gives observations as they arrive; never blocks.

    The class attribute ``keeps_any_clock = True`` declares that it uses the loop's time, so that it may run on a
    simulated clock.
    """

    def open(self) -> None:
        """Begin to take observations in.

        Raises:
            SourceError: If it cannot be opened.
        """

    def poll(self) -> Arrived:
        """What has arrived since the last call."""

    @property
    def finished(self) -> bool:
        """True once nothing more will come."""

    def close(self) -> None:
        """Take no more in; never raises, and may be called at any time."""
