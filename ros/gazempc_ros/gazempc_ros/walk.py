"""The node `walk`: a recorded walk in the format of a tracker, for tests and demonstrations without a person."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.time import Time

from gazempc.live.clock import RealClock
from gazempc.live.sources.replay import ReplaySource
from gazempc.neck.spec import load_neck
from gazempc.sim.scene import SceneSettings, make_scene

_PAUSE_S = 2.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Send the walk once or repeatedly."""
    rclpy.init(args=arguments)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        _send(Node("walk"))
    rclpy.try_shutdown()
    return 0


def _send(node: Node) -> None:
    def ask(name: str, default: object) -> object:
        return node.declare_parameter(name, default).value

    recording, topic, frame = ask("recording", "subject03_R4"), ask("topic", "/person/pose"), ask("frame", "gaze_neck")
    passes, neck = ask("passes", 1000), ask("neck", "reference")
    clock, settings = RealClock(), SceneSettings(neck=str(neck))
    scene = make_scene(str(recording), settings, load_neck(str(neck)))
    publisher = node.create_publisher(PoseStamped, str(topic), 10)
    # The sensor's delay begins with the first listener.
    while rclpy.ok() and not publisher.get_subscription_count():
        rclpy.spin_once(node, timeout_sec=0.05)
    for number in range(int(str(passes))):
        source = ReplaySource(scene.walk, scene.sensor, number, clock, 1, ())
        source.open()
        while rclpy.ok() and not source.finished:
            rclpy.spin_once(node, timeout_sec=0.0)
            for sighting in source.poll().sightings:
                seen = sighting.observation
                age_s = clock.now_s() - seen.capture_time_s
                stamp = node.get_clock().now().nanoseconds - round(1e9 * age_s)
                message = PoseStamped()
                message.header.frame_id, message.header.stamp = str(frame), Time(nanoseconds=stamp).to_msg()
                at, turn = message.pose.position, message.pose.orientation
                at.x, at.y, at.z = map(float, seen.head_position_base_m)
                if seen.head_quat_wxyz is None:
                    turn.w = 0.0
                else:
                    turn.w, turn.x, turn.y, turn.z = map(float, seen.head_quat_wxyz)
                publisher.publish(message)
            time.sleep(0.002)
        # No person is present between two passes.
        until_s = clock.now_s() + _PAUSE_S
        while rclpy.ok() and clock.now_s() < until_s:
            rclpy.spin_once(node, timeout_sec=0.05)


if __name__ == "__main__":
    raise SystemExit(main())
