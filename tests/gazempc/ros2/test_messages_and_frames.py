"""Names and stamps of messages, a Python without ROS 2, and the tree of frames against matrices."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from builders.ros2_graph import UNIX_START_S, transform
from scipy.spatial.transform import Rotation

from gazempc.errors import GazempcError, SettingsError
from gazempc.ros2.messages import Ros2Error, Transforms, on_loop_clock, stamp_s, topic_name
from gazempc.ros2.node import Ros2Node, message_type


def test_topic_names_are_validated():
    assert topic_name("head/command") == topic_name("/head/command") == "/head/command"
    for name in ("", "a b", "/a//b", "/1a", "/a/"):
        with pytest.raises(SettingsError):
            topic_name(name)


def test_stamps_are_converted():
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


def test_missing_ros_is_reported_with_the_setup_command(without_ros):
    with pytest.raises(GazempcError, match=r"source /opt/ros/jazzy/setup\.bash"):
        Ros2Node("node")
    with pytest.raises(GazempcError, match=r"ros-.ROS_DISTRO-std-msgs"):
        message_type("std_msgs/msg/String")


def taken(*edges):
    """A tree of (parent, child, position, rotation vector, time); a time of None is static."""
    tree = Transforms()
    for edge in edges:
        take(tree, *edge)
    return tree


def take(tree, parent, child, position_m, rotvec, at_s):
    quat_wxyz = Rotation.from_rotvec(rotvec).as_quat(scalar_first=True)
    moved, problems = tree.take([transform(child, position_m, quat_wxyz, parent, at_s)], fixed=at_s is None)
    assert (len(moved), problems) == (at_s is not None, [])


def rotvec_of(pose):
    return Rotation.from_matrix(pose[:3, :3]).as_rotvec()


def matrix(position_m, rotvec):
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = Rotation.from_rotvec(rotvec).as_matrix(), position_m
    return found


def test_transforms_between_frames_of_random_trees():
    rng = np.random.default_rng(1)
    for _ in range(3):
        edges, in_root = [], {"f0": np.eye(4)}
        for k in range(1, 7):
            parent = f"f{rng.integers(k)}"
            edge = parent, f"f{k}", rng.normal(size=3), rng.normal(size=3), rng.choice([None, 5.0])
            edges.append(edge)
            in_root[f"f{k}"] = in_root[parent] @ matrix(edge[2], edge[3])
        tree = taken(*edges)
        for one, of_one in in_root.items():
            for other, of_other in in_root.items():
                pose = tree.pose(one, other, UNIX_START_S + 5.0)
                assert abs(of_other @ pose - of_one).max() < 1e-9


def test_transforms_are_interpolated_linearly_and_by_slerp():
    tree = taken(("base", "head", [1.0, 0.0, 0.0], [0.0, 0.0, 0.2], 5.0))
    take(tree, "base", "head", [2.0, 0.0, 1.0], [0.0, 0.0, 0.6], 5.5)
    pose = tree.pose("head", "base", UNIX_START_S + 5.125)
    np.testing.assert_allclose(pose[:3, 3], [1.25, 0.0, 0.25], atol=1e-6)
    np.testing.assert_allclose(rotvec_of(pose), [0.0, 0.0, 0.3], atol=1e-6)
    # The newest common time is the oldest of the last transforms.
    take(tree, "head", "eye", [0.0, 0.0, 0.0], [0.0, 0.0, 0.1], 5.25)
    np.testing.assert_allclose(rotvec_of(tree.pose("eye", "base")), [0.0, 0.0, 0.5], atol=1e-6)


def test_a_reparented_frame_moves():
    tree = taken(
        ("base", "left", [0.0, 1.0, 0.0], [0.0] * 3, None), ("base", "right", [0.0, -1.0, 0.0], [0.0] * 3, None)
    )
    for parent, y_m in (("left", 1.0), ("right", -1.0)):
        take(tree, parent, "cup", [0.0, 0.0, 0.0], [0.0] * 3, 5.0)
        np.testing.assert_allclose(tree.pose("cup", "base")[:3, 3], [0.0, y_m, 0.0])
    take(tree, "right", "cup", [0.0, 0.0, 3.0], [0.0] * 3, None)
    np.testing.assert_allclose(tree.pose("cup", "base", UNIX_START_S)[:3, 3], [0.0, -1.0, 3.0])


def test_a_cycle_of_frames_gives_no_transform():
    tree = taken(("a", "b", [1.0, 0.0, 0.0], [0.0] * 3, 5.0), ("b", "a", [1.0, 0.0, 0.0], [0.0] * 3, 5.0))
    with pytest.raises(Ros2Error, match="no path from 'a' to 'base'"):
        tree.pose("a", "base")


def test_a_clock_reset_clears_frames_and_stale_frames_expire():
    tree = taken(("base", "head", [1.0, 0.0, 0.0], [0.0] * 3, 50.0), ("base", "gone", [0.0] * 3, [0.0] * 3, 50.0))
    # Slightly late: newer transforms are kept.
    take(tree, "base", "head", [9.0, 0.0, 0.0], [0.0] * 3, 49.9)
    np.testing.assert_allclose(tree.pose("head", "base")[:3, 3], [1.0, 0.0, 0.0])
    for at_s in (5.0, 6.0):
        take(tree, "base", "head", [at_s, 0.0, 0.0], [0.0] * 3, at_s)
    np.testing.assert_allclose(tree.pose("head", "base", UNIX_START_S + 5.5)[:3, 3], [5.5, 0.0, 0.0], atol=1e-6)
    take(tree, "base", "head", [1.0, 0.0, 0.0], [0.0] * 3, 90.0)
    assert (tree.has("head"), tree.has("gone")) == (True, False)
