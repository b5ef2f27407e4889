"""Capture times: conversion from the tracker's clock to the loop's, detection of clock errors, and correction."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from gazempc.live.clock import Clock, Envelope
from gazempc.loop.events import Event
from gazempc.settings import Settings
from gazempc.types import FloatArray

StampClock = Literal["unix", "monotonic", "other", "arrival"]
StampUnit = Literal["s", "ms", "us", "ns"]

PER_SECOND: dict[StampUnit, float] = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


class Stamps(Settings):
    """Clock and unit of a tracker's capture times."""

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
    """Converts stamps of one clock to the loop's clock; thread-safe.

    Args:
        stamps: Clock and unit of the stamps.
        clock: The loop's clock.
    """

    def __init__(self, stamps: Stamps, clock: Clock) -> None:
        self.stamps, self._clock = stamps, clock
        # None for other clocks.
        self._to_loop_s = {"unix": clock.from_unix_s, "monotonic": clock.from_monotonic_s}.get(stamps.clock)
        self._envelope, self._lock = Envelope(), threading.Lock()

    def loop_s(self, stamp: float, arrival_s: float) -> float:
        """Convert a stamp to the loop's clock.

        Args:
            stamp: In the unit of the settings.
            arrival_s: Arrival time on the loop's clock, seconds.

        Returns:
            Time of capture, seconds.
        """
        stamp_s = stamp / PER_SECOND[self.stamps.unit]
        if self._to_loop_s is not None:
            return self._to_loop_s(stamp_s)
        if self.stamps.clock == "arrival":
            return arrival_s - self.stamps.latency_s
        with self._lock:
            self._envelope.add(arrival_s, arrival_s - stamp_s)
            return stamp_s + self._envelope.at(arrival_s) - self.stamps.latency_s

    def now_loop_s(self, stamp: float) -> float:
        """`loop_s` for a stamp that arrives now.

        Args:
            stamp: In the unit of the settings.
        """
        return self.loop_s(stamp, self._clock.now_s())

    def stamp(self, capture_s: float) -> float:
        """The inverse of `loop_s`, for the clocks `unix` and `monotonic`.

        Args:
            capture_s: On the loop's clock, seconds.

        Returns:
            The stamp, in the unit of the settings.
        """
        assert self._to_loop_s is not None
        return (capture_s - self._to_loop_s(0.0)) * PER_SECOND[self.stamps.unit]


@dataclass(frozen=True)
class Frame:
    """One observation as it arrived, whether it is used or not.

    Attributes:
        arrival_s: Arrival time on the loop's clock.
        capture_s: Converted capture time on the loop's clock.
        sensor_m: Head in the sensor's frame, shape (3,), metres.
        base_m: Head in the base frame, shape (3,), metres; None if it could not be transformed.
        person_id: The tracker's name of the person.
    """

    arrival_s: float
    capture_s: float
    sensor_m: FloatArray
    base_m: FloatArray | None
    person_id: str | None


def shown(value: float) -> str:
    """Format a number with three digits, without exponent."""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


class Finding(NamedTuple):
    """A probable error of the set-up.

    Attributes:
        event: Its kind.
        text: The finding, and the setting that corrects it.
    """

    event: Event
    text: str


@dataclass(frozen=True)
class SetupHints:
    """Formats settings for warnings.

    Attributes:
        python: Whether the user writes Python (`gazempc.live.gaze.Gaze`), or a command line.
        own_source: Whether the source is a user-defined one, which provides times of the loop.
        judges_rate: Whether the frame rate is checked here; else by the source.
    """

    python: bool = False
    own_source: bool = False
    judges_rate: bool = True

    def setting(self, group: str, name: str, value: str | float) -> str:
        """A setting of a group, such as ``--mount.unit-m 0.001``."""
        if self.python:
            return f'{group}={{"{name}": {value!r}}}'
        return f"--{group}.{name.replace('_', '-')} {value}"

    def stamps(self, clock: str, unit: str = "s") -> str:
        """The setting for stamps of a clock in a unit.

        Args:
            clock: ``unix``, ``monotonic``, ``other`` or ``arrival``.
            unit: ``s``, ``ms``, ``us`` or ``ns``.
        """
        if self.own_source:
            known = {"unix": "clock.from_unix_s(SECONDS)", "monotonic": "clock.from_monotonic_s(SECONDS)"}
            time_s = known.get(clock, "such as clock.now_s() minus the latency")
            return f"the source must give the loop's time, {time_s}"
        named = "" if clock == "unix" else f'clock="{clock}"' if self.python else self.setting("stamps", "clock", clock)
        in_unit = "" if unit == "s" else "seconds" if self.python else self.setting("stamps", "unit", unit)
        return f"set {' '.join(filter(None, (named, in_unit)))}"


