"""On the real clock with the planner in the background: a slow solver holds up no command."""

import threading

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
