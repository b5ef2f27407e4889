"""Faults of the source: exceptions, and invalid observations, names and orientations."""

import dataclasses
import itertools

import numpy as np
import pytest
from builders.checks import assert_recovered, assert_same_commands, assert_sound
from builders.faults import Flood, Slow
from builders.live import NECK, TS, Faulty, live_setup, run_live

from gazempc.live.arrivals import Arrivals
from gazempc.live.clock import RealClock, SimulatedClock
from gazempc.live.logs import LiveReport
from gazempc.live.sources.source import Notice
from gazempc.loop.attended import AttendedPeople
from gazempc.loop.events import Event
from gazempc.loop.looking_away import LookingAway
from gazempc.loop.planner import BackgroundPlanner
from gazempc.loop.recorder import LoopRecorder
from gazempc.people.attention import Attention
from gazempc.people.policies import Nearest
from gazempc.people.schedule import LookAways
from gazempc.settings import AttentionSettings, LoopSettings
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import Sighting
from predictors import ConstantVelocity


def test_an_observation_with_nan_a_bad_quaternion_or_a_head_at_the_sensor_is_refused():
    """Bypasses the checks of `HeadObservation`, as a source in another language might."""
    heads = [("head_position_base_m", np.full(3, value)) for value in (np.nan, 0.005)]
    others = [("pelvis_quat_wxyz", np.zeros(4)), ("position_covariance_m2", np.zeros((3, 3)))]
    wrong = itertools.cycle([*heads, *others])

    def spoilt(now_s, sighting):
        if not 0.5 <= now_s < 1.0:
            return [sighting]
        seen, (field, value) = dataclasses.replace(sighting.observation), next(wrong)
        object.__setattr__(seen, field, value)
        return [Sighting(sighting.arrival_s, seen)]

    result = run_live(change=spoilt, duration_s=3.3)
    assert_sound(result)
    assert result.events == {"no_observation_yet", "bad_observation"}
    assert len(result.report.problems) == result.refused["bad_observation"] > 10
    assert_recovered(result, 1.0 + 1.2)


def test_a_raising_source_is_retried_after_braking_and_stale_frames_are_dropped():
    """The exception is logged once with its traceback. Then the source delivers its backlog."""
    to_s = 3.5

    def on_poll(now_s):
        if 1.0 <= now_s < to_s:
            raise ConnectionError("the tracker is gone")

    result = run_live(on_poll=on_poll, duration_s=6.5)
    assert_sound(result)
    lost = {"target_lost", "stale_observation", "observations_dropped"}
    assert result.events == {"no_observation_yet", "source_failed", *lost}
    # An event is recorded once, at its start, for any number of frames.
    assert result.event_s("stale_observation").size == 1
    assert result.event_s("source_failed") == pytest.approx([1.0], abs=TS)
    (fault,) = result.logs[0][0].faults
    assert (fault.event, fault.error) == ("source_failed", "ConnectionError: the tracker is gone (Faulty.poll())")
    assert "in on_poll" in fault.traceback
    assert fault.count == pytest.approx((to_s - 1.0) / TS, abs=2)
    now = result.joined("time_s")
    braked = result.joined("command_velocity_rad_s")[(now > 2.8) & (now < to_s)]
    assert np.abs(braked).max() < 1e-9
    lag_s = result.joined("arrival_time_s") - result.joined("capture_time_s")
    assert lag_s.max() <= 0.5
    assert (lag_s > 0.1).sum() > 10  # its recent frames were used
    assert_recovered(result, to_s + 1.9, within_deg=1.0)


def test_a_fast_clock_is_an_event_and_refused_senders_are_reported_every_10_s(caplog):
    def ahead(now_s, sighting):
        seen = sighting.observation
        return [Sighting(sighting.arrival_s, dataclasses.replace(seen, capture_time_s=seen.capture_time_s + 0.2))]

    class Contested(Faulty):
        def poll(self):
            refused = Notice(Event.SENDER_REFUSED, f"a stranger at {self.clock.now_s():.0f} s")
            return dataclasses.replace(super().poll(), notices=(refused,))

    clock, report, recorder = SimulatedClock(), LiveReport(), LoopRecorder(NECK.control_period_s)
    source = Contested(clock, ahead)
    source.open()
    arrivals = Arrivals(live_setup(NECK, SimulatedNeck(NECK, np.zeros(2), clock.now_s), source, clock), report)
    for frame in range(301):
        clock.sleep_until_s(frame / 30)
        list(arrivals.take(clock.now_s(), recorder))
    messages = [record.getMessage() for record in caplog.records if "stranger" in record.getMessage()]
    assert messages == [f"sender_refused: a stranger at {k} s" for k in (0, 10)]
    assert recorder.refusals["sender_refused"] == 301
    assert {text.partition(":")[0] for text in report.warnings} == {"sender_refused", "clock_shifted", "wrong_clock"}
    assert [recorder.events.count(name) for name in ("clock_shifted", "wrong_clock")] == [1, 1]


