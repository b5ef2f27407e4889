"""Clocks, capture times of other clocks, and lateness."""

import time

import numpy as np
import pytest

from gazempc.live.clock import RealClock
from gazempc.live.logs import Lateness
from gazempc.live.stamps import PER_SECOND, StampReader, Stamps


def test_the_real_clock_never_wakes_early_and_does_not_wait_for_the_past():
    clock = RealClock()
    assert 0 <= clock.now_s() < 10
    for ahead_s in (0.0, 1e-5, 3e-4, 0.002, 0.01, -1.0):
        until_s = clock.now_s() + ahead_s
        clock.sleep_until_s(until_s)
        assert clock.now_s() >= until_s


class FakeTime:
    """The computer's two clocks, in the hands of a test."""

    def __init__(self, monkeypatch):
        self.monotonic_s, self.unix_s = 1000.0, 1.7e9
        monkeypatch.setattr(time, "monotonic", lambda: self.monotonic_s)
        monkeypatch.setattr(time, "time", lambda: self.unix_s)

    def pass_s(self, seconds):
        self.monotonic_s += seconds
        self.unix_s += seconds


def test_unix_stamps_are_converted_and_a_step_of_the_unix_clock_is_named_once(monkeypatch):
    fake = FakeTime(monkeypatch)
    clock = RealClock()
    fake.pass_s(5.0)
    assert clock.now_s() == pytest.approx(5.0)
    assert clock.from_unix_s(1.7e9 + 4.9) == pytest.approx(4.9, abs=1e-6)
    assert not clock.unix_clock_stepped()
    for step_s in (3600.0, -7200.0, 0.5):
        fake.unix_s += step_s
        fake.pass_s(0.1)
        assert clock.unix_clock_stepped()
        assert not clock.unix_clock_stepped()
        # The time of the loop goes on; stamps of the new clock are right again.
        assert clock.from_unix_s(fake.unix_s) == pytest.approx(clock.now_s(), abs=1e-6)
    fake.unix_s += 0.002  # the clock is slewed, not set
    assert not clock.unix_clock_stepped()
    assert clock.now_s() == pytest.approx(5.3)


CLOCK = RealClock()


@pytest.mark.parametrize("unit", PER_SECOND)
@pytest.mark.parametrize("clock", ["unix", "monotonic"])
def test_a_stamp_comes_to_the_loop_and_back(clock, unit):
    zero_s = {"unix": CLOCK.from_unix_s, "monotonic": CLOCK.from_monotonic_s}[clock](0.0)
    reader = StampReader(Stamps(clock=clock, unit=unit), CLOCK)
    stamp = (12.5 - zero_s) * PER_SECOND[unit]
    assert reader.loop_s(stamp, 13.0) == pytest.approx(12.5, abs=1e-5)
    assert reader.stamp(12.5) == pytest.approx(stamp, rel=1e-12)


def test_percentiles_of_lateness_are_numpy_s_within_a_bin():
    rng = np.random.default_rng(0)
    values = rng.gamma(0.5, 2.0, size=int(rng.integers(1, 5000)))
    values[rng.random(values.size) < 0.2] *= -0.1
    lateness = Lateness()
    for value in values:
        lateness.add(float(value))
    assert lateness.count == values.size
    assert lateness.max_ms == max(values.max(), 0.0)
    clipped = np.maximum(values, 0.0)
    for percent in (0, 1, 25, 50, 90, 99, 99.9, 100):
        exact = float(np.percentile(clipped, percent, method="inverted_cdf"))
        found = lateness.percentile_ms(percent)
        assert -1e-9 <= found - exact <= 0.01 + 1e-9
    for limit_ms in (0.1, 1.0, 5.0, 150.0):
        near = np.sum(np.abs(clipped - limit_ms) <= 0.011)
        assert abs(lateness.beyond(limit_ms) - np.sum(clipped >= limit_ms)) <= near
