"""A Zenoh router, and a robot's controller and a person that speak ROS 2 by it."""

import json
import time

import zenoh

from builders.ports import free_port
from builders.ros2_wire import COMMANDS, NOW_S, POSES, STATES, UNIX_START_S, joint_state
from gazempc.errors import RobotError
from gazempc.live.sources.ros2 import Ros2Person
from gazempc.neck.spec import load_neck
from gazempc.robots.options import Ros2Options
from gazempc.robots.ros2 import Ros2Neck
from gazempc.ros2.wire import Ros2Network

NECK = load_neck("reference")


def zenoh_session(mode, port):
    config = zenoh.Config()
    where = "listen" if mode == "router" else "connect"
    for name, value in {
        "mode": mode,
        "listen/endpoints": ["tcp/127.0.0.1:0"],
        f"{where}/endpoints": [f"tcp/127.0.0.1:{port}"],
        "scouting/multicast/enabled": False,
        "scouting/delay": 0,
    }.items():
        config.insert_json5(name, json.dumps(value))
    return zenoh.open(config)


def wait_for(condition, timeout_s=15.0):
    until = time.monotonic() + timeout_s
    while not (found := condition()):
        assert time.monotonic() < until, "waited in vain"
        time.sleep(0.005)
    return found


class Scene:
    """Router and robot in one session, a person in it too, and the parts under test."""

    def __init__(self):
        self.port = free_port()
        self.network = Ros2Network(f"tcp/127.0.0.1:{self.port}")
        self.now_s = NOW_S
        self.opened = []
        self.start()

    def start(self, commands=COMMANDS, poses=POSES):
        self.router = zenoh_session("router", self.port)
        self.commands = self.router.declare_subscriber(commands, zenoh.handlers.FifoChannel(1000))
        self.states = self.router.declare_publisher(STATES, congestion_control=zenoh.CongestionControl.BLOCK)
        self.poses = self.router.declare_publisher(poses, congestion_control=zenoh.CongestionControl.BLOCK)

    def options(self, **fields):
        """Options of a neck of this scene."""
        about = {"endpoint": self.network.endpoint, "joint_names": ("pan", "tilt"), "command_topic": "head/command"}
        return Ros2Options(**about | fields)

    def neck(self, neck=NECK, connect_timeout_s=10.0, node_name="gazempc", **fields):
        options = self.options(**fields)
        to_loop_s = lambda unix_s: unix_s - UNIX_START_S  # noqa: E731
        made = Ros2Neck(neck, lambda: self.now_s, to_loop_s, options, connect_timeout_s, node_name)
        self.opened.append(made)
        return made

    def connected(self, neck=NECK, *args, **options):
        """A neck that has heard one joint state, without noticing it."""
        robot = self.neck(neck, *args, **options)
        if neck.reports_joints:
            # What is sent before anybody listens is lost; once the publisher has a match, one message is enough.
            listen = zenoh_listener(self.states, joint_state([0.0, 0.0], stamp=(UNIX_START_S + 299, 0)))
            with listen:
                robot.connect()
            robot.read_state()
        else:
            robot.connect()
        return robot

    def person(self, **options):
        made = Ros2Person(
            "/person/head",
            lambda: self.now_s,
            lambda unix_s: unix_s - UNIX_START_S,
            **({"network": self.network} | options),
        )
        self.opened.append(made)
        made.open()
        wait_for(lambda: self.poses.matching_status.matching)
        return made

    def sent(self, n):
        """The next n commands that the robot gets, and that there are no more."""
        samples = []

        def enough():
            while (sample := self.commands.try_recv()) is not None:
                samples.append(sample)
            return len(samples) >= n

        wait_for(enough)
        time.sleep(0.05)
        assert enough()
        assert len(samples) == n
        return samples

    def close(self):
        for part in self.opened:
            part.close()
        self.router.close()


class zenoh_listener:  # noqa: N801
    """Sends one message as soon as somebody listens."""

    def __init__(self, publisher, payload):
        self.publisher, self.payload, self.sent = publisher, payload, False
        self.listener = None

    def __enter__(self):
        def matched(status):
            if status.matching and not self.sent:
                self.sent = True
                self.publisher.put(self.payload)

        self.listener = self.publisher.declare_matching_listener(matched)

    def __exit__(self, *_):
        self.listener.undeclare()


def quiet(read):
    """What a call gives; None where the robot refuses."""
    try:
        return read()
    except RobotError:
        return None
