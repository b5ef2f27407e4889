"""Time stamps of other clocks on the loop's clock."""

import numpy as np
import pytest

from gazempc.live.clock import RealClock
from gazempc.live.stamps import PER_SECOND, StampReader, Stamps

CLOCK = RealClock()


@pytest.mark.parametrize("unit", PER_SECOND)
@pytest.mark.parametrize("clock", ["unix", "monotonic"])
def test_a_stamp_comes_to_the_loop_and_back(clock, unit):
    zero_s = {"unix": CLOCK.from_unix_s, "monotonic": CLOCK.from_monotonic_s}[clock](0.0)
    reader = StampReader(Stamps(clock=clock, unit=unit), CLOCK)
    stamp = (12.5 - zero_s) * PER_SECOND[unit]
    assert reader.loop_s(stamp, 13.0) == pytest.approx(12.5, abs=1e-5)
    assert reader.stamp(12.5) == pytest.approx(stamp, rel=1e-12)


def test_another_clock_is_set_by_the_frames_that_come_soonest():
    """A clock that drifts by 50 ppm, frames that take 0.05 s and up to 0.1 s more."""
    rng = np.random.default_rng(1)
    captures_s = np.arange(0.0, 120.0, 1 / 30)
    stamps = 5000.0 + (1.0 + 50e-6) * captures_s
    arrivals_s = captures_s + 0.05 + 0.1 * rng.random(captures_s.size) ** 2
    reader = StampReader(Stamps(clock="other", latency_s=0.05), CLOCK)
    read_s = np.array([reader.loop_s(*each) for each in zip(stamps, arrivals_s, strict=True)])
    error_s = (read_s - captures_s)[60:]
    assert np.abs(error_s).max() < 0.004
    assert np.abs(np.diff(read_s) - 1 / 30).mean() < 1e-4


def test_a_clock_that_is_set_back_is_followed_within_ten_seconds():
    captures_s = np.arange(0.0, 30.0, 0.1)
    stamps = captures_s - 3.0 * (captures_s >= 10.0)
    reader = StampReader(Stamps(clock="other", latency_s=0.05), CLOCK)
    read_s = np.array([reader.loop_s(stamp, at_s + 0.05) for stamp, at_s in zip(stamps, captures_s, strict=True)])
    assert np.abs(read_s - captures_s)[captures_s > 20.2].max() < 1e-9
