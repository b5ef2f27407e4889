"""Too many observations, and parts that are slow: a tick takes what it has time for, and counts the rest."""

import threading
import time

import numpy as np
import pytest
from builders.live import NECK, make_live_run

from gazempc.live.clock import RealClock
from gazempc.live.sources.source import Arrived
from gazempc.loop.planner import BackgroundPlanner
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import Sighting
from predictors import ConstantVelocity, HeadObservation


class Flood:
    """So many observations at each poll, all new."""

    finished = False

    def __init__(self, clock, each):
        self.clock, self.each, self.last_s = clock, each, 0.0

    def open(self):
        self.last_s = self.clock.now_s()

    def poll(self):
        now_s = self.clock.now_s()
        times_s = np.linspace(self.last_s, now_s, self.each + 1)[1:]
        self.last_s = now_s
        return Arrived(tuple(Sighting(now_s, HeadObservation(float(t), np.array([2.0, 0.1, 0.4]))) for t in times_s))

    def close(self):
        pass


class Slow(ConstantVelocity):
    """Each update takes its time."""

    def update(self, observation):
        until_s = time.perf_counter() + 0.003
        while time.perf_counter() < until_s:
            pass
        super().update(observation)


@pytest.mark.slow
def test_a_tick_begins_no_more_updates_than_it_has_time_for():
    clock, logs = RealClock(), []
    robot = SimulatedNeck(NECK, NECK.rest_rad, clock.now_s)
    source = Flood(clock, 40)
    keep = lambda log, times: logs.append(log)  # noqa: E731
    run = make_live_run(NECK, robot, source, clock, keep, predictor=Slow(), planner=BackgroundPlanner)
    run.run(threading.Event(), 1.0)
    used, refused = run.logs.used, run.logs.refused
    # One update a tick: all of them would take 24 s for each second.
    assert 0 < used <= run.report.ticks
    assert used + sum(refused.values()) == run.report.observations
    assert set(refused) <= {"observations_dropped", "gate_refused", "future_observation", "clock_shifted"}
    # Sixteen wait at most, the newest of them.
    assert refused["observations_dropped"] > 10 * used
    assert np.median(logs[0].arrival_time_s - logs[0].capture_time_s) < 0.05
    assert run.report.ticks > 20
