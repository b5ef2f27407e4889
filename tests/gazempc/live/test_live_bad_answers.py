"""Whatever a part returns or raises in a run: an event that names its class, a run that goes on, a log that loads."""

import dataclasses
import sys
import threading
import time

import numpy as np
import pytest
from builders.checks import assert_sound, assert_within_limits
from builders.faults import Controller, Predictor, nan_plan, wild_plan
from builders.live import Faulty, run_live

from gazempc.live.clock import RealClock, SimulatedClock
from gazempc.live.sources.source import Arrived
from gazempc.loop.planner import BackgroundPlanner
from gazempc.loop.recorder import LoopRecorder
from gazempc.results.log_files import load_log
from gazempc.types import JointState
from predictors import ConstantVelocity


class Source(Faulty):
    def __init__(self, clock, change):
        super().__init__(clock)
        self.poll_change = change

    def poll(self):
        return self.poll_change(super().poll())


# Every kind of `benchmarks.faults.wrongs` is tried in `test_live_own_parts`; these are of one event each.
INSTEAD = {
    "controller_failed": ("Controller.plan()", lambda plan: sys.exit("leaving")),
    "plan_not_finite": ("Controller.plan()", nan_plan),
    "plan_out_of_range": ("Controller.plan()", wild_plan),
    "forecast_failed": ("Predictor.forecast()", lambda f: dataclasses.replace(f, means_base_m=f.means_base_m * np.nan)),
    "source_failed": ("Source.poll()", lambda a: Arrived(None)),
    "robot_not_answering": ("Spied", lambda s: JointState(s.time_s, np.array(["a", "b"]), s.velocity_rad_s)),
    "joint_reading_refused": ("Spied", lambda s: JointState(s.time_s, s.position_rad, s.velocity_rad_s + 1e9)),
    "joint_off_command": (
        "Spied",
        lambda s: JointState(s.time_s, s.position_rad + 0.5 * (s.time_s - DRIFTS_FROM_S), s.velocity_rad_s),
    ),
}
FROM_S, EACH_S = 0.6, 0.5
DRIFTS_FROM_S = FROM_S + EACH_S * (len(INSTEAD) - 1)


def test_what_a_part_answers_is_refused_by_name_and_the_run_goes_on(tmp_path):
    """Half a second of each, one after the other, and more than a second of the drift of the joints."""
    clock = SimulatedClock()

    def change(part):
        def changed(answer):
            if clock.now_s() < FROM_S:
                return answer
            kind = min(int((clock.now_s() - FROM_S) / EACH_S), len(INSTEAD) - 1)
            named, instead = list(INSTEAD.values())[kind]
            return instead(answer) if named.startswith(part) else answer

        return changed

    robot = change("Spied")
    result = run_live(
        clock=clock,
        duration_s=DRIFTS_FROM_S + 1.2,
        controller=Controller(change("Controller")),
        predictor=Predictor(change("Predictor")),
        source=Source(clock, change("Source")),
        on_read=lambda now_s, state: robot(state),
    )
    assert_sound(result)
    assert result.report.stopped_by == "duration"
    log = result.logs[0][0]
    faults = {fault.event: fault for fault in log.faults}
    assert set(faults) == set(INSTEAD)
    for event, (named, _) in INSTEAD.items():
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
