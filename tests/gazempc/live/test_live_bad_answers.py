"""Whatever a part returns or raises in a run: an event that names its class, a run that goes on, a log that loads."""

import dataclasses
import sys
import threading
import time

import numpy as np
import pytest
from builders.checks import assert_sound, assert_within_limits
from builders.live import NECK, Faulty, run_live

from gazempc.controllers.lookahead import LookAhead
from gazempc.live.clock import RealClock, SimulatedClock
from gazempc.live.sources.source import Arrived
from gazempc.loop.planner import BackgroundPlanner
from gazempc.loop.recorder import LoopRecorder
from gazempc.results.log_files import load_log
from gazempc.types import JointState
from predictors import ConstantVelocity

FROM_S = 0.6


def changed(value, **fields):
    """A frozen value with other fields, which its own checks may not accept."""
    for name, new in fields.items():
        object.__setattr__(value, name, new)
    return value


class Bad:
    """Puts something else in place of what a part returns, after a second."""

    def __init__(self, instead, clock):
        self.instead, self.clock = instead, clock

    def __call__(self, answer):
        return answer if self.clock.now_s() < FROM_S else self.instead(answer)


def leave(_):
    sys.exit("leaving")


class Controller(LookAhead):
    def __init__(self, bad, times=None):
        super().__init__(NECK)
        self.bad, self.bad_times = bad, times

    def forecast_times_s(self, start_s, newest_s):
        times_s = super().forecast_times_s(start_s, newest_s)
        return self.bad_times(times_s) if self.bad_times else times_s

    def plan(self, situation):
        return self.bad(super().plan(situation))


class Predictor(ConstantVelocity):
    def __init__(self, bad):
        super().__init__()
        self.bad = bad

    def forecast(self, times_s):
        return self.bad(super().forecast(times_s))


# Every kind of `benchmarks.faults.wrongs` is tried in `test_live_own_parts`; these are of one event each.
INSTEAD = {
    ("plan", "no events"): lambda p: changed(dataclasses.replace(p), events=None),
    ("plan", "infinite"): lambda p: dataclasses.replace(p, velocity_rad_s=p.velocity_rad_s * np.inf),
    ("plan", "far outside"): lambda p: dataclasses.replace(p, position_rad=p.position_rad + 50.0),
    ("plan", "exits"): leave,
    ("times", "too many"): lambda t: np.linspace(t[0], t[0] + 1.0, 100_000),
    ("forecast", "1e200 m"): lambda f: dataclasses.replace(f, means_base_m=f.means_base_m * 1e200),
    ("forecast", "NaN"): lambda f: dataclasses.replace(f, means_base_m=f.means_base_m * np.nan),
    ("read", "text"): lambda s: JointState(s.time_s, np.array(["a", "b"]), s.velocity_rad_s),
    ("read", "1e9 rad/s"): lambda s: JointState(s.time_s, s.position_rad, s.velocity_rad_s + 1e9),
    ("read", "stands still"): lambda s: JointState(s.time_s, np.array([0.3, 0.0]), 0 * s.velocity_rad_s),
    ("read", "drifts"): lambda s: JointState(s.time_s, s.position_rad + 0.5 * (s.time_s - FROM_S), s.velocity_rad_s),
    ("poll", "None"): lambda a: Arrived(None),
    ("send", "1e9"): lambda sent: sent + 1e9,
}


def run_bad(part, kind, clock, duration_s=1.8, **more):
    bad = Bad(INSTEAD.get((part, kind), lambda answer: answer), clock)

    class Source(Faulty):
        def poll(self):
            return bad(super().poll())

    parts = {
        "plan": lambda: {"controller": Controller(bad)},
        "times": lambda: {"controller": Controller(lambda plan: plan, bad)},
        "forecast": lambda: {"predictor": Predictor(bad)},
        "read": lambda: {"on_read": lambda now, state: bad(state)},
        "send": lambda: {"on_send": lambda now: None if now < FROM_S else (bad(np.zeros(2)),)},
        "poll": lambda: {"source": Source(clock)},
    }[part]()
    return run_live(clock=clock, duration_s=duration_s, **({"controller": LookAhead(NECK)} | parts | more))


