"""Names, stamps, and the message of a Python without ROS 2."""

import sys
from types import SimpleNamespace

import pytest

from gazempc.errors import GazempcError, SettingsError
from gazempc.ros2.messages import Ros2Error, on_loop_clock, stamp_s, topic_name
from gazempc.ros2.node import Ros2Node, message_type


def test_names_of_topics():
    assert topic_name("head/command") == topic_name("/head/command") == "/head/command"
    for name in ("", "a b", "/a//b", "/1a", "/a/"):
        with pytest.raises(SettingsError):
            topic_name(name)


def test_stamps():
    assert stamp_s(SimpleNamespace(sec=5, nanosec=250_000_000)) == 5.25
    with pytest.raises(Ros2Error):
        stamp_s(SimpleNamespace(sec=0, nanosec=0))
    assert on_loop_clock(100.0, lambda unix_s: unix_s - 90.0, 11.0) == 10.0
    for unix_s in (80.0, 120.0, float("nan")):
        with pytest.raises(Ros2Error, match="use_sim_time"):
            on_loop_clock(unix_s, lambda unix_s: unix_s - 90.0, 11.0)


@pytest.fixture
def without_ros(monkeypatch):
    for name in ("rclpy", "std_msgs", "std_msgs.msg"):
        monkeypatch.setitem(sys.modules, name, None)


def test_a_python_without_ros_is_told_how_to_source_it(without_ros):
    with pytest.raises(GazempcError, match=r"source /opt/ros/jazzy/setup\.bash"):
        Ros2Node("node")
    with pytest.raises(GazempcError, match=r"ros-.ROS_DISTRO-std-msgs"):
        message_type("std_msgs/msg/String")
