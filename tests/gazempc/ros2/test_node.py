"""The node and the robot `ros2` against real rclpy nodes in this process."""

import threading
import time

import numpy as np
import pytest
from builders.ros2_real import rclpy_or_skip
from builders.waiting import wait_for
from scipy.interpolate import BPoly

from gazempc.controllers.controller import Plan
from gazempc.errors import RobotError, SettingsError
from gazempc.loop.smoother import Smoother
from gazempc.neck.spec import load_neck
from gazempc.robots.options import Ros2Options
from gazempc.robots.ros2 import Ros2Neck
from gazempc.ros2.node import Ros2Node, message_type

rclpy = rclpy_or_skip()
pytestmark = pytest.mark.slow

NECK = load_neck("reference")
STATE, TRAJECTORY = "sensor_msgs/msg/JointState", "trajectory_msgs/msg/JointTrajectory"
NUMBERS, STRING = "std_msgs/msg/Float64MultiArray", "std_msgs/msg/String"
JOINTS = ("pan", "tilt")


@pytest.fixture
def node():
    made = Ros2Node("other")
    yield made
    made.close()


@pytest.fixture
def made():
    """Closes the objects appended by a test."""
    parts = []
    yield parts
    for part in parts:
        part.close()


class Driver:
    """A driver node of a neck: subscribes to commands, publishes joint states."""

    def __init__(self, node, command_type=TRAJECTORY):
        self.commands = node.subscription("/head/command", command_type)
        self.states = node.publication("/joint_states", STATE)

    def publish(self, positions, names=JOINTS, velocities=(), stamp_s=None):
        message = message_type(STATE)()
        stamp_s = time.time() if stamp_s is None else stamp_s
        message.header.stamp.sec, message.header.stamp.nanosec = int(stamp_s), int(1e9 * (stamp_s % 1.0))
        message.name, message.position, message.velocity = list(names), list(positions), list(velocities)
        self.states.publish(message)


def neck(made, spec=NECK, connect_timeout_s=20.0, **fields):
    options = Ros2Options(**({"joint_names": JOINTS, "command_topic": "head/command"} | fields))
    robot = Ros2Neck(spec, time.time, lambda unix_s: unix_s, options, connect_timeout_s)
    made.append(robot)
    return robot


def connected(made, driver, **fields):
    robot = neck(made, **fields)
    stop = threading.Event()

    def talk():
        while not stop.wait(0.02):
            driver.publish([0.0, 0.0], fields.get("joint_names", JOINTS))

    thread = threading.Thread(target=talk)
    thread.start()
    try:
        robot.connect()
    finally:
        stop.set()
        thread.join()
    return robot


def test_every_command_has_derivatives_and_a_stop_point(node, made):
    driver = Driver(node)
    robot = connected(made, driver, joint_signs=(1.0, -1.0))
    smoother = Smoother(NECK, np.zeros(2))
    expected = [smoother.step(k / NECK.servo_rate_hz, _to([0.6, -0.3])) for k in range(60)]
    found = []
    for rad in expected:
        assert np.array_equal(robot.send_command(rad), rad)
        found += wait_for(driver.commands.take)
    assert len(found) == 60
    signs, period_s = np.array([1.0, -1.0]), NECK.servo_period_s
    before = np.array([signs * first for first in expected])
    for k in range(2, 60):
        point, stop = found[k].points[0], found[k].points[-1]
        assert list(found[k].joint_names) == list(JOINTS)
        assert (found[k].header.stamp.sec, point.time_from_start.nanosec) == (0, round(0.5e9 * period_s))
        np.testing.assert_allclose(point.positions, before[k])
        np.testing.assert_allclose(point.velocities, (before[k] - before[k - 1]) / period_s)
        second = (before[k] - 2 * before[k - 1] + before[k - 2]) / period_s**2
        np.testing.assert_allclose(point.accelerations, second, atol=1e-9)
        np.testing.assert_allclose([*stop.velocities, *stop.accelerations], 0.0, atol=1e-9)
    assert max(abs(np.array(each.points[0].velocities)).max() for each in found) > 1.0


def _to(position_rad):
    at = np.array([position_rad])
    return Plan(0.0, np.inf, at, 0 * at, 0 * at)


def _from_start_s(point):
    return point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec


