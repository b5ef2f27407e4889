"""On the real clock with the planner in the background: a slow solver holds up no command."""

import threading
import time

import numpy as np
import pytest
from builders.checks import assert_sound
from builders.live import NECK, run_live

from gazempc.controllers.mpc.mpc import Mpc
from gazempc.live.clock import RealClock
from gazempc.loop.planner import BackgroundPlanner


class Hampered(Mpc):
    """Plans slowly, or never, once it is under way."""

    def __init__(self, hamper):
        super().__init__(NECK, horizon_s=0.3)
        self.hamper, self.plans = hamper, 0

    def plan(self, situation):
        self.plans += 1
        if self.plans > 3:
            self.hamper()
        return super().plan(situation)


@pytest.mark.slow
def test_on_the_real_clock_a_slow_solver_holds_up_no_command():
    controller = Hampered(lambda: time.sleep(0.1))
    result = run_live(clock=RealClock(), controller=controller, planner=BackgroundPlanner, duration_s=1.5)
    assert_sound(result)
    assert "late_plan" in result.events
    assert not result.events & {"controller_failed", "solver_failed", "robot_not_answering", "forecast_failed"}
    assert controller.plans > 5
    # Asked within the tick, there would be one tick a plan.
    assert result.report.ticks > 2 * controller.plans
    assert result.report.lateness.count == result.report.ticks
    assert np.ptp(result.joined("command_position_rad")[:, 0]) > 0.01


@pytest.mark.slow
def test_a_controller_that_never_returns_keeps_nobody_waiting():
    released = threading.Event()
    controller = Hampered(lambda: released.wait(240.0))
    # Other tests may have left a planner that nobody closed.
    others = set(threading.enumerate())
    try:
        result = run_live(clock=RealClock(), controller=controller, planner=BackgroundPlanner, duration_s=0.8)
        assert not released.is_set()
        assert controller.plans == 4
    finally:
        released.set()
    assert_sound(result)
    assert {"late_plan", "stale_plan"} <= result.events
    assert result.report.stopped_by == "duration"
    thread = next((t for t in threading.enumerate() if t.name == "planner" and t not in others), None)
    if thread is not None:
        thread.join(120.0)
        assert not thread.is_alive()
