"""The clock of a live run: seconds since its start, monotonic."""

from __future__ import annotations

import time
from typing import Protocol

# The last stretch is waited for actively: a sleeping process wakes up late by about this much.
_SPIN_S = 0.0005
# Clocks of one machine drift apart by microseconds; more than this was a step.
_STEP_S = 0.01


class Clock(Protocol):
    """The clock of a loop.

    Attributes:
        is_real: Whether it advances with the computer's monotonic clock. A simulated clock stands still meanwhile.
    """

    is_real: bool

    def now_s(self) -> float:
        """Seconds since the clock was made."""
        ...

    def sleep_until_s(self, time_s: float) -> None:
        """Return at a time on this clock, seconds; at once if it has passed."""
        ...

    def from_unix_s(self, unix_s: float) -> float:
        """Unix time on this clock, seconds; a simulated clock starts at Unix time 0."""
        ...

    def from_monotonic_s(self, monotonic_s: float) -> float:
        """A time of `time.monotonic` on this clock, seconds; a simulated clock starts at 0 of it."""
        ...

    def unix_clock_stepped(self) -> bool:
        """Whether the computer's Unix clock was set since the last call; Unix times are then read by the new one."""
        ...


class RealClock:
    """The computer's monotonic clock, and its offset to Unix time."""

    is_real = True

    def __init__(self) -> None:
        self._start_s = time.monotonic()
        self._unix_start_s = time.time() - (time.monotonic() - self._start_s)

    def now_s(self) -> float:
        """See `Clock.now_s`."""
        return time.monotonic() - self._start_s

    def sleep_until_s(self, time_s: float) -> None:
        """See `Clock.sleep_until_s`."""
        while (left_s := time_s - self.now_s()) > 0:
            if left_s > _SPIN_S:
                time.sleep(left_s - _SPIN_S)

    def from_unix_s(self, unix_s: float) -> float:
        """See `Clock.from_unix_s`."""
        return unix_s - self._unix_start_s

    def from_monotonic_s(self, monotonic_s: float) -> float:
        """See `Clock.from_monotonic_s`."""
        return monotonic_s - self._start_s

    def unix_clock_stepped(self) -> bool:
        """See `Clock.unix_clock_stepped`; true once after each step of more than 10 ms."""
        start_s = time.time() - self.now_s()
        stepped = abs(start_s - self._unix_start_s) > _STEP_S
        if stepped:
            self._unix_start_s = start_s
        return stepped


class SimulatedClock:
    """A clock that jumps to the time that is waited for: a live run at full speed, repeatable."""

    is_real = False

    def __init__(self) -> None:
        self._now_s = 0.0

    def now_s(self) -> float:
        """See `Clock.now_s`."""
        return self._now_s

    def sleep_until_s(self, time_s: float) -> None:
        """See `Clock.sleep_until_s`."""
        self._now_s = max(self._now_s, time_s)

    def from_unix_s(self, unix_s: float) -> float:
        """See `Clock.from_unix_s`."""
        return unix_s

    def from_monotonic_s(self, monotonic_s: float) -> float:
        """See `Clock.from_monotonic_s`."""
        return monotonic_s

    def unix_clock_stepped(self) -> bool:
        """See `Clock.unix_clock_stepped`: never."""
        return False