EXPECTED = {
    "plan": ("controller_failed", "Controller.plan()"),
    "times": ("controller_failed", "Controller.forecast_times_s()"),
    "forecast": ("forecast_failed", "Predictor.forecast()"),
    "read": ("robot_not_answering", "Spied"),
    "send": ("robot_not_answering", "Spied.send_command()"),
    "poll": ("source_failed", "Source.poll()"),
}
OTHER_EVENTS = {
    ("plan", "infinite"): "plan_not_finite",
    ("plan", "far outside"): "plan_out_of_range",
    ("read", "1e9 rad/s"): "joint_reading_refused",
    ("read", "stands still"): "joint_not_following",
    ("read", "drifts"): "joint_off_command",
}


@pytest.mark.parametrize(("part", "kind"), INSTEAD)
def test_what_a_part_answers_is_refused_by_name_and_the_run_goes_on(part, kind, tmp_path):
    result = run_bad(part, kind, SimulatedClock())
    assert result.report.stopped_by == "duration"
    assert_within_limits(result.joined("command_position_rad"), ends=True)
    event, named = EXPECTED[part]
    event = OTHER_EVENTS.get((part, kind), event)
    (fault,) = (fault for fault in result.logs[0][0].faults if fault.event == event)
    assert named in fault.error
    assert fault.count > 3
    log = result.logs[0][0]
    log.save(tmp_path / "log.npz")
    assert load_log(tmp_path / "log.npz").time_s.size == result.report.ticks


def test_a_fault_of_the_program_keeps_a_log_that_loads(tmp_path, monkeypatch):
    """The true joints of the tick that failed are left out."""
    clock = SimulatedClock()

    tick, raised = LoopRecorder.tick, []

    def fails_once(self, time_s, *values):
        if time_s > 1.2 and not raised:
            raised.append(time_s)
            raise RuntimeError("a fault of the program")
        tick(self, time_s, *values)

    monkeypatch.setattr(LoopRecorder, "tick", fails_once)
    with pytest.raises(RuntimeError, match="a fault of the program") as ended:
        run_bad("plan", "none", clock)
    log = ended.value.result.logs[0][0]
    log.save(tmp_path / "log.npz")
    assert load_log(tmp_path / "log.npz").time_s[-1] == pytest.approx(1.2, abs=0.02)


BLOCKED_S = 0.4


def once(clock):
    """Blocks for a while, once."""
    blocks = [BLOCKED_S]

    def block(answer=None):
        if clock.now_s() > FROM_S and blocks:
            time.sleep(blocks.pop())
        return answer

    return block


@pytest.mark.slow
@pytest.mark.parametrize("part", ["plan", "forecast", "read", "poll"])
def test_a_part_that_blocks_holds_up_no_command(part):
    clock = RealClock()
    block = once(clock)
    parts = {
        "plan": {"controller": Controller(block)},
        "forecast": {"predictor": Predictor(block)},
        "read": {"on_read": lambda now, state: block(state)},
        "poll": {"on_poll": block},
    }[part]
    parts = {"controller": LookAhead(NECK), "planner": BackgroundPlanner} | parts
    result = run_live(clock=clock, duration_s=1.8, **parts)
    assert_within_limits(result.joined("command_position_rad"), ends=True)
    (fault,) = (fault for fault in result.logs[0][0].faults if fault.event == "part_slow")
    name = {
        "plan": "Controller.plan()",
        "forecast": "Predictor.",
        "read": "Spied.read_state()",
        "poll": "Faulty.poll()",
    }
    assert name[part] in fault.error
    assert float(fault.error.split(" took ")[1].split()[0]) == pytest.approx(BLOCKED_S, abs=0.15)
    # One command is due every 5 ms; before, none was sent meanwhile.
    assert np.diff([now for now, _ in result.robot.received]).max() < 0.5 * BLOCKED_S


@pytest.mark.slow
def test_a_controller_that_never_returns_keeps_nobody_waiting():
    released, plans = threading.Event(), []

    def hang(plan):
        plans.append(plan)
        if len(plans) > 3:
            released.wait(240.0)
        return plan

    try:
        result = run_live(clock=RealClock(), controller=Controller(hang), planner=BackgroundPlanner, duration_s=0.8)
        assert len(plans) == 4
    finally:
        released.set()
    assert_sound(result)
    assert {"late_plan", "stale_plan"} <= result.events
    assert result.report.stopped_by == "duration"
