"""The planner in the background: one request at a time, and each is answered."""

import threading
import time

from gazempc.controllers.controller import SolverFailed
from gazempc.loop.planner import Answer, BackgroundPlanner


def test_the_background_planner_takes_one_request_at_a_time_and_answers_all():
    gate = threading.Semaphore(0)

    class Gated:
        def plan(self, situation):
            gate.acquire()
            if situation == "fail":
                raise SolverFailed("made to fail")
            raise ZeroDivisionError

    planner = BackgroundPlanner(Gated())

    def answered():
        until_s = time.monotonic() + 240.0
        while time.monotonic() < until_s:
            if answers := planner.answers():
                return answers
            time.sleep(0.001)
        raise AssertionError("no answer")

    assert planner.answers() == []
    for index, (situation, event) in enumerate([("fail", "solver_failed"), ("bug", "controller_failed")]):
        assert planner.request(index, lambda situation=situation: situation)
        assert not planner.request(99, lambda: None)
        gate.release()
        (answer,) = answered()
        assert isinstance(answer, Answer)
        assert (answer.due_index, answer.plan, answer.event) == (index, None, event)
        assert answer.plan_ms >= 0
    planner.close()
    planner.close()
