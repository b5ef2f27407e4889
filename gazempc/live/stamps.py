"""How the capture times that a tracker states become times of the loop."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from gazempc.live.clock import RealClock
from gazempc.live.envelope import Envelope

StampClock = Literal["unix", "monotonic", "other", "arrival"]
StampUnit = Literal["s", "ms", "us", "ns"]

PER_SECOND: dict[StampUnit, float] = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


class Stamps(BaseModel):
    """What a tracker's capture times are."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    clock: StampClock = Field(
        default="unix",
        description="Clock of the capture times: unix, monotonic (of this computer), other (any clock that runs "
        "steadily), arrival (capture times are ignored)",
    )
    unit: StampUnit = Field(default="s", description="Unit of the capture times")
    latency_s: float = Field(
        default=0.05,
        ge=0,
        le=2,
        description="Shortest latency: for the clocks other and arrival, and for a clock that is ahead",
    )


class StampReader:
    """Puts stamps on the loop's clock. One thread uses it.

    Args:
        stamps: What the stamps are.
        clock: The loop's clock.
    """

    def __init__(self, stamps: Stamps, clock: RealClock) -> None:
        self.stamps = stamps
        self._clock = clock
        self._envelope = Envelope()

    def loop_s(self, stamp: float, arrival_s: float) -> float:
        """A stamp on the loop's clock.

        Args:
            stamp: In the unit of the settings.
            arrival_s: When it came, on the loop's clock.

        Returns:
            Time of capture, seconds.
        """
        stamp_s = stamp / PER_SECOND[self.stamps.unit]
        clock = self.stamps.clock
        if clock == "unix":
            return self._clock.from_unix_s(stamp_s)
        if clock == "monotonic":
            return self._clock.from_monotonic_s(stamp_s)
        if clock == "arrival":
            return arrival_s - self.stamps.latency_s
        self._envelope.add(arrival_s, arrival_s - stamp_s)
        return stamp_s + self._envelope.at(arrival_s) - self.stamps.latency_s

    def now_loop_s(self, stamp: float) -> float:
        """A stamp that came just now on the loop's clock, as `loop_s`.

        Args:
            stamp: In the unit of the settings.
        """
        return self.loop_s(stamp, self._clock.now_s())

    def stamp(self, capture_s: float) -> float:
        """The stamp that a time of capture was read from, where the clock is `unix` or `monotonic`.

        Args:
            capture_s: On the loop's clock, seconds.

        Returns:
            The stamp, in the unit of the settings.
        """
        to_loop = self._clock.from_unix_s if self.stamps.clock == "unix" else self._clock.from_monotonic_s
        return (capture_s - to_loop(0.0)) * PER_SECOND[self.stamps.unit]