@pytest.mark.slow
def test_updates_per_tick_are_bounded_by_its_duration():
    clock = RealClock()
    result = run_live(
        clock=clock, source=Flood(clock), predictor=Slow(), planner=BackgroundPlanner, start_rad=NECK.rest_rad,
        duration_s=0.6,
    )  # fmt: skip
    # One update a tick: all of them would take 24 s for each second.
    assert 0 < result.used <= result.report.ticks
    assert result.used + sum(result.refused.values()) == result.report.observations
    assert set(result.refused) <= {"observations_dropped", "gate_refused", "future_observation", "clock_shifted"}
    # Sixteen wait at most, the newest of them.
    assert result.refused["observations_dropped"] > 10 * result.used
    assert np.median(result.joined("arrival_time_s") - result.joined("capture_time_s")) < 0.05
    assert result.report.ticks > 20


def test_changing_names_and_orientations_remain_one_person():
    frames = itertools.count()

    def change(now_s, sighting):
        seen = dataclasses.replace(sighting.observation, person_id=f"track {now_s:.3f}")
        if next(frames) % 2:
            # The quaternion (0, 0, 0, 1) times it: half a turn about the vertical.
            half_turn = np.array([[0, 0, 0, -1], [0, 0, -1, 0], [0, 1, 0, 0], [1, 0, 0, 0]])
            turned = {name: half_turn @ getattr(seen, name) for name in ("head_quat_wxyz", "pelvis_quat_wxyz")}
            seen = dataclasses.replace(seen, **turned)
        return [Sighting(sighting.arrival_s, seen)]

    result = run_live(change=change, duration_s=2.5)
    assert_sound(result)
    assert result.events == {"no_observation_yet", "new_id_each_frame", "orientation_jumped"}
    assert result.event_s("orientation_jumped").size == 1
    assert_same_commands(result, within_rad=1e-12)
    ids = result.joined("person_id")
    assert len(set(ids)) == len(ids) > 60


def test_entering_leaving_and_renamed_people_are_events():
    """Beside the walker: a second person from 1.0 to 2.5 s, and again from 4.0 s."""

    def change(now_s, sighting):
        seen = sighting.observation
        people_m = [(seen.head_position_base_m, "a" if now_s < 3.0 else "c")]
        if 2.0 <= now_s < 2.2:
            people_m.append((people_m[0][0] + [0.1, 0.0, 0.0], "body"))
        if 1.0 <= now_s < 2.5 or now_s >= 4.0:
            people_m.append((np.array([4.0, 2.5, 0.3]), "b"))
        observed = [dataclasses.replace(seen, head_position_base_m=at_m, person_id=name) for at_m, name in people_m]
        return [Sighting(sighting.arrival_s, each) for each in observed]

    attended = AttendedPeople(ConstantVelocity, Attention(Nearest(), AttentionSettings()), LoopSettings())
    several = LookingAway(attended, LookAways(NECK, "told", 0))
    result = run_live(change=change, several=several, duration_s=4.5)
    assert_sound(result)
    began_s = {name: result.event_s(name).tolist() for name in result.events}
    delay_s = 0.2
    assert began_s["person_entered"][1:] == pytest.approx([1.0], abs=delay_s)
    assert began_s["seen_twice"] == pytest.approx([2.0], abs=delay_s)
    assert began_s["person_renamed"] == pytest.approx([3.0], abs=delay_s)
    assert began_s["person_returned"] == pytest.approx([4.0], abs=delay_s)
    assert len(began_s["attention_switched"]) == 1
    # Observations of other people, or before confirmation of a track.
    assert result.refused["another_person"] == pytest.approx(30 * (1.5 + 0.5), abs=8)
    assert result.refused["seen_twice"] == pytest.approx(6, abs=1)
    assert set(result.refused) == {"another_person", "seen_twice"}
    assert set(result.joined("person_id")) == {"a", "c"}
