"""Ticks that are left out: the loop is woken late, or a command takes long to send."""

import numpy as np
import pytest
from builders.checks import assert_recovered, assert_sound
from builders.faults import Jumping
from builders.live import TS, run_live

from gazempc.sim.simulated import SimulatedNeck


@pytest.mark.parametrize(("where", "jump_s"), [("asleep", 0.052), ("at work", 0.05), ("at work", 2.0)])
def test_ticks_that_are_over_are_left_out_and_nothing_bursts(jump_s, where):
    """The loop is woken late once, or a command takes long to send: as seen by the robot."""
    clock = Jumping([(2.0, jump_s)] if where == "asleep" else [])
    blocked_s = [jump_s] if where == "at work" else []

    class HeldUp(SimulatedNeck):
        """A neck whose port is blocked once for some time, after a command has gone out."""

        def send_command(self, position_rad):
            sent = super().send_command(position_rad)
            if blocked_s and clock.now_s() >= 2.0 - 1e-9:
                clock.sleep_until_s(clock.now_s() + blocked_s.pop())
            return sent

    result = run_live(clock=clock, robot_class=HeldUp, duration_s=5.7 + jump_s)
    assert_sound(result)
    n = int(jump_s / TS + 1e-6)
    # A tick more may be done than there is time for, at the same instant.
    assert n - 2 <= result.report.skipped_ticks <= n
    assert result.report.lateness.max_ms == pytest.approx(1e3 * jump_s, abs=5.1)
    sent_s = np.array([now_s for now_s, _ in result.robot.received])
    assert max(np.searchsorted(sent_s, t + 10 * TS - 1e-9) - k for k, t in enumerate(sent_s)) <= 12
    # The grid of the ticks is kept.
    on_time = sent_s[sent_s > 2.0 + jump_s + 3 * TS]
    assert np.abs(on_time / TS - np.round(on_time / TS)).max() < 1e-6
    assert_recovered(result, 2.0 + jump_s + 2.0, within_deg=1.0)
    assert_recovered(result, 2.0 + jump_s + 2.5)
