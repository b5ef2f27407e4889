"""Whatever a part returns or raises in a run: an event that names its class, a run that goes on, a log that loads."""

import threading
import time

import numpy as np
import pytest
from builders.checks import assert_sound, assert_within_limits
from builders.faults import Controller, between, wild_plan
from builders.live import run_live

from gazempc.live.clock import RealClock, SimulatedClock
from gazempc.loop.planner import BackgroundPlanner
from gazempc.loop.recorder import LoopRecorder
from gazempc.results.log_files import load_log
from gazempc.types import JointState
from predictors import ConstantVelocity


def test_a_plan_out_of_range_and_joints_that_drift_off_are_named_and_the_run_goes_on(tmp_path):
    """Every kind of `benchmarks.faults.wrongs` is tried in `test_live_own_parts`, also of these parts."""
    clock, drifts_from_s = SimulatedClock(), 1.1
    wild = between(0.6, drifts_from_s)

    def drifting(now_s, state):
        off_rad = 0.5 * max(now_s - drifts_from_s, 0.0)
        return JointState(state.time_s, state.position_rad + off_rad, state.velocity_rad_s)

    controller = Controller(lambda plan: wild_plan(plan) if wild(clock.now_s()) else plan)
    result = run_live(clock=clock, duration_s=drifts_from_s + 1.2, controller=controller, on_read=drifting)
    assert_sound(result)
    log = result.logs[0][0]
    faults = {fault.event: fault for fault in log.faults}
    assert set(faults) == {"plan_out_of_range", "joint_off_command"}
    for event, named in (("plan_out_of_range", "Controller.plan()"), ("joint_off_command", "Spied")):
        assert named in faults[event].error
        assert faults[event].count > 3
    log.save(tmp_path / "log.npz")
    assert load_log(tmp_path / "log.npz").time_s.size == result.report.ticks


def test_a_fault_of_the_program_keeps_a_log_that_loads(tmp_path, monkeypatch):
    """The true joints of the tick that failed are left out."""
    tick, raised = LoopRecorder.tick, []

    def fails_once(self, time_s, *values):
        if time_s > 0.5 and not raised:
            raised.append(time_s)
            raise RuntimeError("a fault of the program")
        tick(self, time_s, *values)

    monkeypatch.setattr(LoopRecorder, "tick", fails_once)
    with pytest.raises(RuntimeError, match="a fault of the program") as ended:
        run_live(duration_s=1.0)
    log = ended.value.result.logs[0][0]
    log.save(tmp_path / "log.npz")
    assert load_log(tmp_path / "log.npz").time_s[-1] == pytest.approx(0.5, abs=0.02)


def test_a_failure_before_the_first_tick_does_not_end_the_run():
    """In the warm-up, which is no part of the log."""
    failures = [KeyError("once"), KeyError("once")]

    def plan(answer):
        if len(failures) == 1:
            raise failures.pop()
        return answer

    class FailsOnce(ConstantVelocity):
        def update(self, observation):
            if len(failures) == 2:
                raise failures.pop()
            super().update(observation)

    result = run_live(duration_s=0.5, controller=Controller(plan), predictor=FailsOnce())
    assert (failures, result.events) == ([], {"no_observation_yet"})


BLOCKED_S = 0.4


@pytest.mark.slow
@pytest.mark.parametrize("named", ["Controller.plan()", "Spied.read_state()", "Faulty.poll()"])
def test_a_part_that_blocks_holds_up_no_command(named):
    clock, blocks = RealClock(), [BLOCKED_S]

    def block(part, answer=None):
        if part in named and clock.now_s() > 0.4 and blocks:
            time.sleep(blocks.pop())
        return answer

    result = run_live(
        clock=clock,
        duration_s=1.0,
        planner=BackgroundPlanner,
        controller=Controller(lambda plan: block("plan", plan)),
        on_read=lambda now_s, state: block("read_state", state),
        on_poll=lambda now_s: block("poll"),
    )
    assert_within_limits(result.joined("command_position_rad"), ends=True)
    (fault,) = (fault for fault in result.logs[0][0].faults if fault.event == "part_slow")
    assert named in fault.error
    assert float(fault.error.split(" took ")[1].split()[0]) > 0.6 * BLOCKED_S
    # One command is due every 5 ms.
    assert np.diff([now for now, _ in result.robot.received]).max() < 0.5 * BLOCKED_S


@pytest.mark.slow
def test_a_controller_that_never_returns_does_not_hold_up_the_end_of_the_run():
    released, plans = threading.Event(), []

    def hang(plan):
        plans.append(plan)
        if len(plans) > 3:
            released.wait(240.0)
        return plan

    try:
        result = run_live(clock=RealClock(), controller=Controller(hang), planner=BackgroundPlanner, duration_s=0.8)
        assert len(plans) == 4
    finally:
        released.set()
    assert_sound(result)
    assert {"late_plan", "stale_plan"} <= result.events
    assert result.report.stopped_by == "duration"
