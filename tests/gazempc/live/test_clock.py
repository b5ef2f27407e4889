"""The clocks: absolute, never early, and the computer's clock may be set meanwhile."""

import time

import pytest

from gazempc.live.clock import RealClock, SimulatedClock


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


def test_the_simulated_clock_never_runs_backwards():
    clock = SimulatedClock()
    clock.sleep_until_s(2.0)
    clock.sleep_until_s(1.0)
    assert clock.now_s() == 2.0
