"""A live run: equality with the replay, late plans, skipped ticks, joined logs."""

import dataclasses
import gc
import itertools

import numpy as np
import pytest
from builders.checks import assert_recovered, assert_sound, undisturbed
from builders.faults import Jittery, Jumping, Late, between
from builders.live import NECK, SENSOR, TS, run_live
from builders.recordings import reordered, synthetic
from builders.replays import replayed

from gazempc.controllers.lookahead import LookAhead
from gazempc.live.clock import RealClock, SimulatedClock
from gazempc.loop.build import Person, make_controller, make_predictor
from gazempc.loop.recorder import LoopRecorder
from gazempc.neck.kinematics import look_at_rad
from gazempc.settings import LoopSettings
from gazempc.sim.replay import ReplaySettings
from gazempc.sim.sensor import observe


def test_on_a_simulated_clock_a_live_run_equals_the_replay():
    placed = reordered(synthetic("subject05_R6"), range(75))
    settings = ReplaySettings()
    replay_log = replayed(placed, settings=settings)
    first_m = observe(placed, SENSOR, 0)[0].observation.head_position_base_m
    live = run_live(
        walk=placed,
        controller=make_controller("mpc", NECK, settings, {}),
        predictor=make_predictor("walker", settings, Person(), {}),
        start_rad=look_at_rad(NECK.geometry, first_m),
        duration_s=None,
    )
    n, m = replay_log.time_s.size, replay_log.capture_time_s.size
    for name in ("time_s", "command_position_rad", "joint_position_rad", "head_true_base_m"):
        np.testing.assert_allclose(live.joined(name)[:n], getattr(replay_log, name), atol=1e-9, rtol=0)
    for name in ("capture_time_s", "arrival_time_s", "head_observed_base_m", "forecast_mean_base_m"):
        np.testing.assert_allclose(live.joined(name)[:m], getattr(replay_log, name), atol=1e-9, rtol=0)
    assert live.joined("event_name").tolist() == replay_log.event_name.tolist()
    # The stop follows.
    assert len(live.joined("time_s")) - n < 0.4 / TS


def test_commands_are_independent_of_clock_jitter():
    """Commands are computed for due times; for actual times most would reach the jerk limit."""
    n = int(3.0 / TS)

    def saturated_share(result):
        acceleration = result.joined("command_acceleration_rad_s2")[:n]
        jerk = np.abs(np.diff(acceleration, axis=0)) / TS
        return float(np.mean(jerk > 0.9 * NECK.command_limits.jerk_max_rad_s3))

    steady, jittery = undisturbed(), run_live(clock=Jittery(), duration_s=3.0)
    assert jittery.report.lateness.max_ms > 1.5
    assert saturated_share(jittery) < saturated_share(steady) + 0.05
    sent, usual = (each.joined("command_position_rad")[:n] for each in (jittery, steady))
    assert np.degrees(np.abs(sent - usual).max()) < 1.0


def test_a_step_of_the_unix_clock_is_in_the_log(monkeypatch):
    clock, asked = RealClock(), itertools.count()
    monkeypatch.setattr(clock, "unix_clock_stepped", lambda: next(asked) == 20)
    result = run_live(clock=clock, duration_s=0.2)
    assert result.event_s("clock_stepped").size == 1
    assert_sound(result)


def test_short_logs_join_to_the_whole_log_and_leave_memory():
    alive, logs = [], []

    def keep(log, times):
        gc.collect()
        alive.append(sum(o.ticks for o in gc.get_objects() if isinstance(o, LoopRecorder)))
        logs.append((log, times))

    def hidden(now_s, sighting):
        return [] if 0.7 <= now_s < 2.0 else [sighting]

    short, whole = (
        run_live(change=hidden, controller=LookAhead(NECK), duration_s=2.3, **more)
        for more in ({"keep": keep, "log_s": 0.5}, {})
    )
    short.logs = logs
    assert len(logs) == -(-short.report.ticks // 50)
    assert all(log.time_s.size == 50 for log, _ in logs[:-1])
    differing = ["run", "faults", "event_time_s", "event_name", "forecast_true_base_m", "forecast_horizon_s"]
    for field in dataclasses.fields(whole.logs[0][0]):
        if field.name not in differing:
            np.testing.assert_array_equal(short.joined(field.name), getattr(whole.logs[0][0], field.name))
    assert short.events == whole.events
    for name in ("update_ms", "step_ms", "latency_ms"):
        assert sum(getattr(times, name).size for _, times in logs) == getattr(whole.logs[0][1], name).size
    # While a log is saved, only its ticks are in memory.
    assert max(alive) <= 100


def test_the_gaze_recovers_after_a_second_of_100_ms_solves():
    """The rest of each late plan is used; the error hardly grows meanwhile, and recovers within 1.2 s."""
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
def test_a_plan_is_late_after_its_tick_or_beyond_a_control_period(takes_s, compute_delay_s):
    """Below a control period but after the tick; above a control period but before the tick; neither."""
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
def test_missed_ticks_are_skipped_without_a_burst(jump_s, where):
    """As seen by the robot."""
    from_s = 1.0
    clock = Jumping([(from_s, jump_s)] if where == "asleep" else [])
    blocked_s = [jump_s] if where == "at work" else []

    def on_send(now_s):
        """The port blocks once."""
        if blocked_s and now_s >= from_s - 1e-9:
            clock.sleep_until_s(now_s + blocked_s.pop())

    result = run_live(clock=clock, on_send=on_send, duration_s=4.0 + jump_s)
    assert_sound(result)
    n = int(jump_s / TS + 1e-6)
    # One more tick may run at the same instant.
    assert n - 2 <= result.report.skipped_ticks <= n
    assert result.report.lateness.max_ms == pytest.approx(1e3 * jump_s, abs=1e3 * TS + 0.1)
    sent_s = np.array([now_s for now_s, _ in result.robot.received])
    assert max(np.searchsorted(sent_s, t + 10 * TS - 1e-9) - k for k, t in enumerate(sent_s)) <= 12
    # Ticks stay on their grid.
    on_time = sent_s[sent_s > from_s + jump_s + 3 * TS]
    assert np.abs(on_time / TS - np.round(on_time / TS)).max() < 1e-6
    assert_recovered(result, from_s + jump_s + 1.9, within_deg=1.0)
