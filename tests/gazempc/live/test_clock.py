"""Clocks of computer and tracker: stamps, wrong stamps, offset and drift; and lateness."""

import re
import time

import numpy as np
import pytest

from gazempc.live.clock import RealClock, SimulatedClock
from gazempc.live.logs import Lateness
from gazempc.live.stamps import PER_SECOND, ClockOffset, Frame, SetupHints, StampReader, Stamps, judge_stamps
from gazempc.live.summary import last_line


def test_the_real_clock_never_wakes_early_and_skips_past_times():
    clock = RealClock()
    assert 0 <= clock.now_s() < 10
    for ahead_s in (0.0, 1e-5, 3e-4, 0.002, 0.01, -1.0):
        until_s = clock.now_s() + ahead_s
        clock.sleep_until_s(until_s)
        assert clock.now_s() >= until_s


def test_unix_stamps_are_converted_and_a_clock_step_is_reported_once(monkeypatch):
    now = {"monotonic": 1000.0, "time": 1.7e9}
    monkeypatch.setattr(time, "monotonic", lambda: now["monotonic"])
    monkeypatch.setattr(time, "time", lambda: now["time"])

    def passed(monotonic_s, unix_s):
        now.update(monotonic=now["monotonic"] + monotonic_s, time=now["time"] + unix_s)
        return clock.unix_clock_stepped()

    clock = RealClock()
    assert not passed(5.0, 5.0)
    assert clock.from_unix_s(1.7e9 + 4.9) == pytest.approx(4.9, abs=1e-6)
    for step_s in (3600.0, -7200.0, 0.5):
        assert passed(0.1, 0.1 + step_s)
        assert not clock.unix_clock_stepped()
        # Loop time continues; stamps of the new clock are correct again.
        assert clock.from_unix_s(now["time"]) == pytest.approx(clock.now_s(), abs=1e-6)
    assert not passed(0.0, 0.002)  # the clock is slewed, not set
    assert clock.now_s() == pytest.approx(5.3)


CLOCK = RealClock()


@pytest.mark.parametrize("unit", PER_SECOND)
@pytest.mark.parametrize("clock", ["unix", "monotonic"])
def test_a_stamp_converts_to_loop_time_and_back(clock, unit):
    zero_s = {"unix": CLOCK.from_unix_s, "monotonic": CLOCK.from_monotonic_s}[clock](0.0)
    reader = StampReader(Stamps(clock=clock, unit=unit), CLOCK)
    stamp = (12.5 - zero_s) * PER_SECOND[unit]
    assert reader.loop_s(stamp, 13.0) == pytest.approx(12.5, abs=1e-5)
    assert reader.stamp(12.5) == pytest.approx(stamp, rel=1e-12)


def test_lateness_percentiles_equal_numpy_within_a_bin():
    rng = np.random.default_rng(0)
    values = rng.gamma(0.5, 2.0, 3000) * rng.choice([1.0, -0.1], 3000, p=[0.8, 0.2])  # some are early
    late_ms, lateness = np.maximum(values, 0.0), Lateness()
    for value in values:
        lateness.add(float(value))
    assert (lateness.count, lateness.max_ms) == (3000, values.max())
    for percent in (0, 25, 99, 99.9, 100):
        exact_ms = np.percentile(late_ms, percent, method="inverted_cdf")
        assert -1e-9 <= lateness.percentile_ms(percent) - exact_ms <= 0.01 + 1e-9
    near = np.sum(np.abs(late_ms - 1.0) <= 0.011)
    assert abs(lateness.beyond(1.0) - np.sum(late_ms >= 1.0)) <= near


HEAD = np.array([2.0, 0.0, 0.4])
# Readings of the computer's clocks at the zero of the loop's.
UNIX_S, MONOTONIC_S = -CLOCK.from_unix_s(0.0), -CLOCK.from_monotonic_s(0.0)
ARRIVALS_S = 5.0 + np.arange(28) / 30.0
LATE_S = 0.04


def frames_of(stamps, reader):
    """Results for stamps that arrive at 30 Hz."""
    captures_s = [reader.loop_s(float(stamp), at_s) for stamp, at_s in zip(stamps, ARRIVALS_S, strict=True)]
    return [Frame(at_s, each_s, HEAD, HEAD, None) for at_s, each_s in zip(ARRIVALS_S, captures_s, strict=True)]


def judged(stamps, settings=None, hints=None):
    reader = StampReader(settings or Stamps(), CLOCK)
    found = judge_stamps(frames_of(stamps, reader), 0.5, reader, CLOCK, hints or SetupHints())
    return None if found is None else (str(found.event), found.text)


def unix(off_s=0.0, per_s=1.0):
    return per_s * (UNIX_S + ARRIVALS_S - LATE_S + off_s)


WRONG = {
    "milliseconds": (unix(per_s=1e3), "--stamps.unit ms"),
    "monotonic": (unix(MONOTONIC_S - UNIX_S), "--stamps.clock monotonic"),
    "milliseconds, monotonic": (unix(MONOTONIC_S - UNIX_S, 1e3), "--stamps.clock monotonic --stamps.unit ms"),
    "milliseconds of another clock": (unix(-37.3, 1e3), "--stamps.clock other --stamps.unit ms"),
    "simulated time": (20.0 + 0.3 * ARRIVALS_S, "--stamps.clock arrival"),
    # They always include a change of the second.
    "whole seconds": (np.floor(unix(-(unix()[14] % 1.0))), "--stamps.clock arrival"),
    "standing": (np.full(28, unix()[0]), "--stamps.clock arrival"),
    "slow": (unix(-0.76), "--stamps.clock other"),
}


