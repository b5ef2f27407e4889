"""Schedule of looks away, alone and in a replay; limits under any people, policies and looks away."""

from itertools import pairwise

import numpy as np
import pytest
from builders.loop import NECK, TS, make_recorder
from builders.replays import run_info
from builders.standing import standing_together
from hypothesis import given, settings
from hypothesis import strategies as st

from gazempc.controllers.lookahead import LookAhead
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.live.clock import SimulatedClock
from gazempc.loop.attended import AttendedPeople
from gazempc.loop.gaze_loop import GazeLoop
from gazempc.loop.looking_away import LookingAway
from gazempc.loop.planner import ImmediatePlanner
from gazempc.loop.smoother import Smoother
from gazempc.neck.limits import narrowed
from gazempc.neck.spec import load_neck, neck_names
from gazempc.people.attention import Attention
from gazempc.people.aversion import Aversion, fitted, shift_of, with_aversion
from gazempc.people.company import Cues, Glance, Rhythm, Speech, Thinking
from gazempc.people.schedule import RHYTHMS, LookAways
from gazempc.results.attention import measure_attention
from gazempc.results.motion import limit_violations
from gazempc.settings import AttentionSettings, LookAwaySettings, LoopSettings
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import Sighting
from predictors import ConstantVelocity, Forecast, HeadObservation

PERSON_M = np.array([2.5, 0.3, 0.3])


def forecast(times_s):
    count = len(times_s)
    return Forecast(np.asarray(times_s), np.tile(PERSON_M, (count, 1)), np.tile(np.eye(3), (count, 1, 1)), 0.0)


def run_for(look_aways, seconds, from_s=0.0):
    """All looks away planned in some time, polled at the loop's rate."""
    found = {}
    for k in range(int(seconds / 0.02)):
        now_s = from_s + 0.02 * k
        found |= {each.start_s: each for each in look_aways.planned(now_s) if each.start_s <= now_s}
    return [found[start_s] for start_s in sorted(found)]


@pytest.mark.parametrize("mode", ["listening", "speaking"])
def test_durations_and_intervals_are_the_published_ones(mode):
    aways = run_for(LookAways(NECK, mode), 600.0)
    lasts_s = np.array([each.end_s - each.start_s for each in aways])
    every_s = np.diff([each.start_s for each in aways])
    assert lasts_s.mean() == pytest.approx(RHYTHMS[mode].lasts_s[0], rel=0.05)
    assert every_s.mean() == pytest.approx(RHYTHMS[mode].every_s[0], rel=0.05)
    gaps_s = np.array([b.start_s - a.end_s for a, b in pairwise(aways)])
    assert gaps_s.min() >= 0.8 - 1e-9


def test_both_shifts_of_a_look_away_keep_the_limits():
    for name in neck_names():
        neck = load_neck(name)
        shift = shift_of(neck, 0.26, 0.1)
        away = Aversion(1.0, 4.0, 0.26, 0.1, "thinking")
        times_s = np.arange(0.0, 5.0, 0.002)
        means_m = with_aversion(forecast(times_s), away, shift).means_base_m
        pan_rad = np.arctan2(means_m[:, 1], means_m[:, 0])
        limits = neck.command_limits
        assert np.abs(np.gradient(pan_rad, times_s)).max() <= limits.velocity_max_rad_s[0]
        assert np.abs(np.gradient(np.gradient(pan_rad, times_s), times_s)).max() <= limits.acceleration_max_rad_s2[0]


def test_a_glance_is_at_its_target():
    target_m = np.array([1.5, -0.8, -0.3])
    look_aways = LookAways(NECK)
    assert look_aways.glance(0.0, target_m, PERSON_M, 2.0)
    [away] = look_aways.planned(0.0)
    middle_s = 0.5 * (away.start_s + away.end_s)
    composed = look_aways.into(forecast([middle_s]), 0.0)
    np.testing.assert_allclose(composed.means_base_m[0], target_m, atol=1e-9)
    assert away.why == "glance"


def test_the_gaze_stays_averted_until_the_utterance():
    look_aways = LookAways(NECK)
    assert look_aways.speech_starts(10.0, 13.0)
    [away] = look_aways.planned(10.0)
    assert (away.start_s, away.end_s) == pytest.approx((11.97, 13.0))
    assert not look_aways.speech_starts(20.0, 20.3)  # announced too late
    assert look_aways.left_out == 1


def test_infeasible_look_aways_are_reduced_or_omitted():
    slow = load_neck("slow")
    requested = Aversion(0.0, 1.0, 0.26, 0.0, "speaking")
    done = fitted(requested, slow)
    assert 0.1 < done.aside_rad < 0.26
    assert fitted(Aversion(0.0, 0.2, 0.26, 0.0, "speaking"), slow) is None
    assert not LookAways(slow).glance(0.0, np.array([0.0, 2.0, 0.0]), PERSON_M, 0.5)


def test_requests_have_priority_over_the_rhythm_without_overlap():
    look_aways = LookAways(NECK, "listening", 3)
    assert look_aways.think(0.0, 3.0, start_s=2.0)
    assert not look_aways.think(0.0, 1.0, start_s=4.0)
    aways = run_for(look_aways, 60.0)
    assert aways[0].why == "thinking"
    assert all(b.start_s - a.end_s >= 0.8 - 1e-9 for a, b in pairwise(aways))


