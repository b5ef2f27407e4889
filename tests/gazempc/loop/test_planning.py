"""Requests and answers of the loop: computing times."""

import time

import numpy as np
from builders.loop import NECK, TS, LoopBench, make_loop, make_recorder
from builders.replays import run_info

from gazempc.controllers.reactive import Reactive
from gazempc.types import Sighting
from predictors import ConstantVelocity, HeadObservation

SLOW_S = 0.03


class SlowLater(ConstantVelocity):
    """Forecasts for a plan are slow from the second one on."""

    plans = 0

    def forecast(self, times_s):
        if np.size(times_s) > 3:
            self.plans += 1
            if self.plans > 1:
                time.sleep(SLOW_S)
        return super().forecast(times_s)


def test_the_computing_time_of_a_plan_is_that_of_its_own_forecast():
    predictor, recorder, controller = SlowLater(), make_recorder(), Reactive(NECK)
    controller.forecast_times_s = lambda start_s, newest_s: start_s + 0.01 * np.arange(8)
    controller.plan = lambda situation: Reactive(NECK).plan(situation)
    bench = LoopBench()
    loop = make_loop(bench.robot, recorder, controller, predictor)
    seen = Sighting(0.0, HeadObservation(0.0, np.array([2.5, 0.0, 0.4])))
    for index in range(2 * NECK.servo_ticks_per_plan):
        bench.clock.sleep_until_s(index * TS)
        loop.tick(index, index * TS, [seen] if index == 0 else [])
    assert predictor.plans == 2
    _, times = recorder.finish(run_info(NECK), lambda times_s: np.full((times_s.size, 3), np.nan))
    assert times.step_ms[0] < 1e3 * SLOW_S <= times.step_ms[1]
