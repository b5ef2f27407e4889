"""Faults of the robot: joints that cannot be read, commands that do not get through."""

import numpy as np
import pytest
from builders.checks import assert_recovered, assert_same_commands, assert_sound, assert_within_limits
from builders.faults import Late, answers_badly, between
from builders.live import TS, run_live

from gazempc.errors import RobotError
from gazempc.live.clock import SimulatedClock
from gazempc.settings import LoopSettings
from gazempc.sim.simulated import SimulatedNeck


@pytest.mark.parametrize(
    ("kind", "event", "until_s"),
    [
        (TimeoutError, "robot_not_answering", 2.5),
        ("none", None, 2.5),
        ("nan", "joint_reading_refused", 2.5),
        ("a year old", "joint_reading_refused", 2.5),
        ("far off", "joint_reading_refused", 2.05),
    ],
)
def test_joints_that_cannot_be_read_are_estimated_from_the_commands(kind, event, until_s):
    failing = between(2.0, until_s)
    result = run_live(on_read=lambda now, state: answers_badly(kind, state) if failing(now) else state, duration_s=3.0)
    assert_sound(result)
    assert result.events == {"no_observation_yet", *([event] if event else [])}
    assert_same_commands(result, 1e-9)


def assert_brakes_and_returns(result, start_s, stop_s):
    """While nothing is acknowledged the command brakes and returns to the last acknowledged one, within limits."""
    now, sent = result.joined("time_s"), result.joined("command_position_rad")
    assert len(sent) == result.report.ticks
    silent = (now >= start_s) & (now < stop_s)
    first, last = np.flatnonzero(silent)[[0, -1]]
    assert_within_limits(sent, ends=True)
    assert np.abs(sent[first + 2] - sent[first - 1]).max() > 1e-4  # it was moving
    assert sent[last] == pytest.approx(sent[first - 1], abs=1e-5)
    # A robot that stood still gets no jump.
    received = np.array([position for _, position in result.robot.received])
    assert np.array_equal(received, sent[~silent])
    assert_within_limits(received, breaks=[first])


def not_answering(kind):
    def send(now_s):
        if not 2.0 <= now_s < 2.5:
            return None
        if kind is OSError:
            raise kind("no answer")
        return ({"none": None, "nan": np.full(2, np.nan)}[kind],)

    return send


@pytest.mark.parametrize("kind", [OSError, "none", "nan"])
def test_commands_that_do_not_get_through_for_half_a_second(kind):
    result = run_live(on_send=not_answering(kind))
    assert result.events == {"no_observation_yet", "robot_not_answering"}
    assert result.event_s("robot_not_answering") == pytest.approx([2.0], abs=TS)
    assert_brakes_and_returns(result, 2.0, 2.5)
    assert_recovered(result, 2.5 + 1.5)
    assert result.robot.calls == ["connect", "close"]


def test_what_was_planned_before_a_command_was_lost_is_not_followed():
    """Plans under way, and plans made and waiting, do not start from the command that brakes."""

    def run(on_send):
        clock = SimulatedClock()
        return run_live(
            clock=clock,
            on_send=on_send,
            planner=lambda controller: Late(controller, clock, lambda now: 0.03),
            loop=LoopSettings(compute_delay_s=0.05),
        )

    def lost(now_s):
        if 2.0 - 1e-6 <= now_s < 2.0 + 2.5 * TS:
            raise RobotError("lost")

    result = run(lost)
    now, sent = result.joined("time_s"), result.joined("command_position_rad")
    assert_within_limits(sent, ends=True)
    speed = np.abs(result.joined("command_velocity_rad_s")).max(axis=1)
    before = np.flatnonzero(now < 2.0 - 1e-6)[-1]
    assert speed[(now > 2.04) & (now < 2.06)].max() < 0.9 * speed[before]  # it brakes
    assert result.event_s("robot_not_answering") == pytest.approx([2.0])
    assert_recovered(result, 2.0 + 2.8, reference=run(None))


def test_a_robot_that_raises_in_close_does_not_hide_the_run():
    class Stuck(SimulatedNeck):
        def close(self):
            raise OSError("the port is gone")

    result = run_live(robot_class=Stuck, duration_s=2.0)
    assert result.report.stopped_by == "duration"
    (fault,) = result.logs[-1][0].faults
    assert (fault.event, fault.error) == ("robot_not_answering", "OSError: the port is gone (Spied.close())")