@pytest.mark.parametrize(("stamps", "remedy"), WRONG.values(), ids=WRONG.keys())
def test_wrong_stamps_are_reported_with_the_correcting_option(stamps, remedy):
    event, text = judged(stamps)
    assert event == "wrong_clock"
    assert text.endswith(remedy) or f"{remedy}," in text
    options = dict(re.findall(r"--stamps\.(clock|unit) (\w+)", text))
    corrected = Stamps(**options)
    assert judged(stamps, corrected) is None
    reader = StampReader(corrected, CLOCK)
    ages_s = np.array([frame.arrival_s - frame.capture_s for frame in frames_of(stamps, reader)])
    assert np.all((ages_s >= 0.0) & (ages_s < 0.1))


def test_correct_stamps_are_accepted_and_hints_match_the_interface():
    assert judged(unix()) is None
    assert 'clock="other"' in judged(unix(-37.3), hints=SetupHints(python=True))[1]
    hints = SetupHints(own_source=True)
    for clock, off_s, named in ((CLOCK, UNIX_S, "clock.from_unix_s"), (SimulatedClock(), -3.0, "3 s behind")):
        frames = [Frame(at_s, off_s + at_s, HEAD, HEAD, None) for at_s in ARRIVALS_S]
        assert named in judge_stamps(frames, 0.5, None, clock, hints).text


LATENCY_S = 0.066


def stream(duration_s=20.0):
    """Capture times and arrivals: latency and exponential jitter, in order."""
    captures_s = np.arange(0.0, duration_s, 1 / 30)
    jitter_s = 0.01 * np.random.default_rng(0).exponential(size=captures_s.size)
    return captures_s, np.maximum.accumulate(captures_s + LATENCY_S + jitter_s)


def read(stamps_s, arrivals_s):
    """Capture times used, and the message."""
    offset = ClockOffset(0.05, SetupHints())
    used_s = [stamp + offset.shift_s(at_s, stamp) for stamp, at_s in zip(stamps_s, arrivals_s, strict=True)]
    return np.array(used_s), "" if offset.finding is None else offset.finding.text


@pytest.mark.parametrize(
    ("stamps_s", "from_s", "within_s", "named"),
    [
        (lambda t: t + 7200.0, 1.0, 0.03, "ahead"),
        (lambda t: t - 1.7e9, 1.0, 0.03, "behind"),
        (lambda t: t + 0.2 * ((t >= 8.0) & (t < 9.0)), 11.5, 0.02, ""),
        (lambda t: 1.01 * t, 12.0, 0.02, "% fast"),
    ],
    ids=["ahead", "behind", "ahead for a second", "fast"],
)
def test_a_clock_offset_is_compensated(stamps_s, from_s, within_s, named):
    """The minimum latency is assumed 0.05 s, and is 0.066 s."""
    captures_s, arrivals_s = stream(40.0)
    used_s, text = read(stamps_s(captures_s), arrivals_s)
    assert np.abs(used_s - captures_s)[captures_s > from_s].max() < within_s
    assert named in text
    assert ("--stamps.clock other" in text) == bool(named)


@pytest.mark.parametrize(
    "change",
    [
        lambda t, at: (t * (1 + 1e-4), at),
        lambda t, at: (t + 0.04, at),
        lambda t, at: (t - 0.3, at),
        lambda t, at: (t, np.where((t > 5.0) & (t < 7.0), 7.0 + LATENCY_S, at)),
        lambda t, at: (t + 0.3 * (np.arange(t.size) % 20 == 7), at),
        lambda t, at: (t, at + 0.01 * t),
        lambda t, at: (1e3 * t, at),
        lambda t, at: (np.floor(t), at),
    ],
    ids=["ppm", "0.04 s ahead", "0.3 s behind", "a pause", "single", "falls behind", "milliseconds", "whole seconds"],
)
def test_stamps_without_a_clear_clock_offset_are_not_corrected(change):
    stamps_s, arrivals_s = change(*stream())
    used_s, text = read(stamps_s, np.maximum.accumulate(arrivals_s))
    assert text == ""
    assert np.array_equal(used_s, stamps_s)


@pytest.mark.parametrize("drift", [-0.01, 0.01])
def test_the_offset_of_another_clock_follows_drift_of_either_sign(drift):
    captures_s, arrivals_s = stream(60.0)
    reader = StampReader(Stamps(clock="other", latency_s=LATENCY_S), RealClock())
    stamps_s = 1000.0 + (1.0 + drift) * captures_s
    used_s = np.array([reader.loop_s(*each) for each in zip(stamps_s, arrivals_s, strict=True)])
    assert np.abs(used_s - captures_s)[captures_s > 12.0].max() < 0.02


def test_the_last_line_counts_unused_observations_by_reason():
    for refused, ages, line in (
        ({}, (None, None), "5 of 5 used"),
        ({"future_observation": 360}, (-0.05, -0.04), "5 of 365 used: 360 future (clock 0.1 s ahead?)"),
        ({"stale_observation": 9}, (0.7, 0.8), "5 of 14 used: 9 stale (clock 0.8 s behind, or slow?)"),
        ({"gate_refused": 3, "sender_refused": 2}, (None, None), "5 of 10 used: 3 gate, 2 sender"),
    ):
        summary = {"used": 5, "observations": 5 + sum(refused.values()), "refused": refused, "soonest_age_s": ages}
        assert last_line(summary | {"settings": {"stamps": {"latency_s": 0.05}}}) == line
