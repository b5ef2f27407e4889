"""Faults to inject into a live run."""

import dataclasses
import sys
import time

import numpy as np

from builders.live import NECK, Faulty
from gazempc.controllers.lookahead import LookAhead
from gazempc.live.clock import SimulatedClock
from gazempc.live.sources.source import Arrived
from gazempc.loop.planner import ImmediatePlanner
from gazempc.types import JointState, Sighting
from predictors import ConstantVelocity, HeadObservation


def between(start_s, stop_s):
    return lambda now_s: start_s <= now_s < stop_s


def answers_badly(kind, state):
    """Raise or return an invalid reading."""
    if isinstance(kind, type):
        raise kind("no answer")
    return {
        "none": None,
        "nan": JointState(state.time_s, state.position_rad * np.nan, state.velocity_rad_s),
        "three joints": JointState(state.time_s, np.zeros(3), np.zeros(3)),
    }[kind]


class Controller(LookAhead):
    """Controller whose plans are modified by `change(plan)`."""

    def __init__(self, change):
        super().__init__(NECK)
        self.change = change

    def plan(self, situation):
        return self.change(super().plan(situation))


class Predictor(ConstantVelocity):
    """Predictor whose forecasts are modified by `change(forecast)`."""

    def __init__(self, change):
        super().__init__()
        self.change = change

    def forecast(self, times_s):
        return self.change(super().forecast(times_s))


def nan_plan(plan):
    return dataclasses.replace(plan, position_rad=plan.position_rad * np.nan)


def wild_plan(plan):
    return dataclasses.replace(plan, position_rad=plan.position_rad + 50.0, velocity_rad_s=plan.velocity_rad_s + 99.0)


class Late(ImmediatePlanner):
    """A planner with a delay between request and answer, on a simulated clock."""

    def __init__(self, controller, clock, delay_s):
        super().__init__(controller)
        self.clock, self.delay_s, self.due_s = clock, delay_s, None

    def request(self, due_index, situate):
        if self.due_s is not None:
            return False
        now_s = self.clock.now_s()
        self.due_s = now_s + self.delay_s(now_s)
        return super().request(due_index, situate)

    def answers(self):
        if self.due_s is None or self.clock.now_s() < self.due_s - 1e-9:
            return []
        self.due_s = None
        return super().answers()


class Jumping(SimulatedClock):
    """A clock with overlong waits, as of a loop that is not scheduled.

    `jumps`: delay by start time, seconds.
    """

    def __init__(self, jumps=()):
        super().__init__()
        self.jumps = list(jumps)

    def sleep_until_s(self, time_s):
        super().sleep_until_s(time_s)
        if self.jumps and self.now_s() >= self.jumps[0][0] - 1e-9:
            super().sleep_until_s(self.now_s() + self.jumps.pop(0)[1])


class Flood(Faulty):
    """Forty observations at each poll, all new."""

    def poll(self):
        now_s = self.clock.now_s()
        times_s = np.linspace(getattr(self, "last_s", self.start_s), now_s, 41)[1:]
        self.last_s = now_s
        return Arrived(tuple(Sighting(now_s, HeadObservation(float(t), np.array([2.0, 0.1, 0.4]))) for t in times_s))


class Slow(ConstantVelocity):
    """Each update is slow."""

    def update(self, observation):
        time.sleep(0.003)
        super().update(observation)


class Jittery(SimulatedClock):
    """Clock with a wake-up latency of 0 to 2 ms."""

    def __init__(self):
        super().__init__()
        self._rng = np.random.default_rng(0)

    def sleep_until_s(self, time_s):
        super().sleep_until_s(time_s + self._rng.uniform(0.0, 0.002))


class Exits(ConstantVelocity):
    """Calls sys.exit once."""

    forecasts = 0

    def forecast(self, times_s):
        self.forecasts += 1
        if self.forecasts == 1:
            sys.exit("bye")
        return super().forecast(times_s)
