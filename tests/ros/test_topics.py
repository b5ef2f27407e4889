"""Topics of the node `gaze`: the choice of a person, and looking away."""

from builders.ros2_real import rclpy_or_skip

rclpy_or_skip()

import itertools
import math

import numpy as np
import pytest
from rclpy.time import Time
from std_msgs.msg import String
from test_ros_faults import Watch
from vision_msgs.msg import Detection3D, Detection3DArray

import gazempc as gz

pytestmark = pytest.mark.slow
# The nearer one is on the left.
PEOPLE_M = {"left": [1.5, 1.0, 0.2], "right": [2.0, -1.2, 0.2]}


class People:
    """Two people who stand still, 30 detections a second."""

    def __init__(self, client):
        self.client, self.frames = client, itertools.count()
        self.publisher = client.node.create_publisher(Detection3DArray, "/people", 10)
        client.node.create_timer(1 / 30, self.send)

    def send(self):
        stamp = self.client.node.get_clock().now().nanoseconds - 30_000_000
        message = Detection3DArray()
        message.header.frame_id, message.header.stamp = "base_link", Time(nanoseconds=stamp).to_msg()
        sway_m = 0.003 * math.sin(0.2 * next(self.frames))
        for name, place_m in PEOPLE_M.items():
            seen = Detection3D(id=name)
            at = seen.bbox.center.position
            at.x, at.y, at.z = place_m[0] + sway_m, place_m[1], place_m[2]
            seen.bbox.center.orientation.w = 1.0
            message.detections.append(seen)
        self.publisher.publish(message)


def test_a_person_is_selected_and_the_gaze_averted(stage):
    client = stage.client()
    watch, people = Watch(client), People(client)
    settings = {"source": "ros2:/people", "options.ros2.pose_type": "vision_msgs/msg/Detection3DArray"}
    gaze = stage.gaze(robot="simulated", attend="nearest", **settings)
    topics = {name: client.node.create_publisher(String, f"/gaze/{name}", 1) for name in ("attend", "look_away")}

    def off_deg(name):
        """Between the pan joint and a person; large before the first diagnostics."""
        values = watch.latest()
        pan_deg = float(values["joints_deg"].strip("[]").split(",")[0]) if "joints_deg" in values else 180.0
        x_m, y_m, _ = PEOPLE_M[name]
        return abs(pan_deg - math.degrees(math.atan2(y_m, x_m)))

    def until_looks_at(name):
        client.wait(lambda: off_deg(name) < 3.0, why=f"not at {name}: {watch.latest()} {gaze.text()}")

    gaze.until("robot simulated")
    client.wait(lambda: all(each.get_subscription_count() for each in topics.values()))
    until_looks_at("left")
    topics["attend"].publish(String(data="right"))
    until_looks_at("right")
    topics["attend"].publish(String(data=""))
    until_looks_at("left")
    topics["look_away"].publish(String(data="at once"))
    gaze.until("accepted: thinking, listening, speaking, told")
    topics["look_away"].publish(String(data="thinking"))
    client.for_s(4.0)
    until_looks_at("left")
    assert people.publisher.get_subscription_count() == 1
    assert gaze.stop() == 0, gaze.text()
    log = gz.load_log(stage.gaze_file)
    assert gz.measure(log).limit_violations == 0
    # The diagnostics come once a second; the log has the whole motion. Between the choices and after them.
    pan_deg = np.rad2deg(log.command_position_rad[log.time_s > log.time_s[-1] - 5.0, 0])
    left_deg = math.degrees(math.atan2(*PEOPLE_M["left"][1::-1]))
    assert np.abs(pan_deg - left_deg).max() > 6.0
