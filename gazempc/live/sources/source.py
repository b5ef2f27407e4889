"""The one interface that all sources of observations have."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

from gazempc.errors import GazempcError
from gazempc.types import Sighting


class SourceError(GazempcError):
    """A source cannot be opened: names it, and what to check."""


@dataclass(frozen=True)
class Arrived:
    """What has come since a source was last asked.

    Attributes:
        sightings: Observations in the order of arrival, positions and orientations in the sensor's frame; times on the
            loop's clock.
        problems: What came and could not be used, and why, a sentence each.
    """

    sightings: tuple[Sighting, ...] = ()
    problems: tuple[str, ...] = field(default=())


class Source(Protocol):
    """Gives observations as they arrive; never blocks.

    The class attribute ``keeps_any_clock = True`` says that it lives in the loop's time, so that it may run on a
    simulated clock.
    """

    def open(self) -> None:
        """Begin to take observations in.

        Raises:
            SourceError: If it cannot be opened.
        """
        ...

    def poll(self) -> Arrived:
        """What has arrived since the last call."""
        ...

    @property
    def finished(self) -> bool:
        """True once nothing more will come."""
        ...

    def close(self) -> None:
        """Take no more in; never raises, and may be called at any time."""
        ...