def test_a_new_rhythm_applies_to_later_look_aways():
    look_aways = LookAways(NECK, "listening")
    run_for(look_aways, 20.0)
    look_aways.set_mode("speaking", 20.0)
    later = run_for(look_aways, 40.0, 20.0)
    assert {each.why for each in later if each.start_s > 23.0} == {"speaking"}
    look_aways.set_mode("told", 60.0)
    assert [each for each in run_for(look_aways, 20.0, 60.0) if each.start_s > 62.0] == []


@pytest.mark.slow
def test_the_gaze_leaves_and_returns_one_dead_time_late():
    scene = standing_together(16.0, [2.5, 0.0, 0.3])
    settings = ReplaySettings(look_away=LookAwaySettings(rhythm="listening"))
    log = replay_scene(scene, "mpc", "constant_velocity", settings).log
    found = measure_attention(log)
    assert found.away_duration_ratio == pytest.approx(1.0, abs=0.05)
    assert abs(found.return_late_s) <= 0.05
    assert found.return_late_p95_s <= 0.1
    assert found.contact_attended > 0.97
    assert found.away_share == pytest.approx(found.away_share_planned, rel=0.1)
    assert limit_violations(log, log.neck) == 0
    assert "target_lost" not in log.event_name


@pytest.mark.parametrize(("rhythm", "speed_max_rad_s"), [("listening", 0.1), ("told", None)])
def test_an_infeasible_look_away_is_omitted_with_an_event(rhythm, speed_max_rad_s):
    """A neck too slow for a small look away, and an utterance announced too late."""
    scene = standing_together(1.6, [2.5, 0.0, 0.3])
    loop = LoopSettings(speed_max_rad_s=speed_max_rad_s)
    look_aways = LookAways(narrowed(scene.neck, None, speed_max_rad_s), rhythm)
    if rhythm == "told":
        assert not look_aways.speech_starts(0.0, 0.2)
    log = replay_scene(scene, "lookahead", "constant_velocity", ReplaySettings(loop=loop), look_aways=look_aways).log
    assert "look_away_left_out" in log.event_name
    assert log.away_start_s.size == 0
    assert limit_violations(log, log.neck) == 0
    assert measure_attention(log).contact_attended > 0.97


# ---------------------------------------------------------------- people and policies drawn at random


SECONDS = 3.0
FROZEN_M, TURNS = np.array([2.0, 0.5, 0.3]), (np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0]))
MPC = Mpc(NECK)


class RandomPolicy:
    """A policy with random scores, exceptions and wrong lengths."""

    def __init__(self, rng):
        self._rng = rng

    def reset(self):
        pass

    def scores(self, company):
        whim = self._rng.random()
        if whim < 0.05:
            raise RuntimeError("no idea")
        if whim < 0.1:
            return [1.0]
        return self._rng.choice([np.nan, np.inf, -1.0, 0.0, 1.0], len(company.people)).tolist()


def seen_at(rng, time_s, places_m, names):
    for k, place_m in enumerate(places_m):
        if k == 0 and 1.5 < time_s < 2.5:
            # The tracker is frozen at one person.
            yield Sighting(time_s, HeadObservation(time_s - 0.066, FROZEN_M, TURNS[rng.integers(2)]))
            continue
        if rng.random() < 0.2:
            continue
        leap_m = 5.0 * rng.standard_normal(3) if rng.random() < 0.02 else 0.02 * rng.standard_normal(3)
        name = names[rng.integers(len(names))] if rng.random() < 0.2 else names[k % len(names)]
        late_s = float(rng.choice([0.0, 0.0, 0.0, 0.1, 0.7, -0.3]))
        yield Sighting(time_s, HeadObservation(time_s - 0.066 - late_s, place_m + leap_m, person_id=name))


@pytest.mark.slow
@settings(max_examples=5)
@given(st.integers(0, 2**20), st.integers(0, 8), st.booleans())
def test_commands_stay_within_limits(seed, people, plans_ahead):
    rng, clock, recorder, cues = np.random.default_rng(seed), SimulatedClock(), make_recorder(), Cues()
    robot = SimulatedNeck(NECK, np.zeros(2), clock.now_s)
    robot.connect()
    attention = Attention(RandomPolicy(rng), AttentionSettings(hysteresis_s=0.05, dwell_s=0.1))
    target = AttendedPeople(ConstantVelocity, attention, LoopSettings())
    away = LookingAway(target, LookAways(NECK, "speaking", seed), cues)
    MPC.reset()
    controller = MPC if plans_ahead else LookAhead(NECK)
    planner = ImmediatePlanner(controller)
    loop = GazeLoop(NECK, away, planner, Smoother(NECK, np.zeros(2)), robot, recorder, LoopSettings())
    places_m = rng.uniform([-3.0, -3.0, -0.5], [4.0, 3.0, 1.0], (people, 3))
    speeds_m_s = rng.uniform(-1.5, 1.5, (people, 3))
    sent = [Thinking(1.0), Speech(1.3), Glance(rng.uniform(-2.0, 2.0, 3), 0.8), Rhythm("listening"), Thinking(0.0)]
    for index in range(int(SECONDS / TS)):
        time_s = index * TS
        clock.sleep_until_s(time_s)
        arrived = []
        if index % 7 == 0:
            arrived = list(seen_at(rng, time_s, places_m + time_s * speeds_m_s, ["a", "b", None]))
        if rng.random() < 0.01:
            cues.put(sent[rng.integers(len(sent))])
        loop.tick(index, time_s, arrived)
    log, _ = recorder.finish(run_info(NECK), lambda times_s: np.full((times_s.size, 3), np.nan))
    assert limit_violations(log, NECK) == 0
    assert np.isfinite(log.command_position_rad).all()