# A clock is identified from frames over at least this time.
_LEAST_S, _CLOCK_FRAMES = 0.3, 3
# The loop refuses observations captured later than this after the present time.
_AHEAD_S = 0.01
# Bounds of the age of a stamp for assignment to a clock: latency, and synchronisation error.
_LATE_S, _EARLY_S = 2.0, 0.2
# Rates within this factor of a unit's are this unit.
_SAME_RATE = 1.5
_STILL_FRAMES = 5
_UNITS: dict[StampUnit, str] = {"s": "", "ms": " in milliseconds", "us": " in microseconds", "ns": " in nanoseconds"}
_CLOCKS = {"unix": "Unix time", "monotonic": "this computer's monotonic clock", "loop": "the loop's time"}


def unusable(frames: Sequence[Frame], stale_after_s: float) -> bool:
    """Whether the loop refuses at least half of the frames for their capture times.

    Args:
        frames: The frames.
        stale_after_s: Maximum age of an observation on arrival, seconds.
    """
    bad = sum(not -_AHEAD_S <= frame.arrival_s - frame.capture_s <= stale_after_s for frame in frames)
    return 2 * bad >= len(frames)


def judge_stamps(
    frames: Sequence[Frame], stale_after_s: float, reader: StampReader | None, clock: Clock, hints: SetupHints
) -> Finding | None:
    """Identify clock and unit of capture times.

    Args:
        frames: The frames of the last second, in order of arrival.
        stale_after_s: Maximum age of an observation on arrival, seconds.
        reader: Reader of the stamps; None if the source provides times of the loop.
        clock: The loop's clock.
        hints: Names of the settings in warnings.

    Returns:
        The error; None if there is none, or with too few frames.
    """
    if len(frames) < _CLOCK_FRAMES or frames[-1].arrival_s - frames[0].arrival_s < _LEAST_S:
        return None
    if reader is not None and reader.stamps.clock in ("other", "arrival"):
        return None
    unit: StampUnit = "s" if reader is None else reader.stamps.unit
    captures_s = [frame.capture_s for frame in frames]
    numbers = np.array(captures_s if reader is None else [reader.stamp(each) for each in captures_s])
    text = _constant_stamps(numbers / PER_SECOND[unit], hints)
    if not text and unusable(frames, stale_after_s):
        text = _likely_clock(numbers, unit, frames, _known_clocks(reader, clock), hints)
    return Finding(Event.WRONG_CLOCK, text) if text else None


def _constant_stamps(stamps_s: FloatArray, hints: SetupHints) -> str:
    distinct = np.unique(stamps_s.round(4))
    if len(stamps_s) < _STILL_FRAMES or 2 * distinct.size > len(stamps_s):
        return ""
    if distinct.size == 1:
        return f"all frames have the same capture time: send each frame's own, or {hints.stamps('arrival')}"
    if np.allclose(distinct, distinct.round(), atol=2e-4, rtol=0):
        return f"capture times are whole seconds: send fractions, too, or {hints.stamps('arrival')}"
    return ""


def _known_clocks(reader: StampReader | None, clock: Clock) -> dict[str, float]:
    """Readings of this computer's clocks at the zero of the loop's, seconds; first the clock of the stamps."""
    known = {"unix": -clock.from_unix_s(0.0), "monotonic": -clock.from_monotonic_s(0.0)} if clock.is_real else {}
    return ({"loop": 0.0} if reader is None else {reader.stamps.clock: known[reader.stamps.clock]}) | known


