"""Capture times of wrong clocks and units: what they look like, and that what is named mends them."""

import re

import numpy as np
import pytest

from gazempc.live.clock import RealClock, SimulatedClock
from gazempc.live.stamps import Frame, SetupHints, StampReader, Stamps, judge_stamps

HEAD = np.array([2.0, 0.0, 0.4])
CLOCK = RealClock()
# What the computer's clocks show at the zero of the loop's.
UNIX_S, MONOTONIC_S = -CLOCK.from_unix_s(0.0), -CLOCK.from_monotonic_s(0.0)
ARRIVALS_S = 5.0 + np.arange(28) / 30.0
LATE_S = 0.04


def frames_of(stamps, reader):
    """What becomes of stamps that arrive at 30 Hz."""
    captures_s = [reader.loop_s(float(stamp), at_s) for stamp, at_s in zip(stamps, ARRIVALS_S, strict=True)]
    return [Frame(at_s, each_s, HEAD, HEAD, None) for at_s, each_s in zip(ARRIVALS_S, captures_s, strict=True)]


def judged(stamps, settings=None, hints=None):
    reader = StampReader(settings or Stamps(), CLOCK)
    found = judge_stamps(frames_of(stamps, reader), 0.5, reader, CLOCK, hints or SetupHints())
    return None if found is None else (str(found.event), found.text)


def unix(off_s=0.0, per_s=1.0):
    return per_s * (UNIX_S + ARRIVALS_S - LATE_S + off_s)


def monotonic(per_s=1.0):
    return per_s * (MONOTONIC_S + ARRIVALS_S - LATE_S)


WRONG = {
    "milliseconds": (unix(per_s=1e3), "--stamps.unit ms"),
    "monotonic": (monotonic(), "--stamps.clock monotonic"),
    "behind": (unix(-37.3), "--stamps.clock other"),
    "milliseconds of another clock": (unix(-37.3, 1e3), "--stamps.clock other --stamps.unit ms"),
    "simulated time": (20.0 + 0.3 * ARRIVALS_S, "--stamps.clock arrival"),
    # A whole second passes in the middle of them, whenever the test runs.
    "whole seconds": (np.floor(unix(-(unix()[14] % 1.0))), "--stamps.clock arrival"),
    "standing": (np.full(28, unix()[0]), "--stamps.clock arrival"),
    "slow": (unix(-0.76), "--stamps.clock other"),
}


@pytest.mark.parametrize(("stamps", "mend"), WRONG.values(), ids=WRONG.keys())
def test_wrong_stamps_are_named_and_the_option_mends_them(stamps, mend):
    event, text = judged(stamps)
    assert event == "wrong_clock"
    assert text.endswith(mend) or f"{mend}," in text
    options = dict(re.findall(r"--stamps\.(clock|unit) (\w+)", text))
    mended = Stamps(**options)
    assert judged(stamps, mended) is None
    reader = StampReader(mended, CLOCK)
    ages_s = np.array([frame.arrival_s - frame.capture_s for frame in frames_of(stamps, reader)])
    assert np.all((ages_s >= 0.0) & (ages_s < 0.1))


@pytest.mark.parametrize(
    "settings", [Stamps(), Stamps(unit="ms"), Stamps(clock="monotonic"), Stamps(clock="monotonic", unit="ns")]
)
def test_right_stamps_are_not_complained_of(settings):
    per_s = {"s": 1.0, "ms": 1e3, "ns": 1e9}[settings.unit]
    assert judged(unix(per_s=per_s) if settings.clock == "unix" else monotonic(per_s), settings) is None


def test_the_words_are_those_of_python_or_of_a_source_of_one_s_own():
    assert 'clock="other"' in judged(unix(-37.3), hints=SetupHints(python=True))[1]
    hints = SetupHints(own_source=True)
    for clock, off_s, named in ((CLOCK, UNIX_S, "clock.from_unix_s"), (SimulatedClock(), -3.0, "3 s behind")):
        frames = [Frame(at_s, off_s + at_s, HEAD, HEAD, None) for at_s in ARRIVALS_S]
        assert named in judge_stamps(frames, 0.5, None, clock, hints).text
