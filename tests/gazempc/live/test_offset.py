"""Clocks that are ahead, behind or drift: found out from the stream and made up for; good streams are left alone."""

import numpy as np
import pytest

from gazempc.live.clock import RealClock
from gazempc.live.stamps import ClockOffset, SetupHints, StampReader, Stamps
from gazempc.live.summary import last_line

LATENCY_S = 0.066


def stream(duration_s=20.0, rate_hz=30.0, jitter_s=0.01, seed=0):
    """Capture times and arrivals: latency and exponential jitter, in order."""
    rng = np.random.default_rng(seed)
    captures_s = np.arange(0.0, duration_s, 1 / rate_hz)
    return captures_s, np.maximum.accumulate(captures_s + LATENCY_S + jitter_s * rng.exponential(size=captures_s.size))


def read(stamps_s, arrivals_s):
    """Capture times as they are used, and what is said."""
    offset = ClockOffset(0.05, SetupHints())
    used_s = [stamp + offset.shift_s(at_s, stamp) for stamp, at_s in zip(stamps_s, arrivals_s, strict=True)]
    return np.array(used_s), "" if offset.finding is None else offset.finding.text


@pytest.mark.parametrize(("ahead_s", "rate_hz"), [(0.1, 30), (7200.0, 10), (-3.0, 100), (-1.7e9, 30)])
def test_a_clock_that_is_off_is_made_up_for_within_a_second(ahead_s, rate_hz):
    captures_s, arrivals_s = stream(5.0, rate_hz)
    used_s, said = read(captures_s + ahead_s, arrivals_s)
    error_s = (used_s - captures_s)[captures_s > 1.0]
    # The soonest frames are taken to be 0.05 s old, and are 0.066 s.
    assert np.abs(error_s - (LATENCY_S - 0.05)).max() < 0.01
    assert "ahead" in said if ahead_s > 0 else "behind" in said
    assert "--stamps.clock other" in said


@pytest.mark.parametrize("ahead_s", [0.2, 3600.0])
def test_a_clock_that_was_ahead_for_a_second_does_not_shut_its_tracker_out(ahead_s):
    captures_s, arrivals_s = stream()
    used_s, _ = read(captures_s + ahead_s * ((captures_s >= 8.0) & (captures_s < 9.0)), arrivals_s)
    assert np.abs(used_s - captures_s)[captures_s > 11.5].max() < 0.02


def test_a_clock_that_is_one_percent_fast_is_made_up_for():
    captures_s, arrivals_s = stream(60.0)
    used_s, said = read(1.01 * captures_s, arrivals_s)
    assert np.abs(used_s - captures_s).max() < 0.07
    assert np.abs(used_s - captures_s)[captures_s > 12.0].max() < 0.02
    assert np.all(used_s < arrivals_s)
    assert "runs 1.0 % fast" in said or "runs 0.9 % fast" in said


def harmless(captures_s, arrivals_s):
    """What is no wrong clock, or cannot be told from a slow tracker."""
    rng = np.random.default_rng(1)
    pause = np.where((captures_s > 5.0) & (captures_s < 7.0), 7.0 + LATENCY_S, arrivals_s)
    return {
        "good": (captures_s, arrivals_s),
        "ppm": (captures_s * (1 + 1e-4), arrivals_s),
        "ppm slow": (captures_s * (1 - 1e-4), arrivals_s),
        "0.04 s ahead": (captures_s + 0.04, arrivals_s),
        "0.3 s behind": (captures_s - 0.3, arrivals_s),
        "a pause": (captures_s, np.maximum(pause, arrivals_s)),
        "one stamp in twenty is wrong": (captures_s + 0.3 * (rng.random(captures_s.size) < 0.05), arrivals_s),
        "falls behind": (captures_s, arrivals_s + 0.01 * captures_s),
        "slower from 8 s on": (captures_s, arrivals_s + 0.1 * (captures_s > 8.0)),
        "milliseconds": (1e3 * captures_s, arrivals_s),
        "whole seconds": (np.floor(captures_s), arrivals_s),
    }


def test_what_is_no_wrong_clock_is_left_alone():
    for kind, (stamps_s, arrivals_s) in harmless(*stream()).items():
        used_s, said = read(stamps_s, arrivals_s)
        assert said == "", kind
        assert np.array_equal(used_s, stamps_s)


@pytest.mark.parametrize("drift", [-0.01, 0.01])
def test_the_clock_other_follows_drift_both_ways(drift):
    captures_s, arrivals_s = stream(60.0)
    reader = StampReader(Stamps(clock="other", latency_s=LATENCY_S), RealClock())
    stamps_s = 1000.0 + (1.0 + drift) * captures_s
    used_s = np.array([reader.loop_s(*each) for each in zip(stamps_s, arrivals_s, strict=True)])
    assert np.abs(used_s - captures_s)[captures_s > 12.0].max() < 0.02


def test_the_last_line_says_why_observations_were_not_used():
    for refused, ages, line in (
        ({}, (None, None), "5 of 5 used"),
        ({"future_observation": 360}, (-0.05, -0.04), "5 of 365 used: 360 future (clock 0.1 s ahead?)"),
        ({"stale_observation": 9}, (0.7, 0.8), "5 of 14 used: 9 stale (clock 0.8 s behind, or slow?)"),
        ({"gate_refused": 3, "sender_refused": 2}, (None, None), "5 of 10 used: 3 gate, 2 sender"),
    ):
        summary = {"used": 5, "observations": 5 + sum(refused.values()), "refused": refused, "soonest_age_s": ages}
        assert last_line(summary | {"settings": {"stamps": {"latency_s": 0.05}}}) == line
