"""Whether the capture times are of the clock and in the unit that they are read in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gazempc.live.clock import Clock, RealClock
from gazempc.live.stamps import PER_SECOND, StampReader, StampUnit
from gazempc.live.watch.frame import Finding, Frame, shown
from gazempc.live.watch.mends import Mends
from gazempc.loop.events import Event
from gazempc.types import FloatArray

# A clock is told by frames over at least this time.
_LEAST_S, _LEAST_FRAMES = 0.3, 3
# The loop refuses what is captured later than this after now.
_AHEAD_S = 0.01
# So near to a clock is a stamp of this clock: frames are late, by less than this, and clocks differ a little.
_LATE_S, _EARLY_S = 2.0, 0.2
# Rates within this factor of a unit's are this unit.
_SAME_RATE = 1.5
_STILL_FRAMES = 5
_UNITS: dict[StampUnit, str] = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
_CLOCKS = {"unix": "Unix time", "monotonic": "this computer's monotonic clock", "loop": "the loop's time"}
_HALF_HOUR_S, _FARTHEST_ZONE_S, _ZONE_SLACK_S = 1800.0, 14 * 3600.0, 60.0


def unusable(frames: Sequence[Frame], stale_after_s: float) -> bool:
    """Whether the loop refuses at least half of the frames for their capture times.

    Args:
        frames: The frames.
        stale_after_s: Age on arrival from which on an observation is refused, seconds.
    """
    bad = sum(not -_AHEAD_S <= frame.arrival_s - frame.capture_s <= stale_after_s for frame in frames)
    return 2 * bad >= len(frames)


def judge_stamps(
    frames: Sequence[Frame], stale_after_s: float, reader: StampReader | None, clock: Clock, mends: Mends
) -> Finding | None:
    """Find out what capture times are.

    Args:
        frames: The frames of the last second, in the order of arrival.
        stale_after_s: Age on arrival from which on an observation is refused, seconds.
        reader: How stamps were read; None if the source gave the loop's times.
        clock: The loop's clock.
        mends: Names what mends it.

    Returns:
        What is wrong with them; None if nothing is, or nothing can be told.
    """
    if len(frames) < _LEAST_FRAMES or frames[-1].arrival_s - frames[0].arrival_s < _LEAST_S:
        return None
    if reader is not None and reader.stamps.clock in ("other", "arrival"):
        return None
    unit: StampUnit = "s" if reader is None else reader.stamps.unit
    captures_s = [frame.capture_s for frame in frames]
    numbers = np.array(captures_s if reader is None else [reader.stamp(each) for each in captures_s])
    text = _standing(numbers / PER_SECOND[unit], mends)
    if not text and unusable(frames, stale_after_s):
        text = _what_they_are(numbers, unit, frames, _known_clocks(reader, clock), mends)
    return Finding(Event.WRONG_CLOCK, text) if text else None


def _standing(stamps_s: FloatArray, mends: Mends) -> str:
    distinct = np.unique(stamps_s.round(4))
    if len(stamps_s) < _STILL_FRAMES or 2 * distinct.size > len(stamps_s):
        return ""
    if distinct.size == 1:
        return f"all frames have the same capture time: send each frame's own, or {mends.stamps('arrival')}"
    if np.allclose(distinct, distinct.round(), atol=2e-4, rtol=0):
        return f"capture times are whole seconds: send fractions, too, or {mends.stamps('arrival')}"
    return ""


def _known_clocks(reader: StampReader | None, clock: Clock) -> dict[str, float]:
    """What clocks of this computer show at the zero of the loop's, seconds; first the one that stamps are read by."""
    known: dict[str, float] = {}
    if isinstance(clock, RealClock):
        known = {"unix": -clock.from_unix_s(0.0), "monotonic": -clock.from_monotonic_s(0.0)}
    if reader is None:
        return {"loop": 0.0, **known}
    return {reader.stamps.clock: known[reader.stamps.clock], **known}


def _what_they_are(
    numbers: FloatArray, read_unit: StampUnit, frames: Sequence[Frame], clocks: dict[str, float], mends: Mends
) -> str:
    arrival_s = frames[-1].arrival_s
    rate = float(numbers[-1] - numbers[0]) / (arrival_s - frames[0].arrival_s)
    unit = next((unit for unit, per_s in PER_SECOND.items() if per_s / _SAME_RATE <= rate <= per_s * _SAME_RATE), None)
    if unit is None:
        steps = np.diff(numbers)
        counts = np.allclose(steps, steps.round(), atol=1e-4, rtol=0) and steps.min() >= 1
        what = ", which looks like frame numbers" if counts else ""
        return f"capture times advance by {shown(rate)} in a second{what}: {mends.stamps('arrival')}, or send times"
    stamp_s = float(numbers[-1]) / PER_SECOND[unit]
    off_s = {name: stamp_s - (arrival_s + shown_s) for name, shown_s in clocks.items()}
    read_as = next(iter(clocks))
    near = [name for name, off in off_s.items() if -_LATE_S <= off <= _EARLY_S]
    if near and (near[0] != read_as or unit != read_unit):
        in_unit = "" if unit == "s" else f" in {_UNITS[unit]}"
        return f"capture times look like {_CLOCKS[near[0]]}{in_unit}: {mends.stamps(near[0], unit)}"
    age_s = float(np.median([frame.arrival_s - frame.capture_s for frame in frames]))
    if near and age_s > 0:
        slow = mends.setting("loop", "stale_after_s", round(1.5 * age_s, 1))
        return (
            f"frames arrive {age_s:.2f} s after capture by their stamps: if the tracker is so slow say {slow}; if not, "
            f"its clock is behind: {mends.stamps('other', unit)}"
        )
    return _of_other_clock(off_s[read_as], unit, read_as, mends)


def _of_other_clock(ahead_s: float, unit: StampUnit, read_as: str, mends: Mends) -> str:
    in_unit = "" if unit == "s" else f", in {_UNITS[unit]}"
    if abs(ahead_s) > _FARTHEST_ZONE_S:
        return f"capture times are of a clock with another start{in_unit}: {mends.stamps('other', unit)}"
    off = f"{shown(abs(ahead_s))} s {'ahead' if ahead_s > 0 else 'behind'}"
    zone = abs(ahead_s) > _ZONE_SLACK_S and abs(ahead_s - _HALF_HOUR_S * round(ahead_s / _HALF_HOUR_S)) < _ZONE_SLACK_S
    if read_as == "unix" and zone:
        mend = f"send Unix time, or {mends.stamps('other', unit)}"
        return f"capture times are {off}{in_unit}, which looks like local time: {mend}"
    return (
        f"capture times are of another clock, {off}{in_unit}: set the clocks of both computers by NTP, or "
        f"{mends.stamps('other', unit)}"
    )
