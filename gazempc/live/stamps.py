"""Capture times: from the tracker's clock to that of the loop; identification and correction of wrong clocks."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from gazempc.live.clock import Clock
from gazempc.live.hints import Finding, Frame, SetupHints, shown
from gazempc.loop.events import Event
from gazempc.types import FloatArray

# Some frame of each second comes with little delay; so many seconds are remembered.
_PIECE_S, _PIECES = 1.0, 10
# A fifth comes sooner than what counts as soonest: single frames have wrong stamps.
_SOONEST_SHARE = 5
# Delays are steady where those of half a second lie within this. Stamps in another unit run away by more.
_RECENT_S, _RECENT_LEAST_S, _RECENT_FRAMES, _STEADY_WITHIN_S = 0.5, 0.4, 5, 0.2
_RECENT_MAX = 1000
# Crystals differ by 0.1 ms a second, and NTP corrects by 0.5. Less than this is no drift; nor is what noise may be.
_DRIFT_LEAST, _DRIFT_PIECES, _DRIFT_ERRORS, _SOONEST_ERROR_S = 0.002, 4, 5.0, 0.001
# The other clock was set: by so much sooner, or by so much later, than any tracker is at times.
_SET_BACK_S, _SET_ON_S = 0.15, 2.0
# A smaller step to later frames is believed after two seconds of them.
_LATER_PIECES = 2
_AGAIN_AFTER_S = 0.1


class Envelope:
    """The lower envelope of arrival minus stamp over the last 10 s: a straight line, as clocks run.

    Attributes:
        slope: By how much the stamps' clock runs slow, s/s; negative: fast; 0 where no drift is to be seen.
        steady: Whether the delays of the last half second agree.
        recent_s: The delay of those of them that came soonest, seconds.
        resets: How often the other clock was set.
    """

    def __init__(self) -> None:
        self.slope, self.steady, self.resets, self.recent_s = 0.0, False, 0, 0.0
        self._due_s = -np.inf
        self._recent: deque[tuple[float, float]] = deque(maxlen=_RECENT_MAX)
        self._forget()

    def add(self, arrival_s: float, delay_s: float) -> None:
        """Take note of a frame.

        Args:
            arrival_s: When it arrived, on our clock; not earlier than the one before.
            delay_s: Arrival minus stamp, seconds.
        """
        self._recent.append((arrival_s, delay_s))
        if arrival_s - self._piece_from_s >= _PIECE_S:
            self._end_piece(arrival_s)
        self._piece.append(delay_s)
        if arrival_s >= self._due_s or len(self._piece) <= _RECENT_FRAMES:
            self._due_s = arrival_s + _AGAIN_AFTER_S
            self._judge(arrival_s)

    def at(self, time_s: float) -> float:
        """The delay of the frames that come soonest.

        Args:
            time_s: When they arrive, seconds.

        Returns:
            Seconds; with the offset of the other clock in it.
        """
        return self._level_s + self.slope * (time_s - self._fitted_s)

    def _forget(self) -> None:
        self._lows: deque[tuple[float, float]] = deque(maxlen=_PIECES)
        self._piece: list[float] = []
        self._piece_from_s = -np.inf
        self._level_s = self._fitted_s = 0.0

    def _end_piece(self, arrival_s: float) -> None:
        if self._piece:
            self._lows.append((self._piece_from_s + 0.5 * _PIECE_S, _soonest(self._piece)))
        while self._lows and self._lows[0][0] < arrival_s - _PIECES * _PIECE_S:
            self._lows.popleft()
        self._piece, self._piece_from_s = [], arrival_s

    def _judge(self, now_s: float) -> None:
        while self._recent[0][0] < now_s - _RECENT_S:
            self._recent.popleft()
        delays_s = [delay_s for _, delay_s in self._recent]
        enough = len(delays_s) >= _RECENT_FRAMES and now_s - self._recent[0][0] >= _RECENT_LEAST_S
        self.steady = enough and max(delays_s) - min(delays_s) < _STEADY_WITHIN_S
        self.recent_s = _soonest(delays_s)
        if self._lows and self._was_set(now_s):
            self.slope, self.resets = 0.0, self.resets + 1
            self._forget()
            self._piece, self._piece_from_s = delays_s, self._recent[0][0]
        self._fit(now_s)

    def _was_set(self, now_s: float) -> bool:
        earlier, later = list(self._lows)[:-_LATER_PIECES], list(self._lows)[-_LATER_PIECES:]
        off_s = self.recent_s - self._usual_s(list(self._lows), now_s)
        return (self.steady and not -_SET_BACK_S < off_s < _SET_ON_S) or (
            bool(earlier) and all(low_s - self._usual_s(earlier, at_s) > _SET_BACK_S for at_s, low_s in later)
        )

    def _usual_s(self, lows: list[tuple[float, float]], time_s: float) -> float:
        """The median of pieces at another time: whatever one piece holds, it does not move it."""
        return float(np.median([low_s + self.slope * (time_s - at_s) for at_s, low_s in lows]))

    def _fit(self, now_s: float) -> None:
        points = np.array([*self._lows, (0.5 * (self._piece_from_s + now_s), _soonest(self._piece))])
        self._fitted_s = now_s
        times_s, lows_s = points[:, 0] - now_s, points[:, 1]
        self.slope = _drift(times_s, lows_s)
        self._level_s = float(np.min(lows_s - self.slope * times_s))


def _soonest(delays_s: list[float]) -> float:
    return sorted(delays_s)[len(delays_s) // _SOONEST_SHARE]


def _drift(times_s: np.ndarray, lows_s: np.ndarray) -> float:
    """Slope of the line through the pieces' soonest frames; 0 where it may be noise."""
    if times_s.size <= _DRIFT_PIECES:
        return 0.0
    times_s = times_s - times_s.mean()
    spread = float(times_s @ times_s)
    slope = float(times_s @ lows_s) / spread
    left_s = lows_s - lows_s.mean() - slope * times_s
    error_s = max(float(np.sqrt(left_s @ left_s / (times_s.size - 2))), _SOONEST_ERROR_S)
    return slope if abs(slope) > max(_DRIFT_LEAST, _DRIFT_ERRORS * error_s / spread**0.5) else 0.0


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

    def __init__(self, stamps: Stamps, clock: Clock) -> None:
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


