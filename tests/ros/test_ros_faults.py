"""Faults of a graph of ROS 2, each in processes of its own; the rows of the table in docs/ros2.md."""

from builders.ros2_real import rclpy_or_skip

rclpy_or_skip()

import signal
import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

import gazempc as gz

pytestmark = pytest.mark.slow
NECK = gz.load_neck("reference")


class Watch:
    """Diagnostics of the node received so far."""

    def __init__(self, client):
        self.client = client
        client.listen(DiagnosticArray, "/diagnostics")

    def values(self):
        received = self.client.received["/diagnostics"]
        return {each.key: each.value for message in received for each in message.status[0].values}

    def latest(self):
        received = self.client.received["/diagnostics"]
        return {each.key: each.value for each in received[-1].status[0].values} if received else {}

    def until(self, *words, timeout_s=60.0):
        def matches():
            text = str(self.values())
            return all(word in text for word in words)

        self.client.wait(matches, timeout_s, why=lambda: f"{words}: {self.values()}")

    def until_used(self, more=20, timeout_s=60.0):
        """Wait until more observations are used."""
        before = int(self.latest().get("used", 0))
        self.client.wait(
            lambda: int(self.latest().get("used", 0)) >= before + more,
            timeout_s,
            why=lambda: f"not used: {self.latest()}",
        )


def within_limits(stage):
    """Joints and commands of the controller stayed within the limits; its refusals."""
    _, commands, joints_rad, speeds_rad_s, file = stage.rows()
    # Messages arrive with jitter, so the controller's set-points are not evenly spaced.
    assert abs(speeds_rad_s).max() <= 1.03 * NECK.velocity_max_rad_s.max()
    assert (joints_rad >= NECK.position_min_rad - 1e-6).all()
    assert (joints_rad <= NECK.position_max_rad + 1e-6).all()
    assert list(file["refused"]) == []
    return commands


def test_the_node_recovers_from_lost_trackers_and_controllers(stage):
    controller, gaze = stage.controller(), stage.gaze()
    watch = Watch(stage.client())
    gaze.until("robot ros2")
    tracker = stage.tracker("--passes", "20")
    watch.until_used()
    # Two trackers on one topic are named.
    other = stage.tracker("--passes", "20", "--name", "old_tracker")
    watch.until("several_senders", "/old_tracker and /tracker")
    other.stop(signal.SIGKILL)
    # The tracker is killed: the person is lost, and reacquired with the next tracker.
    tracker.stop(signal.SIGKILL)
    watch.until("event target_lost", "event no_sender")
    tracker = stage.tracker("--passes", "20")
    watch.until_used()
    stage.client().listen(JointState, "/joint_states")
    # The controller is killed and restarted; meanwhile the neck is turned by 0.3 rad.
    controller.stop(signal.SIGINT)
    first = stage.rows()
    watch.until("event robot_not_answering")
    stage.client().received["/joint_states"].clear()
    turned_rad = first[2][-1] - np.copysign([0.3, 0.0], first[2][-1])
    position = [f"{angle:.6f}" for angle in turned_rad]
    controller = stage.controller("--position", *position)
    states = stage.client().received["/joint_states"]
    stage.client().wait(lambda: len(states) > 100)  # a second of commands
    watch.until_used()
    tracker.stop()
    assert gaze.stop() == 0, gaze.text()
    assert controller.stop() == 0, controller.text()
    within_limits(stage)
    assert stage.rows()[-1]["accepted"] > 50
    assert gz.measure(gz.load_log(stage.gaze_file)).limit_violations == 0


@pytest.mark.parametrize(
    ("faults", "events", "seen"),
    [
        (("--nan-every", "5", "--jump-after-s", "4"), ("bad_observation", "implausible_person"), 20),
        (("--silent-tf-after-s", "4"), ("bad_observation", "target_lost"), 20),
        (("--silent-tf-after-s", "0"), ("bad_observation",), 0),
    ],
    ids=["NaN, and tf that jumps by 30 m", "tf that ends", "no tf"],
)
def test_invalid_values_and_frames_are_refused(stage, faults, events, seen):
    controller, gaze = stage.controller(), stage.gaze()
    watch = Watch(stage.client())
    gaze.until("robot ros2")
    tracker = stage.tracker("--passes", "20", *faults)
    watch.until(*(f"event {name}" for name in events))
    used = int(watch.latest().get("used", 0))
    assert used > seen if seen else used == 0
    tracker.stop()
    gaze.stop()
    controller.stop()
    within_limits(stage)


