"""The actions of the node `gaze`, by a client in another process: goals sent, replaced and cancelled."""

from builders.ros2_real import rclpy_or_skip

rclpy_or_skip()

import math

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from control_msgs.action import PointHead
from hri_actions_msgs.action import LookAt
from rclpy.action import ActionClient

import gazempc as gz
from gazempc.neck.kinematics import gaze_error_rad

pytestmark = pytest.mark.slow
NECK = gz.load_neck("reference")
OK, CANCELED, ABORTED = GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED


def point_head(at_m, frame="base_link", pointing_frame="", axis=(1.0, 0.0, 0.0), min_s=0.0, max_rad_s=0.0):
    goal = PointHead.Goal()
    goal.target.header.frame_id = frame
    goal.target.point.x, goal.target.point.y, goal.target.point.z = map(float, at_m)
    goal.pointing_frame, goal.max_velocity = pointing_frame, max_rad_s
    goal.pointing_axis.x, goal.pointing_axis.y, goal.pointing_axis.z = axis
    goal.min_duration.sec, goal.min_duration.nanosec = int(min_s), int(1e9 * (min_s % 1.0))
    return goal


class Head:
    """A client of both actions, and the joints."""

    def __init__(self, client):
        from sensor_msgs.msg import JointState

        self.client = client
        self.points = ActionClient(client.node, PointHead, "/gaze/point_head")
        self.looks = ActionClient(client.node, LookAt, "/gaze/look_at")
        client.wait(lambda: self.points.server_is_ready() and self.looks.server_is_ready())
        client.listen(JointState, "/joint_states")
        self.errors_rad = []

    def send(self, goal):
        actions = self.points if isinstance(goal, PointHead.Goal) else self.looks
        feedback = lambda message: self.errors_rad.append(message.feedback.pointing_angle_error)  # noqa: E731
        kept = {"feedback_callback": feedback} if actions is self.points else {}
        return self.client.result(actions.send_goal_async(goal, **kept))

    def end(self, handle, timeout_s=60.0):
        return self.client.result(handle.get_result_async(), timeout_s).status

    def joints_rad(self):
        received = self.client.received["/joint_states"]
        received.clear()
        self.client.wait(lambda: received)
        return np.array(received[-1].position[1:])

    def off_rad(self, at_m):
        return float(gaze_error_rad(NECK.geometry, self.joints_rad(), np.array(at_m)))


