"""The loop when the robot does not answer: named, within limits, and the gaze back after it."""

import dataclasses

import numpy as np
import pytest
from builders.loop import NECK, TS, LoopBench, error_deg, events, make_loop
from hypothesis import given, settings
from hypothesis import strategies as st

from gazempc.controllers.mpc.mpc import Mpc
from gazempc.errors import RobotError
from gazempc.sim.simulated import SimulatedNeck


def unplugged(start_s, stop_s):
    """A robot that does not answer for a while, whatever it is asked."""

    def gone(now_s, state=None):
        if start_s <= now_s < stop_s:
            raise RobotError("no answer")
        return state

    return gone


def test_a_robot_that_does_not_answer_is_named_and_the_gaze_recovers():
    gone = unplugged(2.0, 2.6)
    log = LoopBench(on_read=gone, on_send=gone).run(6.0, answering=False)
    assert "robot_not_answering" in events(log)
    assert np.isnan(log.joint_position_rad).any()
    assert error_deg(log, from_s=4.5).mean() < 1.4  # 1.21 as measured


def within_limits(commands_rad):
    """Every difference within the limits of the neck, from rest on."""
    padded = np.vstack([np.tile(commands_rad[0], (3, 1)), commands_rad])
    limits = NECK.velocity_max_rad_s, NECK.acceleration_max_rad_s2, NECK.jerk_max_rad_s3
    return all(
        np.all(np.abs(np.diff(padded, order, axis=0)) / TS**order <= limit * (1 + 1e-6))
        for order, limit in enumerate(limits, 1)
    )


def test_after_silence_the_robot_gets_no_jump():
    """Whether it stood still or moved on meanwhile: the command brakes, and returns to the last acknowledged one."""
    gone = unplugged(2.0, 2.6)
    bench = LoopBench(on_read=gone, on_send=gone)
    log = bench.run(5.0, answering=False)
    held = [sent for t, sent in bench.robot.received if t < 2.0][-1]
    after = [sent for t, sent in bench.robot.received if t >= 2.0]
    assert within_limits(np.vstack([held, after]))
    assert within_limits(log.command_position_rad)
    moved_rad = np.abs(log.command_position_rad - held)[(log.time_s >= 2.0) & (log.time_s < 2.6)]
    assert moved_rad.max() > 1e-3
    assert moved_rad[-1] == pytest.approx([0, 0], abs=1e-5)


class Losing:
    """A robot that does not acknowledge some commands: it answers nothing, or raises before or after it moves."""

    def __init__(self, clock, lost, how):
        self.inner, self.lost, self.how, self.handed = SimulatedNeck(NECK, np.zeros(2), clock.now_s), lost, how, []
        self.inner.connect()
        self.read_state = self.inner.read_state

    def send_command(self, position_rad):
        tick = len(self.handed)
        self.handed.append(position_rad.copy())
        if tick >= len(self.lost) or not self.lost[tick]:
            return self.inner.send_command(position_rad)
        if self.how != "raises before":
            self.inner.send_command(position_rad)
        if self.how != "returns nothing":
            raise OSError("no acknowledgement")
        return None


def fast_walk_m(time_s):
    return np.array([2.0, 1.5 * np.sin(2.0 * time_s), 0.4])


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(
    runs=st.lists(st.tuples(st.integers(1, 60), st.integers(1, 40)), min_size=1, max_size=12),
    how=st.sampled_from(["returns nothing", "raises before", "raises after"]),
)
def test_commands_that_may_have_been_executed_are_one_motion_within_limits(runs, how):
    """Any pattern of lost acknowledgements: `runs` are ticks that get through, then ticks that do not."""
    bench = LoopBench(head_m=fast_walk_m)
    lost = [False] * 100 + [gone for well, ill in runs for gone in [False] * well + [True] * ill]
    robot = Losing(bench.clock, lost, how)
    bench.loop = make_loop(robot, bench.recorder)
    log = bench.run(min(3.0, TS * (len(lost) + 40)), answering=False)
    assert within_limits(np.array(robot.handed))
    assert np.array_equal(log.command_position_rad, robot.handed)
    assert np.abs(log.command_velocity_rad_s).max() > 0.3


def test_a_robot_that_raises_system_errors_or_answers_nonsense_is_a_robot_that_does_not_answer():
    def flaky(now_s):
        if 1.0 <= now_s < 1.1:
            raise TimeoutError("serial line")
        return (np.array([np.nan, 0.0]),) if 1.2 <= now_s < 1.3 else None

    log = LoopBench(on_send=flaky).run(4.0, answering=False)
    assert list(log.event_name).count("robot_not_answering") == 2
    assert np.all(np.isfinite(log.command_position_rad))


def not_a_number(now_s, state):
    return dataclasses.replace(state, position_rad=state.position_rad * (np.nan if now_s > 1.5 else 1.0))


@pytest.mark.parametrize(
    ("on_read", "event"), [(unplugged(1.5, 3.5), "robot_not_answering"), (not_a_number, "joint_reading_refused")]
)
def test_joints_without_readings_are_known_from_the_commands(on_read, event):
    log, undisturbed = (
        LoopBench(controller=Mpc(NECK, horizon_s=0.3), **faults).run(4.0) for faults in ({"on_read": on_read}, {})
    )
    assert event in events(log)
    assert "stale_plan" not in events(log)
    assert log.command_position_rad == pytest.approx(undisturbed.command_position_rad, abs=1e-9)