# A clock is identified from frames over at least this time.
_LEAST_S, _CLOCK_FRAMES = 0.3, 3
# The loop refuses what is captured later than this after now.
_AHEAD_S = 0.01
# So near to a clock is a stamp of this clock: frames are late, by less than this, and clocks differ a little.
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
        stale_after_s: Age on arrival from which on an observation is refused, seconds.
    """
    bad = sum(not -_AHEAD_S <= frame.arrival_s - frame.capture_s <= stale_after_s for frame in frames)
    return 2 * bad >= len(frames)


def judge_stamps(
    frames: Sequence[Frame], stale_after_s: float, reader: StampReader | None, clock: Clock, hints: SetupHints
) -> Finding | None:
    """Identify clock and unit of capture times.

    Args:
        frames: The frames of the last second, in the order of arrival.
        stale_after_s: Age on arrival from which on an observation is refused, seconds.
        reader: How stamps were read; None if the source gave the loop's times.
        clock: The loop's clock.
        hints: Names of the settings in warnings.

    Returns:
        What is wrong with them; None if nothing is, or too few frames have come.
    """
    if len(frames) < _CLOCK_FRAMES or frames[-1].arrival_s - frames[0].arrival_s < _LEAST_S:
        return None
    if reader is not None and reader.stamps.clock in ("other", "arrival"):
        return None
    unit: StampUnit = "s" if reader is None else reader.stamps.unit
    captures_s = [frame.capture_s for frame in frames]
    numbers = np.array(captures_s if reader is None else [reader.stamp(each) for each in captures_s])
    text = _standing(numbers / PER_SECOND[unit], hints)
    if not text and unusable(frames, stale_after_s):
        text = _likely_clock(numbers, unit, frames, _known_clocks(reader, clock), hints)
    return Finding(Event.WRONG_CLOCK, text) if text else None


def _standing(stamps_s: FloatArray, hints: SetupHints) -> str:
    distinct = np.unique(stamps_s.round(4))
    if len(stamps_s) < _STILL_FRAMES or 2 * distinct.size > len(stamps_s):
        return ""
    if distinct.size == 1:
        return f"all frames have the same capture time: send each frame's own, or {hints.stamps('arrival')}"
    if np.allclose(distinct, distinct.round(), atol=2e-4, rtol=0):
        return f"capture times are whole seconds: send fractions, too, or {hints.stamps('arrival')}"
    return ""


def _known_clocks(reader: StampReader | None, clock: Clock) -> dict[str, float]:
    """What clocks of this computer show at the zero of the loop's, seconds; first the one that stamps are read by."""
    known: dict[str, float] = {}
    if clock.is_real:
        known = {"unix": -clock.from_unix_s(0.0), "monotonic": -clock.from_monotonic_s(0.0)}
    if reader is None:
        return {"loop": 0.0, **known}
    return {reader.stamps.clock: known[reader.stamps.clock], **known}


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


