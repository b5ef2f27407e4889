"""Faults of predictor, controller and solver: they fail, they are late, they answer nonsense."""

import numpy as np
import pytest
from builders.checks import assert_recovered, assert_sound, undisturbed
from builders.faults import Late, between, nan_plan, raising
from builders.live import NECK, run_live

from gazempc.controllers.controller import ControllerError, SolverFailed
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.live.clock import SimulatedClock
from gazempc.settings import LoopSettings
from predictors import ConstantVelocity


class Sabotaged(Mpc):
    """An MPC that does something else for a while."""

    def __init__(self, instead, start_s, stop_s):
        super().__init__(NECK, horizon_s=0.3)
        self.instead, self.start_s, self.stop_s = instead, start_s, stop_s

    def plan(self, situation):
        plan = super().plan(situation)
        return self.instead(plan) if self.start_s <= situation.start_s < self.stop_s else plan


@pytest.mark.parametrize(
    ("instead", "event"),
    [
        (raising(ControllerError), "controller_failed"),
        (raising(SolverFailed), "solver_failed"),
        (nan_plan, "plan_not_finite"),
    ],
)
def test_a_solver_that_fails_for_a_second(instead, event):
    """The rest of the last plan (0.3 s), then a stop; the gaze is back 1.4 s after the end."""
    result = run_live(controller=Sabotaged(instead, 2.0, 3.0))
    assert_sound(result)
    assert result.events == {"no_observation_yet", event, "stale_plan"}
    now, sent = result.joined("time_s"), result.joined("command_position_rad")
    usual = undisturbed().joined("command_position_rad")[: now.size]
    bridged = (now >= 2.0) & (now < 2.06)
    assert sent[bridged] == pytest.approx(usual[bridged], abs=np.deg2rad(0.5))
    assert np.abs(np.diff(sent[(now >= 2.0) & (now < 2.2)], axis=0)).max(axis=1).min() > 1e-5
    standing = sent[(now >= 2.75) & (now < 3.0)]
    assert np.ptp(standing, axis=0) == pytest.approx([0, 0], abs=1e-9)
    assert_recovered(result, 3.0 + 1.4)


def test_a_solver_that_takes_100_ms_for_a_second():
    """What is left of each late plan is used; the gaze is hardly worse meanwhile, and as ever 1.2 s after."""
    clock = SimulatedClock()
    slow = between(2.0, 3.0)
    result = run_live(
        clock=clock, planner=lambda controller: Late(controller, clock, lambda now: 0.1 if slow(now) else 0.0)
    )
    assert_sound(result)
    assert result.events == {"no_observation_yet", "late_plan"}
    now = result.joined("time_s")
    during = (now >= 2.0) & (now < 4.0)
    assert np.max(np.abs(result.error_deg[during] - undisturbed().error_deg[: now.size][during])) < 3.1  # 2.7
    assert_recovered(result, 3.0 + 1.2)
    times = result.logs[0][1]
    assert times.latency_ms.max() > 150.0  # 66 ms of the sensor and 100 ms of planning
    assert np.median(times.latency_ms) < 110.0


@pytest.mark.parametrize(("takes_s", "compute_delay_s"), [(0.015, 0.0), (0.03, 0.05), (0.0, 0.0), (0.015, 0.05)])
def test_plans_are_late_that_come_after_their_tick_or_keep_the_next_one_waiting(takes_s, compute_delay_s):
    """Within a control period, but after the tick; before the tick, but longer than a control period; neither."""
    clock = SimulatedClock()
    result = run_live(
        clock=clock,
        planner=lambda controller: Late(controller, clock, lambda now: takes_s),
        loop=LoopSettings(compute_delay_s=compute_delay_s),
        duration_s=1.5,
    )
    assert_sound(result)
    late = takes_s > compute_delay_s or takes_s > NECK.control_period_s
    assert ("late_plan" in result.events) == late


@pytest.mark.parametrize("method", ["update", "forecast"])
def test_a_predictor_that_raises(method):
    class Raising(ConstantVelocity):
        now_s = 0.0

        def update(self, observation):
            self.now_s = observation.capture_time_s
            if method == "update" and 2.0 <= self.now_s < 2.5:
                raise RuntimeError("made to fail")
            super().update(observation)

        def forecast(self, times_s):
            if method == "forecast" and 2.0 <= self.now_s < 2.5:
                raise RuntimeError("made to fail")
            return super().forecast(times_s)

    result = run_live(predictor=Raising())
    assert_sound(result)
    assert "forecast_failed" in result.events
    assert_recovered(result, 2.5 + 1.2)
