"""Any sequence of faults: always commands within limits, and everything is closed."""

import dataclasses

import numpy as np
import pytest
from builders.checks import assert_within_limits
from builders.faults import Controller, Jumping, Late, Predictor, answers_badly, nan_plan, wild_plan
from builders.live import NECK, WALK, run_live
from hypothesis import given, settings
from hypothesis import strategies as st

from gazempc.controllers.controller import SolverFailed
from gazempc.neck.kinematics import look_at_rad
from gazempc.types import Sighting

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
def test_any_sequence_of_faults_is_survived_within_limits(faults):
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
            raise SolverFailed("made to fail")
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
