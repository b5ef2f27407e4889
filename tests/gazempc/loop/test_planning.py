"""Plans of the loop: requests, answers, computing times, committed commands, and answers after a restart."""

import threading
import time
from collections import deque

import numpy as np
import pytest
from builders.loop import NECK, TS, LoopBench, make_loop, make_recorder
from builders.replays import run_info
from builders.waiting import wait_for

from gazempc.controllers.controller import ControllerError
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.controllers.reactive import Reactive
from gazempc.loop.gaze_loop import GazeLoop
from gazempc.loop.planner import Answer, BackgroundPlanner, ImmediatePlanner
from gazempc.loop.recorder import LoopRecorder
from gazempc.loop.smoother import Smoother
from gazempc.loop.track import PersonTrack
from gazempc.results.moments import PlanMoment
from gazempc.settings import LoopSettings
from gazempc.types import Sighting
from predictors import ConstantVelocity, HeadObservation


def test_the_background_planner_has_one_pending_request_and_answers_all():
    gate = threading.Semaphore(0)

    class Gated:
        def plan(self, situation):
            gate.acquire()
            if situation == "fail":
                raise ControllerError("made to fail", "solver_failed")
            raise ZeroDivisionError

    planner = BackgroundPlanner(Gated())

    assert planner.answers() == []
    for index, (situation, event) in enumerate([("fail", "solver_failed"), ("bug", "controller_failed")]):
        assert planner.request(index, lambda situation=situation: situation)
        assert not planner.request(99, lambda: None)
        gate.release()
        (answer,) = wait_for(planner.answers)
        assert isinstance(answer, Answer)
        assert (answer.due_index, answer.plan, answer.event) == (index, None, event)
        assert answer.plan_ms >= 0
    planner.close()
    planner.close()


SLOW_S = 0.03


class SlowLater(ConstantVelocity):
    """Forecasts are slow from the second plan on."""

    plans = 0

    def forecast(self, times_s):
        if np.size(times_s) > 3:
            self.plans += 1
            if self.plans > 1:
                time.sleep(SLOW_S)
        return super().forecast(times_s)


def test_the_computing_time_of_a_plan_includes_its_own_forecast():
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


# Six servo periods: longer than the four from one plan to the next, so that a plan waits when the next is requested.
DELAY_TICKS = 6
DELAYED = LoopSettings(compute_delay_s=DELAY_TICKS * TS)


class RecordingMpc(Mpc):
    """An MPC that records the commands committed before its plan."""

    def __init__(self, neck):
        super().__init__(neck)
        self.recorded = []

    def plan(self, situation):
        self.recorded.append((situation.start_s, situation.committed_rad.copy(), situation.command.position_rad.copy()))
        return super().plan(situation)


def test_committed_commands_equal_those_sent():
    """Also from the tick at which a plan pending at the request takes effect."""
    controller = RecordingMpc(NECK)
    log = LoopBench(controller=controller, settings=DELAYED).run(3.0)
    recorded = [each for each in controller.recorded if 1.0 < each[0] < 2.9]
    assert len(recorded) > 80
    for start_s, committed_rad, command_rad in recorded:
        start = round(start_s / TS)
        sent_rad = log.command_position_rad[start - DELAY_TICKS : start]
        np.testing.assert_allclose(committed_rad, sent_rad, atol=1e-7)
        np.testing.assert_allclose(command_rad, sent_rad[-1], atol=1e-7)
    assert np.ptp(log.command_position_rad[int(1.0 / TS) :, 0]) > 0.1


class Slow(ImmediatePlanner):
    """A planner that delays each answer by some ticks."""

    def __init__(self, controller, clock, ticks):
        super().__init__(controller)
        self._clock, self._late_s, self._held = clock, (ticks - 0.5) * TS, deque()

    def answers(self):
        now_s = self._clock.now_s()
        self._held.extend((now_s + self._late_s, answer) for answer in super().answers())
        due = [answer for ready_s, answer in self._held if ready_s <= now_s]
        for _ in due:
            self._held.popleft()
        return due


@pytest.mark.parametrize("late_ticks", [16, 24])
def test_a_plan_requested_before_robot_silence_is_discarded(late_ticks):
    """The robot is silent for 50 ms. Plans requested before start from commands that may not have been executed."""
    silent_s = (1.0, 1.05)

    def on_send(now_s):
        if silent_s[0] <= now_s < silent_s[1]:
            raise ConnectionError("no answer")

    bench, plans = LoopBench(on_send=on_send), []
    recorder = LoopRecorder(
        NECK.control_period_s, lambda each: plans.append(each) if isinstance(each, PlanMoment) else 0
    )
    loop = GazeLoop(
        NECK,
        PersonTrack(ConstantVelocity(), DELAYED),
        Slow(Mpc(NECK), bench.clock, late_ticks),
        Smoother(NECK, np.zeros(NECK.joints)),
        bench.robot,
        recorder,
        DELAYED,
    )
    for index in range(round(2.0 / TS)):
        bench.clock.sleep_until_s(index * TS)
        seen = HeadObservation(index * TS, bench.head_m(index * TS))
        loop.tick(index, index * TS, [Sighting(index * TS, seen)] if index % 6 == 0 else [])
    after = [each for each in plans if each.time_s >= silent_s[1]]
    assert len(after) > 20
    assert min(each.start_s for each in after) >= silent_s[1] + DELAYED.compute_delay_s - 2 * TS