def _likely_clock(
    numbers: FloatArray, read_unit: StampUnit, frames: Sequence[Frame], clocks: dict[str, float], hints: SetupHints
) -> str:
    arrival_s = frames[-1].arrival_s
    rate = float(numbers[-1] - numbers[0]) / (arrival_s - frames[0].arrival_s)
    unit = next((unit for unit, per_s in PER_SECOND.items() if per_s / _SAME_RATE <= rate <= per_s * _SAME_RATE), None)
    if unit is None:
        return f"capture times advance by {shown(rate)} in a second: {hints.stamps('arrival')}, or send times"
    stamp_s = float(numbers[-1]) / PER_SECOND[unit]
    off_s = {name: stamp_s - (arrival_s + shown_s) for name, shown_s in clocks.items()}
    read_as = next(iter(clocks))
    near = [name for name, off in off_s.items() if -_LATE_S <= off <= _EARLY_S]
    if near and (near[0] != read_as or unit != read_unit):
        return f"capture times look like {_CLOCKS[near[0]]}{_UNITS[unit]}: {hints.stamps(near[0], unit)}"
    age_s = float(np.median([frame.arrival_s - frame.capture_s for frame in frames]))
    if near and age_s > 0:
        slow = hints.setting("loop", "stale_after_s", round(1.5 * age_s, 1))
        return (
            f"frames arrive {age_s:.2f} s after capture by their stamps: if the tracker is so slow set {slow}; if not, "
            f"its clock is behind: {hints.stamps('other', unit)}"
        )
    off = f"{shown(abs(off_s[read_as]))} s {'ahead' if off_s[read_as] > 0 else 'behind'}"
    return (
        f"capture times are of another clock, {off}{_UNITS[unit]}: set the clocks of both computers by NTP, or "
        f"{hints.stamps('other', unit)}"
    )


# Tolerance of synchronised clocks.
_AGREE_S = 0.01
# Upper bound of a tracker's latency. Between the limit of stale observations and this the cause is ambiguous.
_SLOWEST_S = 2.0


class ClockOffset:
    """Monitors the age of frames by their stamps, and corrects implausible capture times.

    Frames from the future, or older than 2 s, have stamps of another clock. So have frames of decreasing age. The last
    plausible age is kept; without one the least age is assumed to be `latency_s`. A slow clock cannot be distinguished
    from a tracker with growing delay, and is not corrected.

    Args:
        latency_s: Least time from capture to arrival, seconds.
        hints: Names of the settings in warnings.

    Attributes:
        age_s: Least age of frames by their stamps, seconds; negative for stamps in the future.
        finding: The correction in use, and the setting for it; None without one.
    """

    def __init__(self, latency_s: float, hints: SetupHints) -> None:
        self.age_s = 0.0
        self.finding: Finding | None = None
        self._hints = hints
        self._envelope = Envelope()
        self._resets = 0
        self._usual_s: float | None = None
        self._plausible_s = latency_s

    def shift_s(self, arrival_s: float, capture_s: float) -> float:
        """Add a frame.

        Args:
            arrival_s: Arrival time, seconds.
            capture_s: Stated capture time on the loop's clock, seconds.

        Returns:
            Correction to add to the capture time, seconds; 0 for a plausible clock.
        """
        envelope = self._envelope
        envelope.add(arrival_s, arrival_s - capture_s)
        self.age_s = envelope.at(arrival_s)
        if envelope.resets != self._resets:
            self._resets, self._usual_s, self.finding = envelope.resets, None, None
        if envelope.steady and self.finding is None:
            self._judge(envelope.recent_s, envelope.slope)
        return 0.0 if self.finding is None else self.age_s - self._plausible_s

    def _judge(self, recent_s: float, slope: float) -> None:
        if not -_AGREE_S <= recent_s <= _SLOWEST_S:
            off_s = self._plausible_s - self.age_s
            self._shift(f"is {shown(abs(off_s))} s {'ahead' if off_s > 0 else 'behind'}")
        elif self._usual_s is None:
            self._usual_s = self._plausible_s = self.age_s
        elif slope < 0.0:
            self._shift(f"runs {-100 * slope:.1f} % fast")

    def _shift(self, how: str) -> None:
        text = (
            f"the tracker's clock {how}: capture times are shifted, so that the soonest frames are "
            f"{max(self._plausible_s, 0.0):.2f} s old; set the clocks of both computers by NTP, or "
            f"{self._hints.stamps('other')}"
        )
        self.finding = Finding(Event.CLOCK_SHIFTED, text)