def test_goals_of_both_actions_succeed_abort_and_cancel(stage):
    """One node for all cases, since processes start slowly."""
    controller, gaze = stage.controller(), stage.gaze()
    gaze.until("robot ros2")
    head = Head(stage.client())

    # A target in the base frame: reached, with feedback that falls.
    place_m = [1.0, 0.7, -0.2]
    assert head.end(head.send(point_head(place_m))) == OK
    assert head.off_rad(place_m) < 0.035
    assert head.errors_rad[0] > 0.3
    assert head.errors_rad[-1] <= 0.03

    # The optical axis of a camera beside the eye, in the camera's frame.
    assert head.end(head.send(point_head([1.5, -0.4, 0.1], "base_link", "camera", (0.0, 0.0, 1.0)))) == OK
    pan, tilt = head.joints_rad()
    ray = np.array([math.cos(pan) * math.cos(tilt), math.sin(pan) * math.cos(tilt), math.sin(tilt)])
    left, up = np.array([-math.sin(pan), math.cos(pan), 0.0]), np.cross(ray, [-math.sin(pan), math.cos(pan), 0.0])
    eye_m = 0.05 * ray + 0.03 * left + 0.1 * up
    to = np.array([1.5, -0.4, 0.1]) - eye_m
    assert math.acos(ray @ to / np.linalg.norm(to)) < 0.035

    # LookAt, replaced by a newer goal of the other action.
    looked = LookAt.Goal(look_goal=point_head([1.0, 0.9, 0.3]).target)
    first = head.send(looked)
    assert first.accepted
    second = head.send(point_head([1.0, -0.5, 0.0]))
    assert head.end(first) == ABORTED
    assert head.end(second) == OK
    assert head.end(head.send(looked)) == OK
    assert head.off_rad([1.0, 0.9, 0.3]) < 0.035

    # Cancelled on the way.
    slow = head.send(point_head([1.0, -1.5, 0.0], min_s=6.0))
    stage.client().for_s(1.0)
    stage.client().result(slow.cancel_goal_async())
    assert head.end(slow) == CANCELED

    # Behind the robot: the neck goes to its limit, and the goal ends as aborted.
    behind = head.send(point_head([-1.0, 0.2, 0.0]))
    assert head.end(behind) == ABORTED
    assert head.joints_rad()[0] == pytest.approx(NECK.position_max_rad[0], abs=0.02)
    assert "cannot reach the target" in gaze.text()

    # Neither NaN nor a target without a frame; an unknown frame ends after a second.
    assert not head.send(point_head([math.nan, 0.0, 0.0])).accepted
    assert not head.send(point_head([1.0, 0.0, 0.0], frame="")).accepted
    assert head.end(head.send(point_head([1.0, 0.0, 0.0], frame="nowhere"))) == ABORTED
    assert "no transform of 'nowhere'" in gaze.text()

    # A hundred goals in a second: all but the last are replaced. The middleware keeps the ten newest requests, so
    # a busy computer may lose some.
    sent = []
    for k in range(100):
        sent.append(head.points.send_goal_async(point_head([1.0, 0.2 * math.sin(0.3 * k), 0.0])))
        stage.client().for_s(0.01)
    last = head.send(point_head([1.0, 0.4, 0.0]))
    assert head.end(last) == OK
    answered = [each.result() for each in sent if each.done()]
    assert len(answered) >= 30
    ends = [head.end(handle) for handle in answered]
    # A goal just reached succeeds.
    assert ends.count(ABORTED) >= 0.9 * len(ends)
    assert set(ends) <= {ABORTED, OK}

    assert gaze.stop() == 0, gaze.text()
    assert controller.stop() == 0
    times_s, _, _, speeds_rad_s, file = stage.rows()
    assert list(file["refused"]) == []
    assert abs(speeds_rad_s).max() <= 1.03 * NECK.velocity_max_rad_s.max()
    assert gz.measure(gz.load_log(stage.gaze_file)).limit_violations == 0
    assert times_s.size > 1000


def test_a_slow_goal_keeps_its_speed_limit_and_attention_resumes(stage):
    controller, gaze = stage.controller(), stage.gaze()
    gaze.until("robot ros2")
    head = Head(stage.client())
    assert head.end(head.send(point_head([1.0, 1.0, 0.0], max_rad_s=0.4))) == OK
    stage.client().for_s(0.5)
    gaze.stop()
    controller.stop()
    _, _, joints_rad, _, _ = stage.rows()
    # Duration from 5 to 95 % of the angle, against a minimum-jerk path whose peak velocity, 15/8 of the mean, is the
    # limit. The peak of the commands itself depends on the computer: after a late tick the command returns to the path.
    share = np.linspace(0.0, 1.0, 1001)
    begins, ends = np.interp((0.05, 0.95), share**3 * (10.0 - 15.0 * share + 6.0 * share**2), share)
    shortest_s = (ends - begins) * 15.0 / 8.0 * (math.pi / 4) / 0.4
    log = gz.load_log(stage.gaze_file)
    covered = log.command_position_rad[:, 0] / (math.pi / 4)
    took_s = log.time_s[np.argmax(covered >= 0.95)] - log.time_s[np.argmax(covered >= 0.05)]
    assert shortest_s <= took_s < 1.5 * shortest_s
    assert joints_rad[-1, 0] == pytest.approx(math.pi / 4, abs=0.035)