# Two clocks that agree still differ by this much.
_AGREE_S = 0.01
# No tracker is so slow. Between this and what is stale it may be the tracker as well as the clock.
_SLOWEST_S = 2.0


class ClockOffset:
    """Watches how late frames are by their stamps, and shifts capture times that cannot be.

    Frames from the future, and from more than 2 s ago, are of another clock. So are those that come sooner and sooner.
    The age that was believed before is kept; without any the soonest frames are taken to be `latency_s` old. A clock
    that is slow cannot be distinguished from a tracker that falls behind, and is not corrected.

    Args:
        latency_s: Least time from capture to arrival, seconds.
        hints: Names of the settings in warnings.

    Attributes:
        age_s: How old the soonest frames are by their stamps, seconds; negative if they are of the future.
        finding: The correction in use, and the setting for it; None without one.
    """

    def __init__(self, latency_s: float, hints: SetupHints) -> None:
        self.age_s = 0.0
        self.finding: Finding | None = None
        self._latency_s, self._hints = latency_s, hints
        self._envelope = Envelope()
        self._resets = 0
        self._usual_s: float | None = None
        self._believed_s = latency_s

    def shift_s(self, arrival_s: float, capture_s: float) -> float:
        """Take note of a frame.

        Args:
            arrival_s: When it arrived, seconds.
            capture_s: Its time of capture as stated, on the loop's clock, seconds.

        Returns:
            What to add to the time of capture, seconds; 0 where the clock is believed.
        """
        envelope = self._envelope
        envelope.add(arrival_s, arrival_s - capture_s)
        self.age_s = envelope.at(arrival_s)
        if envelope.resets != self._resets:
            self._resets, self._usual_s, self.finding = envelope.resets, None, None
        if envelope.steady and self.finding is None:
            self._judge(envelope.recent_s, envelope.slope)
        return 0.0 if self.finding is None else self.age_s - self._believed_s

    def _judge(self, recent_s: float, slope: float) -> None:
        if not -_AGREE_S <= recent_s <= _SLOWEST_S:
            off_s = self._believed_s - self.age_s
            self._shift(f"is {shown(abs(off_s))} s {'ahead' if off_s > 0 else 'behind'}")
        elif self._usual_s is None:
            self._usual_s = self._believed_s = self.age_s
        elif slope < 0.0:
            self._shift(f"runs {-100 * slope:.1f} % fast")

    def _shift(self, how: str) -> None:
        text = (
            f"the tracker's clock {how}: capture times are shifted, so that the soonest frames are "
            f"{max(self._believed_s, 0.0):.2f} s old; set the clocks of both computers by NTP, or "
            f"{self._hints.stamps('other')}"
        )
        self.finding = Finding(Event.CLOCK_SHIFTED, text)
