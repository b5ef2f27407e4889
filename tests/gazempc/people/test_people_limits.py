"""Whatever people and policies do, commands stay within limits: the loop with people and policies drawn at random."""

import numpy as np
import pytest
from builders.loop import NECK, TS, make_recorder
from builders.replays import run_info
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
from gazempc.people.attention import Attention
from gazempc.people.company import Cues, Glance, Rhythm, Speech, Thinking
from gazempc.people.schedule import LookAways
from gazempc.results.motion import limit_violations
from gazempc.settings import AttentionSettings, LoopSettings
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import Sighting
from predictors import ConstantVelocity, HeadObservation

SECONDS = 3.0
FROZEN_M, TURNS = np.array([2.0, 0.5, 0.3]), (np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0]))
MPC = Mpc(NECK)


class Whim:
    """Scores at random, raises at times, and returns wrong lengths."""

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
            # The tracker stands frozen at one of them.
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
    attention = Attention(Whim(rng), AttentionSettings(hysteresis_s=0.05, dwell_s=0.1))
    target = AttendedPeople(ConstantVelocity, attention, LoopSettings())
    away = LookingAway(target, LookAways(NECK, "speaking", seed), cues)
    MPC.reset()
    controller = MPC if plans_ahead else LookAhead(NECK)
    planner = ImmediatePlanner(controller)
    loop = GazeLoop(NECK, away, planner, Smoother(NECK, np.zeros(2)), robot, recorder, LoopSettings())
    places_m = rng.uniform([-3.0, -3.0, -0.5], [4.0, 3.0, 1.0], (people, 3))
    speeds_m_s = rng.uniform(-1.5, 1.5, (people, 3))
    told = [Thinking(1.0), Speech(1.3), Glance(rng.uniform(-2.0, 2.0, 3), 0.8), Rhythm("listening"), Thinking(-1.0)]
    for index in range(int(SECONDS / TS)):
        time_s = index * TS
        clock.sleep_until_s(time_s)
        arrived = []
        if index % 7 == 0:
            arrived = list(seen_at(rng, time_s, places_m + time_s * speeds_m_s, ["a", "b", None]))
        if rng.random() < 0.01:
            cues.put(told[rng.integers(len(told))])
        loop.tick(index, time_s, arrived)
    log, _ = recorder.finish(run_info(NECK), lambda times_s: np.full((times_s.size, 3), np.nan))
    assert limit_violations(log, NECK) == 0
    assert np.isfinite(log.command_position_rad).all()
