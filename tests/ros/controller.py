"""A scripted joint_trajectory_controller of a simulated neck with dead time.

It implements the semantics of ros2_controllers (Jazzy and later): a new trajectory replaces the previous one from the
present state on; quintic interpolation between points; a moving last point is refused. It publishes joint states and
the neck's frames, and records the motion of the joints.
"""

import argparse
import signal
import time

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import JointTrajectory

from gazempc.live.process import before_other_programs
from gazempc.neck.spec import load_neck
from gazempc.sim.simulated import SimulatedNeck

NAMES = ["head_pan_joint", "head_tilt_joint"]
PERIOD_S, STATES_EVERY = 0.002, 5


def quintic(first, last, lasts_s, at_s):
    """Position, velocity and acceleration between two states, each of shape (3, N)."""
    t = lasts_s
    ends = np.array([[1, t, t**2, t**3, t**4, t**5], [0, 1, 2 * t, 3 * t**2, 4 * t**3, 5 * t**4],
                     [0, 0, 2, 6 * t, 12 * t**2, 20 * t**3]])  # fmt: skip
    low = np.array([first[0], first[1], first[2] / 2.0])
    high = np.linalg.solve(ends[:, 3:], last - ends[:, :3] @ low)
    c, s = np.concatenate([low, high]), at_s
    powers = np.array([[1, s, s**2, s**3, s**4, s**5], [0, 1, 2 * s, 3 * s**2, 4 * s**3, 5 * s**4],
                       [0, 0, 2, 6 * s, 12 * s**2, 20 * s**3]])  # fmt: skip
    return powers @ c


class Controller:
    def __init__(self):
        self.times_s, self.states, self.start_s = np.zeros(1), np.zeros((1, 3, 2)), 0.0
        self.accepted, self.refused, self.last_s = 0, [], np.nan

    def at(self, now_s):
        if now_s >= self.start_s + self.times_s[-1]:
            end = np.zeros((3, 2))
            end[0] = self.states[-1][0]
            return end
        k = int(np.searchsorted(self.times_s, now_s - self.start_s, side="right"))
        first, last = self.states[k - 1], self.states[k]
        return quintic(first, last, self.times_s[k] - self.times_s[k - 1], now_s - self.start_s - self.times_s[k - 1])

    def take(self, message, now_s):
        points = message.points
        states = np.array([[p.positions, p.velocities, p.accelerations] for p in points])
        times_s = np.array([p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in points])
        why = ""
        if list(message.joint_names) != NAMES:
            why = f"joints {message.joint_names}"
        elif not np.isfinite(states).all() or (np.diff(times_s) <= 0.0).any() or times_s[0] <= 0.0:
            why = "numbers or times"
        elif np.abs(states[-1][1]).max() > 1e-6:
            why = "the last point moves"
        if why:
            self.refused.append(why)
            return
        self.accepted, self.last_s = self.accepted + 1, now_s
        here = self.at(now_s)[None]
        self.times_s, self.states, self.start_s = np.array([0.0, *times_s]), np.concatenate([here, states]), now_s


def frame(parent, child, at_m, rotation, stamp):
    made = TransformStamped(child_frame_id=child)
    made.header.frame_id, made.header.stamp = parent, stamp
    moved, turn = made.transform.translation, made.transform.rotation
    moved.x, moved.y, moved.z = map(float, at_m)
    turn.x, turn.y, turn.z, turn.w = map(float, rotation.as_quat())
    return made


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--neck", default="reference")
    parser.add_argument("--out")
    parser.add_argument("--position", type=float, nargs=2, default=[0.0, 0.0])
    arguments = parser.parse_args()
    neck, stopped = load_neck(arguments.neck), []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stopped.append(True))
    rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    node, controller = Node("head_controller"), Controller()
    controller.states[0, 0] = arguments.position
    plant = SimulatedNeck(neck, np.array(arguments.position), time.time)
    plant.connect()
    reliable = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
    commands = node.create_subscription(JointTrajectory, "/head_controller/joint_trajectory", lambda _: None, reliable)
    states = node.create_publisher(JointState, "/joint_states", 10)
    tf = node.create_publisher(TFMessage, "/tf", 10)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    static = node.create_publisher(TFMessage, "/tf_static", latched)
    still, geometry = Rotation.identity(), neck.geometry
    # Optical axes: z forward, x right.
    optical = Rotation.from_matrix([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    static.publish(TFMessage(transforms=[
        frame("tilt_link", "camera", np.add(geometry.eye_in_tilt_m, [0.05, 0.03, 0.1]), optical, Time()),
        frame("world", "base_link", [0.0, 0.0, 0.0], still, Time()),
    ]))  # fmt: skip
    rows, transports_ms = [], []
    due_s, k = time.time(), 0
    while not stopped:
        now_s = time.time()
        with commands.handle:
            while (found := commands.handle.take_message(JointTrajectory, False)) is not None:
                message, about = found
                transports_ms.append(1e-6 * (about["received_timestamp"] - about["source_timestamp"]))
                controller.take(message, now_s)
        state = controller.at(now_s)
        plant.send_command(state[0])
        true = plant.true_state()
        rows.append([now_s, *state.ravel(), *true.position_rad, *true.velocity_rad_s])
        if k % STATES_EVERY == 0:
            stamp = Time(sec=int(now_s), nanosec=int(1e9 * (now_s % 1.0)))
            message = JointState(name=["wheel", *NAMES])
            message.header.stamp = stamp
            message.position = [0.0, *true.position_rad.tolist()]
            message.velocity = [0.0, *true.velocity_rad_s.tolist()]
            states.publish(message)
            pan, tilt = true.position_rad
            tf.publish(TFMessage(transforms=[
                frame("base_link", "pan_link", [0.0, 0.0, 0.0], Rotation.from_euler("z", pan), stamp),
                frame("pan_link", "tilt_link", geometry.tilt_axis_in_pan_m, Rotation.from_euler("y", -tilt), stamp),
            ]))  # fmt: skip
        k += 1
        due_s = max(due_s + PERIOD_S, now_s)
        time.sleep(max(0.0, due_s - time.time()))
    if arguments.out:
        np.savez(
            arguments.out,
            rows=rows,
            accepted=controller.accepted,
            refused=controller.refused,
            last_s=controller.last_s,
            transports_ms=transports_ms,
        )
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    # Where permitted: tests run on busy computers, but robots and cameras are real-time.
    before_other_programs()
    main()
