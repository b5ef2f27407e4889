"""Faults of the robot: joints that cannot be read, commands that do not get through."""

import numpy as np
import pytest
from builders.checks import assert_recovered, assert_same_commands, assert_sound, assert_within_limits, undisturbed
from builders.faults import Late, answers_badly, between
from builders.live import TS, run_live

from gazempc.errors import RobotError
from gazempc.live.clock import SimulatedClock
from gazempc.robots.mujoco import MujocoNeck
from gazempc.settings import LoopSettings
from gazempc.sim.simulated import SimulatedNeck


@pytest.mark.parametrize(
    ("kind", "event"),
    [
        (RobotError, "robot_not_answering"),
        (OSError, "robot_not_answering"),
        (ValueError, "robot_not_answering"),
        (TimeoutError, "robot_not_answering"),
        ("none", None),
        ("nan", "joint_reading_refused"),
        ("three joints", "robot_not_answering"),
        ("scalar", "robot_not_answering"),
        ("no position", "robot_not_answering"),
        ("lists", None),
        ("no time", "joint_reading_refused"),
        ("a year old", "joint_reading_refused"),
        ("the same for ever", "joint_reading_refused"),
    ],
)
def test_joints_that_cannot_be_read_for_half_a_second_are_known_from_the_commands(kind, event):
    failing = between(2.0, 2.5)
    result = run_live(on_read=lambda now, state: answers_badly(kind, state) if failing(now) else state, duration_s=4.0)
    assert_sound(result)
    if kind != "lists":  # what is no array may be taken for one or be refused
        assert result.events == {"no_observation_yet", *([event] if event else [])}
    assert_same_commands(result, 1e-3 if kind == "lists" else 1e-9)


def test_readings_far_off_are_refused():
    def off(now_s, state):
        return answers_badly("far off", state) if 2.0 <= now_s < 2.05 else state

    result = run_live(on_read=off, duration_s=4.0)
    assert_sound(result)
    assert result.events == {"no_observation_yet", "joint_reading_refused"}
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
        if isinstance(kind, type):
            raise kind("no answer")
        return (
            {"none": None, "nan": np.full(2, np.nan), "three": np.zeros(3), "list": [0.0, None], "text": "ok"}[kind],
        )

    return send


@pytest.mark.parametrize(
    "kind", [RobotError, OSError, ValueError, TimeoutError, "none", "nan", "three", "list", "text"]
)
def test_commands_that_do_not_get_through_for_half_a_second(kind):
    result = run_live(on_send=not_answering(kind))
    assert result.events == {"no_observation_yet", "robot_not_answering"}
    assert result.event_s("robot_not_answering") == pytest.approx([2.0], abs=TS)
    assert_brakes_and_returns(result, 2.0, 2.5)
    assert_recovered(result, 2.5 + 1.5)
    assert result.robot.calls == ["connect", "close"]


@pytest.mark.parametrize("robot_class", [SimulatedNeck, MujocoNeck])
def test_a_robot_that_disconnects_and_comes_back(robot_class):
    def gone(now_s, state=None):
        if 2.0 <= now_s < 2.6:
            raise RobotError("unplugged")
        return state

    result = run_live(on_read=gone, on_send=gone, robot_class=robot_class)
    assert result.events == {"no_observation_yet", "robot_not_answering"}
    assert_brakes_and_returns(result, 2.0, 2.6)
    reference = undisturbed() if robot_class is SimulatedNeck else run_live(robot_class=MujocoNeck)
    assert_recovered(result, 2.6 + 1.5, reference=reference)


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


@pytest.mark.parametrize("lost", [1, 2])
def test_one_or_two_lost_commands_hardly_change_the_motion(lost):
    def on_send(now_s):
        if 2.0 - 1e-6 <= now_s < 2.0 + (lost - 0.5) * TS:
            raise RobotError("lost")

    result = run_live(on_send=on_send)
    assert_within_limits(result.joined("command_position_rad"), ends=True)
    assert_same_commands(result, 1e-3)
    assert result.events == {"no_observation_yet", "robot_not_answering"}
    assert_recovered(result, 2.5)


def test_a_robot_that_raises_in_close_does_not_hide_the_run():
    class Stuck(SimulatedNeck):
        def close(self):
            raise OSError("the port is gone")

    result = run_live(robot_class=Stuck, duration_s=2.0)
    assert result.report.stopped_by == "duration"
    (fault,) = result.logs[-1][0].faults
    assert (fault.event, fault.error) == ("robot_not_answering", "OSError: the port is gone (Spied.close())")