def test_the_stop_of_a_trajectory_brakes_within_the_limits(node, made):
    """The quintic that a joint_trajectory_controller runs from the last command, against the neck's limits."""
    driver = Driver(node)
    robot = connected(made, driver)
    smoother = Smoother(NECK, np.zeros(2))
    fastest = 0.0
    for k in range(250):
        target = [0.9, 0.5] if k < 100 else [-0.9, -0.4]
        robot.send_command(smoother.step(k / NECK.servo_rate_hz, _to(target)))
        (message,) = wait_for(driver.commands.take)
        first, times_s = message.points[0], [_from_start_s(each) for each in message.points]
        for joint in range(2):
            ends = [
                [each.positions[joint], each.velocities[joint], each.accelerations[joint]] for each in message.points
            ]
            assert ends[-1][1:] == pytest.approx([0.0, 0.0], abs=1e-9)
            spline = BPoly.from_derivatives(times_s, ends)
            at_s = np.linspace(times_s[0], times_s[-1], 100)
            # Commands are inside the limits by the servo's gain; acceleration is a difference of commands.
            assert abs(spline(at_s, 1)).max() <= NECK.velocity_max_rad_s[joint] * 1.01
            assert abs(spline(at_s, 2)).max() <= NECK.acceleration_max_rad_s2[joint] * 1.05
            fastest = max(fastest, abs(first.velocities[joint]))
    assert fastest > 1.5


def test_positions_only_and_a_reversed_joint(node, made):
    driver = Driver(node, NUMBERS)
    robot = connected(made, driver, command_type=NUMBERS, joint_signs=(1.0, -1.0))
    assert np.array_equal(robot.send_command(np.array([9.0, 9.0])), NECK.position_max_rad)
    (message,) = wait_for(driver.commands.take)
    assert list(message.data) == [NECK.position_max_rad[0], -NECK.position_max_rad[1]]
    driver.publish([0.1, 0.2], velocities=[1.0, 2.0])
    state = wait_for(robot.read_state)
    assert (list(state.position_rad), list(state.velocity_rad_s)) == ([0.1, -0.2], [1.0, -2.0])


def test_speed_commands_follow_positions_and_remove_drift(node, made):
    driver = Driver(node, NUMBERS)
    robot = connected(made, driver, command_type=NUMBERS, command_values="velocity")
    sent = []
    for k in range(300):
        robot.send_command(np.array([0.002 * k, 0.0]))
        sent += wait_for(driver.commands.take)
    assert sent[50].data[0] == pytest.approx(0.4)  # 0.002 rad a servo period
    # The joint is 0.1 rad short of a command whose dead time is over.
    periods = round((NECK.pan.dead_time_s + NECK.pan.servo_lag_s + NECK.servo_period_s) * NECK.servo_rate_hz)
    driver.publish([0.002 * (300 - periods) - 0.1, 0.0])
    wait_for(lambda: (state := robot.read_state()) and state.position_rad[0] > 0.01)
    robot.send_command(np.array([0.6, 0.0]))
    (message,) = wait_for(driver.commands.take)
    assert message.data[0] == pytest.approx(0.4 + 0.1)
    robot.close()
    (message,) = wait_for(driver.commands.take)
    assert list(message.data) == [0.0, 0.0]
    with pytest.raises(SettingsError):
        neck(made, command_values="velocity")


def test_foreign_stale_and_missing_joint_states_give_no_reading(node, made):
    driver = Driver(node)
    robot = connected(made, driver, silent_after_s=0.3)
    time.sleep(0.1)
    robot.read_state()
    now_s = time.time()
    driver.publish([0.4, 0.3, 0.2], ["wheel", "tilt", "pan"], stamp_s=now_s)
    assert list(wait_for(robot.read_state).position_rad) == [0.2, 0.3]
    ignored = robot.ignored
    for names, positions, stamp_s in (
        (["pan"], [0.0], now_s + 0.1),
        (JOINTS, [np.nan, 0.0], now_s + 0.1),
        (JOINTS, [0.0], now_s + 0.1),
        (JOINTS, [0.0, 0.0], now_s),
        (JOINTS, [0.0, 0.0], now_s - 3600.0),
    ):
        driver.publish(positions, names, stamp_s=stamp_s)

    def all_refused():
        robot.read_state()
        return robot.ignored == ignored + 5

    wait_for(all_refused, timeout_s=0.25)
    time.sleep(0.35)
    with pytest.raises(RobotError, match=r"no joint state on /joint_states for more than 0\.3 s"):
        robot.read_state()
    driver.publish([0.1, 0.1])
    assert wait_for(robot.read_state).position_rad[0] == 0.1


def test_a_missing_robot_is_reported(node, made):
    robot = neck(made, connect_timeout_s=0.5)
    with pytest.raises(RobotError, match="no node listens to /head/command as trajectory_msgs"):
        robot.connect()
    with pytest.raises(RobotError, match="not connected"):
        robot.read_state()


def test_an_incompatible_quality_of_service_is_described(node):
    volatile = node.publication("/list", STRING)
    kept = node.subscription("/list", STRING, latched=True)
    for end in (kept, volatile):
        wait_for(lambda end=end: "but other has an incompatible quality of service" in end.described)
    assert kept.senders == ()
    assert volatile.has_listeners is False
    plain = node.subscription("/list", STRING)
    assert wait_for(lambda: plain.senders) == ("/other",)
