"""The interface of all sources of observations."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from gazempc.errors import GazempcError
from gazempc.loop.events import Event
from gazempc.people.company import Cue
from gazempc.types import FloatArray, Sighting

# Minimum range of a measurement: a tenth of a head's width.
_NEAREST_M = 0.01


class SourceError(GazempcError):
    """A source cannot be opened; the message names it, and what to check."""


def check_range(position_m: FloatArray) -> None:
    """Refuse a head at the sensor itself, which some trackers send without a person in view.

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
    """A finding of the source about its input.

    Attributes:
        event: Its kind.
        text: The finding, and the setting that corrects it.
        count: Number of observations refused for this reason.
    """

    event: Event
    text: str
    count: int = 1


@dataclass(frozen=True)
class Arrived:
    """Input of a source since the previous poll.

    Attributes:
        sightings: Observations in order of arrival, positions and orientations in the sensor's frame; times on the
            loop's clock.
        problems: Invalid input with the reason, a sentence each.
        notices: Findings, and observations refused for other reasons.
        cues: Cues, such as sounds.
    """

    sightings: tuple[Sighting, ...] = ()
    problems: tuple[str, ...] = field(default=())
    notices: tuple[Notice, ...] = ()
    cues: tuple[Cue, ...] = ()


class Source(Protocol):
    """Provides observations as they arrive; non-blocking.

    The class attribute ``keeps_any_clock = True`` declares that it uses the loop's time, so that it may run on a
    simulated clock.
    """

    def open(self) -> None:
        """Start reception.

        Raises:
            SourceError: If it cannot be opened.
        """

    def poll(self) -> Arrived:
        """Input since the last call."""

    @property
    def finished(self) -> bool:
        """Whether the source has ended."""

    def close(self) -> None:
        """End reception; never raises, and may be called at any time."""
