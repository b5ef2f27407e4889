"""Plans that are late, and ticks that are left out: the loop is woken late, or a command takes long to send."""

import numpy as np
import pytest
from builders.checks import assert_recovered, assert_sound, undisturbed
from builders.faults import Jumping, Late, between
from builders.live import NECK, TS, run_live

from gazempc.live.clock import SimulatedClock
from gazempc.settings import LoopSettings
from gazempc.sim.simulated import SimulatedNeck


def test_a_solver_that_takes_100_ms_for_a_second():
    """What is left of each late plan is used; the gaze is hardly worse meanwhile, and as ever 1.2 s after."""
    clock = SimulatedClock()
    slow = between(1.5, 2.5)
    result = run_live(
        clock=clock,
        planner=lambda controller: Late(controller, clock, lambda now: 0.1 if slow(now) else 0.0),
        duration_s=4.8,
    )
    assert_sound(result)
    assert result.events == {"no_observation_yet", "late_plan"}
    now = result.joined("time_s")
    during = (now >= 1.5) & (now < 3.5)
    assert np.max(np.abs(result.error_deg[during] - undisturbed().error_deg[: now.size][during])) < 3.1  # 2.7
    assert_recovered(result, 2.5 + 1.2)
    times = result.logs[0][1]
    assert times.latency_ms.max() > 150.0  # 66 ms of the sensor and 100 ms of planning
    assert np.median(times.latency_ms) < 110.0


@pytest.mark.parametrize(("takes_s", "compute_delay_s"), [(0.015, 0.0), (0.03, 0.05), (0.015, 0.05)])
def test_plans_are_late_that_come_after_their_tick_or_keep_the_next_one_waiting(takes_s, compute_delay_s):
    """Within a control period, but after the tick; before the tick, but longer than a control period; neither."""
    clock = SimulatedClock()
    result = run_live(
        clock=clock,
        planner=lambda controller: Late(controller, clock, lambda now: takes_s),
        loop=LoopSettings(compute_delay_s=compute_delay_s),
        duration_s=0.5,
    )
    late = takes_s > compute_delay_s or takes_s > NECK.control_period_s
    assert ("late_plan" in result.events) == late


@pytest.mark.parametrize(("where", "jump_s"), [("asleep", 0.052), ("at work", 0.5)])
def test_ticks_that_are_over_are_left_out_and_nothing_bursts(jump_s, where):
    """As seen by the robot."""
    from_s = 1.0
    clock = Jumping([(from_s, jump_s)] if where == "asleep" else [])
    blocked_s = [jump_s] if where == "at work" else []

    class HeldUp(SimulatedNeck):
        """A neck whose port is blocked once for some time, after a command has gone out."""

        def send_command(self, position_rad):
            sent = super().send_command(position_rad)
            if blocked_s and clock.now_s() >= from_s - 1e-9:
                clock.sleep_until_s(clock.now_s() + blocked_s.pop())
            return sent

    result = run_live(clock=clock, robot_class=HeldUp, duration_s=4.0 + jump_s)
    assert_sound(result)
    n = int(jump_s / TS + 1e-6)
    # A tick more may be done than there is time for, at the same instant.
    assert n - 2 <= result.report.skipped_ticks <= n
    assert result.report.lateness.max_ms == pytest.approx(1e3 * jump_s, abs=5.1)
    sent_s = np.array([now_s for now_s, _ in result.robot.received])
    assert max(np.searchsorted(sent_s, t + 10 * TS - 1e-9) - k for k, t in enumerate(sent_s)) <= 12
    # The grid of the ticks is kept.
    on_time = sent_s[sent_s > from_s + jump_s + 3 * TS]
    assert np.abs(on_time / TS - np.round(on_time / TS)).max() < 1e-6
    assert_recovered(result, from_s + jump_s + 1.9, within_deg=1.0)
