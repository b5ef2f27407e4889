"""A scripted tracker: a recorded walk in a moving frame, with the sensor's delay and noise."""

import argparse
import math
import signal
import time

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from controller import frame
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from scipy.spatial.transform import Rotation
from tf2_msgs.msg import TFMessage

from gazempc.live.clock import RealClock
from gazempc.live.process import before_other_programs
from gazempc.live.sources.replay import ReplaySource
from gazempc.neck.spec import load_neck
from gazempc.recordings.recording import TrueHead
from gazempc.sim.scene import SceneSettings, make_scene

WARM_UP_S = 1.5


def stamp_of(unix_s):
    whole = math.floor(unix_s)
    return Time(sec=whole, nanosec=int(1e9 * (unix_s - whole)))


def sensor_pose(unix_s):
    """The sensor turns and rises, as on a torso that moves."""
    turn = Rotation.from_euler("zy", [0.6 * math.sin(1.5 * unix_s), 0.15 * math.sin(0.9 * unix_s)])
    return turn, np.array([0.1, 0.0, 0.3 + 0.1 * math.sin(unix_s)])


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--out")
    parser.add_argument("--name", default="tracker")
    parser.add_argument("--passes", type=int, default=1)
    parser.add_argument("--jump-after-s", type=float, default=math.inf)
    parser.add_argument("--silent-tf-after-s", type=float, default=math.inf)
    parser.add_argument("--nan-every", type=int, default=0)
    parser.add_argument("--stamp-offset-s", type=float, default=0.0)
    parser.add_argument("--clock-jump-after-s", type=float, default=math.inf)
    parser.add_argument("--sim-time", action="store_true")
    arguments = parser.parse_args()
    stopped = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stopped.append(True))
    scene = make_scene("subject03_R4", SceneSettings(), load_neck("reference"))
    clock = RealClock()
    source = ReplaySource(scene.walk, scene.sensor, 0, clock, arguments.passes, ())
    true_head = TrueHead(scene.walk)
    rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    node = Node(arguments.name)
    poses = node.create_publisher(PoseStamped, "/person/pose", 10)
    tf = node.create_publisher(TFMessage, "/tf", 10)
    if arguments.sim_time:
        from rosgraph_msgs.msg import Clock

        clocks = node.create_publisher(Clock, "/clock", 1)

    def ros_s(unix_s, start_s):
        """Stamps: of this computer, or of a simulation that begins at 100 s and may be reset."""
        if not arguments.sim_time:
            return unix_s + arguments.stamp_offset_s
        past_s = unix_s - start_s
        return 100.0 + past_s - (90.0 if past_s > arguments.clock_jump_after_s else 0.0)

    while not stopped and not poses.get_subscription_count():
        time.sleep(0.01)
    start_s, sent, tf_due_s, rows, walks = time.time(), 0, 0.0, [], False
    while not stopped and not source.finished:
        now_s = time.time()
        # Transforms are sent before the first head.
        if not walks and now_s - start_s > WARM_UP_S:
            walks = True
            source.open()
        if arguments.sim_time:
            clocks.publish(Clock(clock=stamp_of(ros_s(now_s, start_s))))
        if now_s >= tf_due_s and now_s - start_s < arguments.silent_tf_after_s:
            tf_due_s = now_s + 0.01
            turn, at_m = sensor_pose(now_s)
            if now_s - start_s > arguments.jump_after_s:
                at_m = np.add(at_m, [0.0, 30.0, 0.0])
            tf.publish(
                TFMessage(transforms=[frame("base_link", "sensor", at_m, turn, stamp_of(ros_s(now_s, start_s)))])
            )
        for sighting in source.poll().sightings if walks else ():
            seen = sighting.observation
            captured_s = now_s - (clock.now_s() - seen.capture_time_s)
            turn, at_m = sensor_pose(captured_s)
            message = PoseStamped()
            message.header.frame_id, message.header.stamp = "sensor", stamp_of(ros_s(captured_s, start_s))
            place = turn.inv().apply(seen.head_position_base_m - at_m)
            sent += 1
            if arguments.nan_every and sent % arguments.nan_every == 0:
                place = place * np.nan
            message.pose.position.x, message.pose.position.y, message.pose.position.z = map(float, place)
            message.pose.orientation.w = 0.0
            poses.publish(message)
            head_m = true_head(source.own_s(np.array([seen.capture_time_s])))[0]
            rows.append([captured_s, time.time(), *head_m])
        time.sleep(0.001)
    if arguments.out:
        np.save(arguments.out, rows)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    # Where permitted: tests run on busy computers, but robots and cameras are real-time.
    before_other_programs()
    main()
