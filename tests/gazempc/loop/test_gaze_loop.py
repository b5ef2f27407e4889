"""The loop: order of stages, compute delays, and accepted frames."""

import numpy as np
import pytest
from builders.loop import NECK, TS, LoopBench, error_deg, events
from hypothesis import given, settings
from hypothesis import strategies as st

from gazempc.controllers.controller import Plan
from gazempc.controllers.lookahead import LookAhead
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.results.motion import limit_violations
from gazempc.settings import LoopSettings
from gazempc.types import Sighting
from predictors import HeadObservation


def test_an_undisturbed_run_tracks_and_has_only_start_events():
    log = LoopBench().run(4.0)
    assert events(log) == {"no_observation_yet"}
    assert error_deg(log, from_s=1.5).mean() < 1.37  # 1.19 as measured


def test_a_lost_target_stops_the_gaze_then_returns_to_rest_until_reacquired():
    settings = LoopSettings(lost_after_s=1.0, rest_after_s=2.0, rest_speed_rad_s=0.3)
    log = LoopBench(settings=settings).run(9.0, seen=lambda t: t < 1.5 or t > 7.0)
    assert {"target_lost", "return_to_rest"} <= events(log)
    lost_s = log.event_time_s[list(log.event_name).index("target_lost")]
    assert lost_s == pytest.approx(1.5 + 1.0, abs=0.05)
    stopped = log.command_position_rad[int(3.0 / TS) : int(3.4 / TS), 0]
    assert np.ptp(stopped) == pytest.approx(0, abs=1e-9)
    returning = log.command_position_rad[int(3.6 / TS) : int(7.0 / TS), 0]
    assert np.abs(np.diff(returning)).max() / TS <= 0.3 * (1 + 1e-9)
    assert returning[-1] == pytest.approx(0.0, abs=1e-6)
    assert error_deg(log, from_s=8.3).mean() < 0.28  # 0.24 as measured


def test_a_track_begins_anew_after_a_loss():
    """A person who reappears out of reach of the extrapolated track is observed from the first frame on."""

    def elsewhere_m(time_s):
        return np.array([2.5, 0.8 * time_s if time_s < 1.0 else -4.0, 0.4])

    bench = LoopBench(head_m=elsewhere_m, settings=LoopSettings(lost_after_s=1.0))
    assert "gate_refused" not in events(bench.run(3.0, seen=lambda t: t < 1.0 or t > 2.2))


def test_stale_future_and_out_of_order_frames_are_dropped_with_events():
    aside_m = np.array([2.5, -2.0, 0.4])
    captured_s = {1.5: 1e6, 2.0: 1.0, 2.5: 2.2}
    extra = [Sighting(arrival_s, HeadObservation(at_s, aside_m)) for arrival_s, at_s in captured_s.items()]
    with_faults = LoopBench().run(3.0, extra=extra)
    dropped = {"future_observation", "stale_observation", "out_of_order"}
    assert events(with_faults) == {"no_observation_yet", *dropped}
    assert np.array_equal(with_faults.command_position_rad, LoopBench().run(3.0).command_position_rad)


def test_a_late_frame_does_not_clear_the_frozen_state():
    def walks_then_frozen_m(time_s):
        return np.array([2.5, min(time_s, 1.0) - 0.5, 0.4])

    late = Sighting(1.85, HeadObservation(1.42, np.array([2.5, 0.92, 0.4])))
    log = LoopBench(head_m=walks_then_frozen_m).run(2.5, extra=(late,))
    assert events(log) == {"no_observation_yet", "tracker_frozen", "out_of_order"}


def test_the_controller_gets_committed_commands_and_plans_from_its_start_time():
    """With a compute delay of 30 ms: history, committed commands and the plan's first tick."""
    seen = []

    class Spy(LookAhead):
        def plan(self, situation):
            seen.append((situation.start_s, situation.sent_rad.copy(), situation.committed_rad.copy()))
            plan = super().plan(situation)
            still = np.full_like(plan.position_rad, 1e-3 * len(seen))
            return Plan(plan.start_s, plan.step_s, still, 0 * still, 0 * still)

    bench = LoopBench(controller=Spy(NECK), settings=LoopSettings(compute_delay_s=0.03))
    bench.run(1.0)
    times = np.array([t for t, _ in bench.robot.received])
    commands = np.array([c for _, c in bench.robot.received])
    for start_s, sent, committed in seen[5:40]:
        now = round((start_s - 0.03) / TS)
        assert times[now] == pytest.approx(start_s - 0.03)
        np.testing.assert_array_equal(sent, commands[now - len(sent) : now] if now >= len(sent) else sent)
        np.testing.assert_allclose(sent[-1], commands[now - 1])
        # The committed commands are those of the previous plan; the smoother is within one step of it.
        np.testing.assert_allclose(committed, commands[now : now + 3], atol=1.1e-3)
    # The first plan moves by 1 mrad; the command must start on the tick for which it was made.
    first = round(seen[0][0] / TS)
    assert np.all(commands[:first] == 0)
    assert commands[first, 0] > 0


@pytest.mark.parametrize(("controller", "delay_s"), [(LookAhead, 0.05), (Mpc, 0.015)])
def test_a_plan_is_made_for_its_effective_time(controller, delay_s):
    """A plan delayed by less or more than a control period is computed for its effective time."""
    prompt = LoopBench(controller=controller(NECK)).run(3.0)
    delayed = LoopBench(controller=controller(NECK), settings=LoopSettings(compute_delay_s=delay_s)).run(3.0)
    assert error_deg(delayed, from_s=1.5).mean() < error_deg(prompt, from_s=1.5).mean() + 0.25
    assert not np.array_equal(prompt.command_position_rad, delayed.command_position_rad)


@pytest.mark.slow
@settings(max_examples=3, deadline=None)
@given(nearest_m=st.floats(0.4, 2.0), speed_rad_s=st.floats(0.1, 1.0), rate=st.floats(1.0, 4.0))
def test_a_near_head_limits_joint_speed(nearest_m, speed_rad_s, rate):
    """A person sways fast at 2.5 m, comes near and leaves; near, only braking exceeds the speed limit."""

    def head_m(time_s):
        away_m = 2.5 - (2.5 - nearest_m) * np.clip(min(time_s - 2.0, 6.0 - time_s), 0.0, 1.0)
        return np.array([away_m, 0.4 * away_m * np.sin(rate * time_s), 0.4])

    distance_m = nearest_m + 0.3
    near = LoopSettings(near_speed_max=(distance_m, speed_rad_s))
    log = LoopBench(settings=near, head_m=head_m).run(6.0)
    moved_rad_s = np.abs(np.diff(log.command_position_rad, axis=0)).max(axis=1) / TS
    seen = np.array([np.hypot(*head_m(t - 0.1)[:2]) < distance_m for t in log.time_s[1:]])
    # Braking from the top speed takes v / a + a / j.
    limits = NECK.command_limits
    brake_s = float((limits.velocity_max_rad_s / limits.acceleration_max_rad_s2).max())
    brake_s += float((limits.acceleration_max_rad_s2 / limits.jerk_max_rad_s3).max())
    since = np.argmax(seen) + int((brake_s + 0.1) / TS)
    until = len(seen) - np.argmax(seen[::-1])
    assert since < until
    assert moved_rad_s[since:until].max() <= speed_rad_s * (1 + 1e-6)
    assert limit_violations(log, NECK) == 0
