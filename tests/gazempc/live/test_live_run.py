"""A live run in order: it tracks, it is the replay, and the clock leaves no trace in its commands."""

import dataclasses
import gc

import numpy as np
from builders.checks import assert_sound, undisturbed
from builders.live import NECK, SENSOR, TS, run_live
from builders.recordings import reordered, synthetic
from builders.replays import replayed

from gazempc.controllers.lookahead import LookAhead
from gazempc.live.clock import RealClock, SimulatedClock
from gazempc.loop.build import Person, make_controller, make_predictor
from gazempc.loop.recorder import LoopRecorder
from gazempc.neck.kinematics import look_at_rad
from gazempc.sim.replay import ReplaySettings
from gazempc.sim.sensor import observe


def test_on_a_simulated_clock_a_live_run_is_the_replay():
    placed = reordered(synthetic("subject05_R6"), range(75))
    settings = ReplaySettings()
    wanted = replayed(placed, settings=settings)
    first_m = observe(placed, SENSOR, 0)[0].observation.head_position_base_m
    live = run_live(
        walk=placed,
        controller=make_controller("mpc", NECK, settings, {}),
        predictor=make_predictor("walker", settings, Person(), {}),
        start_rad=look_at_rad(NECK.geometry, first_m),
        duration_s=None,
    )
    n, m = wanted.time_s.size, wanted.capture_time_s.size
    for name in ("time_s", "command_position_rad", "joint_position_rad", "head_true_base_m"):
        np.testing.assert_allclose(live.joined(name)[:n], getattr(wanted, name), atol=1e-9, rtol=0)
    for name in ("capture_time_s", "arrival_time_s", "head_observed_base_m", "forecast_mean_base_m"):
        np.testing.assert_allclose(live.joined(name)[:m], getattr(wanted, name), atol=1e-9, rtol=0)
    assert live.joined("event_name").tolist() == wanted.event_name.tolist()
    # What follows is the stop.
    assert len(live.joined("time_s")) - n < 0.4 / TS


class Jittery(SimulatedClock):
    """Wakes up late by 0 to 2 ms, as a real computer does."""

    def __init__(self):
        super().__init__()
        self._rng = np.random.default_rng(0)

    def sleep_until_s(self, time_s):
        super().sleep_until_s(time_s + self._rng.uniform(0.0, 0.002))


def test_commands_do_not_jitter_with_the_clock():
    """Made for when ticks are due; made for when they are done, most would be a chase at the limit of jerk."""
    n = int(3.0 / TS)

    def hurried(result):
        acceleration = result.joined("command_acceleration_rad_s2")[:n]
        jerk = np.abs(np.diff(acceleration, axis=0)) / TS
        return float(np.mean(jerk > 0.9 * NECK.command_limits.jerk_max_rad_s3))

    steady, jittery = undisturbed(), run_live(clock=Jittery(), duration_s=3.0)
    assert jittery.report.lateness.max_ms > 1.5
    assert hurried(jittery) < hurried(steady) + 0.05
    sent, usual = (each.joined("command_position_rad")[:n] for each in (jittery, steady))
    assert np.degrees(np.abs(sent - usual).max()) < 1.0


def test_a_step_of_the_unix_clock_is_in_the_log(monkeypatch):
    clock = RealClock()
    stepped = []

    def once():
        stepped.append(clock.now_s())
        return len(stepped) == 20

    monkeypatch.setattr(clock, "unix_clock_stepped", once)
    result = run_live(clock=clock, duration_s=0.2)
    assert result.event_s("clock_stepped").size == 1
    assert_sound(result)


def test_short_logs_join_to_the_log_of_the_whole_run_and_nothing_is_kept():
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
    assert len(logs) == -(-short.report.ticks // 100)
    assert all(log.time_s.size == 100 for log, _ in logs[:-1])
    differing = ["run", "faults", "event_time_s", "event_name", "forecast_true_base_m", "forecast_horizon_s"]
    for field in dataclasses.fields(whole.logs[0][0]):
        if field.name not in differing:
            np.testing.assert_array_equal(short.joined(field.name), getattr(whole.logs[0][0], field.name))
    assert short.events == whole.events
    for name in ("update_ms", "step_ms", "latency_ms"):
        assert sum(getattr(times, name).size for _, times in logs) == getattr(whole.logs[0][1], name).size
    # While one log is being kept no more than its own ticks are in memory.
    assert max(alive) <= 100