def test_a_simulation_clock_reset_is_handled(stage):
    controller = stage.controller()
    gaze = stage.gaze(use_sim_time="true", **{"options.ros2.silent_after_s": "0.5"})
    # The controller's stamps are of the computer's clock: only the simulator's tracker fits. A robot without joint
    # states would be driven open loop; here they are refused, so the node cannot begin.
    tracker = stage.tracker("--sim-time", "--passes", "20")
    gaze.until("no valid joint state on /joint_states")
    gaze.until("use_sim_time")
    gaze.stop()
    # The neck in the simulator, people by its clock.
    gaze = stage.gaze(use_sim_time="true", robot="simulated")
    watch = Watch(stage.client())
    gaze.until("robot simulated")
    tracker.stop()
    tracker = stage.tracker("--sim-time", "--clock-jump-after-s", "5", "--passes", "20")
    watch.until_used(60)
    stage.client().for_s(4.0)  # includes the jump
    watch.until_used(60)
    tracker.stop()
    assert gaze.stop() == 0, gaze.text()
    controller.stop()
    assert gz.measure(gz.load_log(stage.gaze_file)).limit_violations == 0


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL], ids=["sigterm", "sigkill"])
def test_a_node_stopped_in_motion_brakes_within_limits(stage, how):
    from test_actions import Head, point_head

    controller, gaze = stage.controller("--position", "-1.0", "0.0"), stage.gaze()
    gaze.until("robot ros2")
    head = Head(stage.client())
    states = head.client.received["/joint_states"]

    def moves():
        return bool(states) and abs(states[-1].velocity[1]) > 1.0

    # Two seconds at this speed; a client on a busy computer that misses them sends the neck back.
    for side_m in (1.5, -1.5, 1.5, -1.5):
        assert head.send(point_head([0.3, side_m, 0.0], max_rad_s=1.2)).accepted
        until_s = time.monotonic() + 8.0
        stage.client().wait(lambda until_s=until_s: moves() or time.monotonic() > until_s)
        if moves():
            break
    gaze.stop(how)
    stage.client().for_s(1.5)
    controller.stop()
    commands = within_limits(stage)
    times_s, _, _, speeds_rad_s, file = stage.rows()
    assert abs(speeds_rad_s[-1]).max() < 0.02
    assert abs(commands[-1, 1]).max() < 1e-9
    # Before the last message set-points have the jitter of the messages, and 10 ms later its own points begin.
    braking = commands[times_s > file["last_s"] + 0.01]
    # The controller's quintic overshoots between two points where the jerk switches. A dead stop has 24 rad/s^2.
    assert abs(braking[:, 2]).max() <= NECK.acceleration_max_rad_s2.max() * 1.05
    if how is signal.SIGKILL:
        # The controller alone brakes: a node that brakes itself ends at rest. A busy computer kills late in the motion.
        assert abs(braking[0, 1]).max() > 0.3
    else:
        assert gz.measure(gz.load_log(stage.gaze_file)).limit_violations == 0


def test_parameters_follow_the_lifecycle(stage):
    """Parameters have descriptions and ranges, and are set while the node is unconfigured."""
    gaze = stage.gaze(robot="simulated", autostart="false")
    client = stage.client()

    def change(transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        return client.ask(ChangeState, "/gaze/change_state", request).success

    def set_to(name, value):
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        return client.ask(SetParameters, "/gaze/set_parameters", request).results[0]

    names = ["loop.lost_after_s", "attend", "mpc.horizon_s", "neck", "options.ros2.joint_names", "look_away.rhythm"]
    request = DescribeParameters.Request(names=names)
    described = client.ask(DescribeParameters, "/gaze/describe_parameters", request).descriptors
    assert all(each.description for each in described)
    assert described[0].floating_point_range
    assert described[4].type == ParameterType.PARAMETER_STRING_ARRAY
    assert "listening" in described[5].additional_constraints
    assert not set_to("loop.lost_after_s", -1.0).successful
    assert set_to("attend", "nearest").successful
    assert set_to("predictor", "nothing").successful
    assert not change(Transition.TRANSITION_CONFIGURE)  # no such predictor
    assert "nothing" in gaze.text()
    assert set_to("predictor", "constant_velocity").successful
    assert change(Transition.TRANSITION_CONFIGURE)
    assert change(Transition.TRANSITION_ACTIVATE)
    refused = set_to("attend", "engaged")
    assert not refused.successful
    assert "unconfigured" in refused.reason
    assert change(Transition.TRANSITION_DEACTIVATE)
    assert change(Transition.TRANSITION_ACTIVATE)
    assert change(Transition.TRANSITION_DEACTIVATE)
    assert change(Transition.TRANSITION_CLEANUP)
    assert set_to("attend", "engaged").successful
    assert gaze.stop() == 0, gaze.text()
    assert np.isfinite(gz.load_log(stage.gaze_file).time_s).all()
