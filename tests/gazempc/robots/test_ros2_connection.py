"""Connections of the robot ros2: routers and controllers that go and come back, refusals that say why, ends."""

import re
import sys
import time

import numpy as np
import pytest
import zenoh
from builders.ports import free_port
from builders.ros2_network import NECK, quiet, wait_for, zenoh_listener
from builders.ros2_wire import GOOD, POSITIONS, TRAJECTORY, key, read_trajectory
from pydantic import ValidationError

from gazempc.errors import MissingOptionalDependencyError, RobotError, SettingsError
from gazempc.live.sources.ros2 import Ros2Person
from gazempc.robots.options import Ros2Options
from gazempc.robots.ros2 import Ros2Neck
from gazempc.ros2 import wire as ros2_wire


def test_the_router_goes_and_comes_back(scene):
    robot = scene.connected()
    scene.router.close()
    calls = robot.read_state, lambda: robot.send_command(np.zeros(2))

    def gone(call):
        try:
            call()
        except RobotError as error:
            return re.match(r"the Zenoh router at tcp/127\.0\.0\.1:\d+ has gone", str(error))
        return False

    wait_for(lambda: all(map(gone, calls)))  # a moment before it has no listeners any more
    assert all(gone(call) for _ in range(50) for call in calls)
    scene.start()
    sent = wait_for(lambda: quiet(lambda: robot.send_command(np.array([0.1, 0.2]))) is not None)
    assert sent
    (sample,) = scene.sent(1)
    assert read_trajectory(sample.payload.to_bytes())["positions"] == [0.1, 0.2]
    wait_for(lambda: scene.states.matching_status.matching)
    scene.states.put(GOOD)
    assert wait_for(lambda: quiet(robot.read_state)).time_s == 300.25


def test_connect_names_a_router_that_does_not_answer():
    robot = Ros2Neck(NECK, time.monotonic, float, Ros2Options(endpoint=f"tcp/127.0.0.1:{free_port()}"))
    with pytest.raises(RobotError, match=r"no Zenoh router answers at tcp/127.0.0.1:\d+: start one"):
        robot.connect()
    with pytest.raises(RobotError, match="not connected"):
        robot.read_state()


def announce(scene, kind, topic, type_name, domain=0):
    token = key(domain, topic, type_name).split("/")[-2:]
    return scene.router.liveliness().declare_token(
        f"@ros2_lv/{domain}/abc/0/5/{kind}/%/%/someone/%{topic.replace('/', '%')}/{token[0]}/{token[1]}/::,10:,:,:,,"
    )


def test_connect_says_why_nobody_takes_the_commands(scene):
    robot = scene.neck(command_topic="other", connect_timeout_s=0.1)
    with pytest.raises(RobotError, match=f"no node listens to /other as {TRAJECTORY} in ROS 2 domain 0: is it"):
        robot.connect()
    kept = announce(scene, "MS", "other", POSITIONS), announce(scene, "MS", "other", TRAJECTORY, domain=42)
    with pytest.raises(RobotError) as caught:
        robot.connect()
    assert f"{POSITIONS} in domain 0" in str(caught.value)
    assert f"{TRAJECTORY} in domain 42" in str(caught.value)
    assert len(kept) == 2


@pytest.mark.slow
def test_connect_says_why_there_are_no_joint_states(scene):
    robot = scene.neck(connect_timeout_s=1.0)
    with pytest.raises(RobotError, match="no node sends on /joint_states as sensor_msgs/msg/JointState"):
        robot.connect()


def test_close_at_any_time_and_connect_again(scene, monkeypatch):
    sessions, opened = [], zenoh.open

    def spied(config):
        sessions.append(opened(config))
        return sessions[-1]

    monkeypatch.setattr(zenoh, "open", spied)
    robot = scene.neck()
    robot.close()
    robot.close()
    robot = scene.connected()
    robot.connect()  # does nothing
    (session,) = sessions
    robot.close()
    assert session.is_closed()
    for call in (robot.read_state, lambda: robot.send_command(np.zeros(2))):
        with pytest.raises(RobotError, match="not connected: call connect"):
            call()
    with zenoh_listener(scene.states, GOOD):
        robot.connect()
    assert robot.read_state().time_s == 300.25
    sessions[-1].close()  # somebody else's doing
    with pytest.raises(RobotError):
        robot.send_command(np.zeros(2))
    robot.close()


@pytest.mark.parametrize("missing", ["zenoh", "rosbags.typesys"])
def test_a_missing_package_is_named(scene, monkeypatch, missing):
    ros2_wire.typestore.cache_clear()
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(MissingOptionalDependencyError, match="extra 'ros2'"):
        scene.neck().connect()
    with pytest.raises(MissingOptionalDependencyError, match="extra 'ros2'"):
        Ros2Person("/person/head", float, float).open()


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"joint_names": ("pan", "pan")}, "joint_names"),
        ({"joint_names": ("pan", "")}, "joint_names"),
        ({"command_topic": "head command"}, "topic 'head command'"),
        ({"command_topic": "head/**"}, "topic"),
        ({"state_topic": ""}, "topic"),
        ({"command_type": "std_msgs/msg/Float64"}, "command_type"),
        ({"joint_signs": (1, 0.5)}, "joint_signs"),
        ({"time_from_start_s": 0.0}, "time_from_start_s"),
        ({"silent_after_s": float("nan")}, "silent_after_s"),
    ],
)
def test_options_that_cannot_be_right(scene, options, what):
    with pytest.raises((SettingsError, ValidationError), match=what):
        scene.neck(**options)
