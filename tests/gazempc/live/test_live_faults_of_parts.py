"""Any return value or exception of parts, in any sequence: events, commands within limits, a loadable log."""

import dataclasses
import threading
import time

import numpy as np
import pytest
from builders.checks import assert_sound, assert_within_limits
from builders.faults import Controller, Jumping, Late, Predictor, answers_badly, between, nan_plan, wild_plan
from builders.live import NECK, WALK, run_live
from hypothesis import given, settings
from hypothesis import strategies as st

from gazempc.controllers.controller import ControllerError
from gazempc.live.clock import RealClock, SimulatedClock
from gazempc.loop.planner import BackgroundPlanner
from gazempc.loop.recorder import LoopRecorder
from gazempc.neck.kinematics import look_at_rad
from gazempc.results.log_files import load_log
from gazempc.types import JointState, Sighting
from predictors import ConstantVelocity


def test_out_of_range_plans_and_drifting_readings_are_events_and_the_run_continues(tmp_path):
    """`test_live_own_parts` tests every kind of `benchmarks.faults.wrongs`."""
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


def test_a_program_error_leaves_a_loadable_log(tmp_path, monkeypatch):
    """The true joints of the failed tick are omitted."""
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
    """In the warm-up, which is not logged."""
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
def test_a_blocking_part_delays_no_command(named):
    clock, blocks, polled_s = RealClock(), [BLOCKED_S], []

    def block(part, answer=None):
        if part in named and polled_s and clock.now_s() > polled_s[0] + 0.4 and blocks:  # not in the warm-up
            time.sleep(blocks.pop())
        return answer

    result = run_live(
        clock=clock,
        duration_s=1.0,
        planner=BackgroundPlanner,
        controller=Controller(lambda plan: block("plan", plan)),
        on_read=lambda now_s, state: block("read_state", state),
        on_poll=lambda now_s: block("poll", polled_s.append(now_s)),
    )
    assert_within_limits(result.joined("command_position_rad"), ends=True)
    (fault,) = (fault for fault in result.logs[0][0].faults if fault.event == "part_slow")
    assert named in fault.error
    assert float(fault.error.split(" took ")[1].split()[0]) > 0.6 * BLOCKED_S
    # One command is due every 5 ms.
    assert np.diff([now for now, _ in result.robot.received]).max() < 0.5 * BLOCKED_S


@pytest.mark.slow
def test_a_hanging_controller_does_not_delay_the_end_of_the_run():
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


KINDS = (
    "silent", "stale", "future", "past", "doubled", "nan observation", "read raises", "read nan", "send raises",
    "send nan", "solver fails", "nan plan", "wild plan", "late plan", "predictor raises", "asleep",
)  # fmt: skip


@pytest.mark.slow
@settings(max_examples=10)
@given(
    faults=st.lists(
        st.tuples(st.sampled_from(KINDS), st.floats(0.0, 1.8), st.floats(0.01, 1.0)), min_size=1, max_size=6
    )
)
def test_commands_stay_within_limits_for_any_sequence_of_faults(faults):
    def on(kind, now_s):
        return any(kind == k and start <= now_s < start + length for k, start, length in faults)

    clock = Jumping(sorted((start, length / 3) for kind, start, length in faults if kind == "asleep"))

    def change(now_s, sighting):
        seen = sighting.observation
        shift_s = 3.0 * (on("future", now_s) - on("past", now_s)) - 0.8 * on("stale", now_s)
        moved = Sighting(sighting.arrival_s, dataclasses.replace(seen, capture_time_s=seen.capture_time_s + shift_s))
        if on("nan observation", now_s):
            object.__setattr__(moved.observation, "head_position_base_m", np.full(3, np.nan))
        return [] if on("silent", now_s) else [moved] * (1 + on("doubled", now_s))

    def on_read(now_s, state):
        if on("read raises", now_s):
            raise TimeoutError
        return answers_badly("nan", state) if on("read nan", now_s) else state

    silent, got_through = [], []

    def on_send(now_s):
        raises, nan = on("send raises", now_s), on("send nan", now_s)
        (silent if raises or nan else got_through).append(len(got_through))
        if raises:
            raise OSError("no answer")
        return (np.full(2, np.nan),) if nan else None

    def planned(plan):
        if on("solver fails", plan.start_s):
            raise ControllerError("made to fail", "solver_failed")
        changes = {"nan plan": nan_plan, "wild plan": wild_plan}
        return next((change(plan) for kind, change in changes.items() if on(kind, plan.start_s)), plan)

    def forecast(answer):
        if on("predictor raises", clock.now_s()):
            raise np.linalg.LinAlgError("made to fail")
        return answer

    result = run_live(
        clock=clock,
        change=change,
        on_read=on_read,
        on_send=on_send,
        controller=Controller(planned),
        predictor=Predictor(forecast),
        planner=lambda controller: Late(controller, clock, lambda now: 0.1 if on("late plan", now) else 0.0),
        duration_s=2.0,
    )
    received = np.array([p for _, p in result.robot.received])
    breaks = sorted({k for k in silent if k < len(received)})
    start_rad = look_at_rad(NECK.geometry, WALK.truth.head_position_m[0])
    assert_within_limits(received, start_rad, breaks=breaks, ends=len(received) not in silent, rests=False)
    assert len(result.joined("command_position_rad")) == result.report.ticks
    assert result.robot.calls[-1] == result.source.calls[-1] == "close"
