"""ROS 2 over Zenoh against a robot and a person that know the wire only: every byte is packed and read by hand here.

A Zenoh session of the test is router and robot. CDR by hand: little-endian, each number aligned to its own size,
counted from the end of the four bytes of header; strings with length and final zero; sequences with their count.
"""

import contextlib
import itertools
import json
import random
import socket
import struct
import subprocess
import sys
import time

import numpy as np
import pytest
import zenoh

from gazempc.errors import MissingOptionalDependencyError, RobotError, SettingsError
from gazempc.live.sources.ros2 import Ros2Person
from gazempc.live.sources.source import SourceError
from gazempc.neck.spec import load_neck
from gazempc.robots.ros2 import Ros2Neck
from gazempc.ros2 import wire as ros2_wire
from gazempc.ros2.wire import Ros2Network

NECK = load_neck("reference")
# From the sources that rosidl generated for ROS 2 Jazzy, and from `ros2 topic info --verbose`.
HASHES = {
    "std_msgs/msg/String": "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "std_msgs/msg/Float64MultiArray": "1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f",
    "trajectory_msgs/msg/JointTrajectory": "179b33eba59d676f6d967ac71fe35e7ca2f64b2f3928f4a018cec115e213796e",
    "sensor_msgs/msg/JointState": "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    "geometry_msgs/msg/PoseStamped": "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
}
TRAJECTORY, POSITIONS = "trajectory_msgs/msg/JointTrajectory", "std_msgs/msg/Float64MultiArray"


def key(domain, topic, type_name, digest=None):
    package, _, name = type_name.split("/")
    return f"{domain}/{topic}/{package}::msg::dds_::{name}_/{digest or 'RIHS01_' + HASHES[type_name]}"


COMMANDS = key(0, "head/command", TRAJECTORY)
STATES = key(0, "joint_states", "sensor_msgs/msg/JointState")
POSES = key(0, "person/head", "geometry_msgs/msg/PoseStamped")
# The loop's clock began at this Unix time, and now it is 300.3 s later.
UNIX_START_S = 1763718000
NOW_S = 300.3


class Packer:
    def __init__(self):
        self.data = b""

    def number(self, form, value):
        size = struct.calcsize(form)
        self.data += b"\0" * (-len(self.data) % size) + struct.pack("<" + form, value)
        return self

    def string(self, text):
        encoded = text.encode() + b"\0"
        self.number("I", len(encoded)).data += encoded
        return self

    def numbers(self, values):
        self.number("I", len(values))
        for value in values:
            self.number("d", value)
        return self

    def header(self, sec, nanosec, frame_id=""):
        return self.number("i", sec).number("I", nanosec).string(frame_id)

    def done(self):
        return b"\0\1\0\0" + self.data


class Reader:
    def __init__(self, data):
        assert data[:4] == b"\0\1\0\0"
        self.data, self.at = data[4:], 0

    def number(self, form):
        size = struct.calcsize(form)
        self.at += -self.at % size
        (value,) = struct.unpack_from("<" + form, self.data, self.at)
        self.at += size
        return value

    def string(self):
        size = self.number("I")
        text = self.data[self.at : self.at + size]
        assert text[-1:] == b"\0"
        self.at += size
        return text[:-1].decode()

    def numbers(self):
        return [self.number("d") for _ in range(self.number("I"))]

    def finish(self):
        assert self.at == len(self.data)


def read_trajectory(data):
    r = Reader(data)
    found = {"stamp": (r.number("i"), r.number("I")), "frame_id": r.string()}
    found["names"] = [r.string() for _ in range(r.number("I"))]
    assert r.number("I") == 1  # points
    found["positions"] = r.numbers()
    found["rest"] = [r.numbers(), r.numbers(), r.numbers()]  # velocities, accelerations, effort
    found["time_from_start"] = (r.number("i"), r.number("I"))
    r.finish()
    return found


def read_positions(data):
    r = Reader(data)
    assert r.number("I") == 0  # dimensions
    assert r.number("I") == 0  # offset
    values = r.numbers()
    r.finish()
    return values


def joint_state(positions, names=("pan", "tilt"), velocities=(0.5, -0.25), stamp=(UNIX_START_S + 300, 250_000_000)):
    p = Packer().header(*stamp, "base").number("I", len(names))
    for name in names:
        p.string(name)
    return p.numbers(positions).numbers(velocities).numbers([]).done()


def pose(position, xyzw=(0.0, 0.0, 0.0, 1.0), stamp=(UNIX_START_S + 300, 250_000_000), frame_id="camera_link"):
    p = Packer().header(*stamp, frame_id)
    for value in (*position, *xyzw):
        p.number("d", value)
    return p.done()


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


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

    def start(self, commands=COMMANDS):
        self.router = zenoh_session("router", self.port)
        self.commands = self.router.declare_subscriber(commands, zenoh.handlers.FifoChannel(1000))
        self.states = self.router.declare_publisher(STATES, congestion_control=zenoh.CongestionControl.BLOCK)
        self.poses = self.router.declare_publisher(POSES, congestion_control=zenoh.CongestionControl.BLOCK)

    def neck(self, neck=NECK, names=("pan", "tilt"), topic="head/command", **options):
        options = {"network": self.network, "connect_timeout_s": 10.0} | options
        made = Ros2Neck(neck, lambda: self.now_s, lambda unix_s: unix_s - UNIX_START_S, names, topic, **options)
        self.opened.append(made)
        return made

    def connected(self, *args, **options):
        """A neck that has heard one joint state, without noticing it."""
        robot = self.neck(*args, **options)
        if robot._neck.reports_joints:
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


@pytest.fixture
def scene():
    made = Scene()
    yield made
    made.close()


@pytest.mark.parametrize("type_name", HASHES)
def test_keys_are_those_of_ros(type_name):
    assert ros2_wire.topic_key(0, "/head/command", type_name) == key(0, "head/command", type_name)
    humble = ros2_wire.topic_key(7, "/head/command", type_name, humble=True)
    assert humble == key(7, "head/command", type_name, "TypeHashNotSupported")


def test_key_is_the_example_of_rmw_zenoh():
    expected = "2/robot1/chatter/std_msgs::msg::dds_::String_/RIHS01_" + HASHES["std_msgs/msg/String"]
    assert ros2_wire.topic_key(2, ros2_wire.topic_name("robot1/chatter"), "std_msgs/msg/String") == expected


def test_attachment_is_that_of_rmw_zenoh():
    gid = bytes(range(16))
    assert ros2_wire.attachment(258, -2, gid).hex() == "0201000000000000" + "feffffffffffffff" + "10" + gid.hex()
    # Zenoh's own serialiser, which rmw_zenoh uses, agrees.
    by_zenoh = zenoh.ext.z_serialize((zenoh.ext.Int64(258), zenoh.ext.Int64(-2), gid))
    assert ros2_wire.attachment(258, -2, gid) == by_zenoh.to_bytes()


def test_every_command_arrives_in_order_and_is_what_was_returned(scene):
    robot = scene.connected(time_from_start_s=1.25)
    began_ns = time.time_ns()
    rng = np.random.default_rng(1)
    asked = rng.uniform(-2.0, 2.0, (250, 2))  # most are beyond the limits
    returned, samples = [], []
    for rad in asked:
        # In step: of a burst that a busy computer cannot get rid of, Zenoh drops some, as no command may wait.
        returned.append(robot.send_command(rad))
        samples.append(wait_for(scene.commands.try_recv))
    assert np.array_equal(returned, np.clip(asked, NECK.position_min_rad, NECK.position_max_rad))
    for number, (sample, rad) in enumerate(zip(samples, returned, strict=True), start=1):
        found = read_trajectory(sample.payload.to_bytes())
        assert found == {
            "stamp": (0, 0),
            "frame_id": "",
            "names": ["pan", "tilt"],
            "positions": list(rad),
            "rest": [[], [], []],
            "time_from_start": (1, 250_000_000),
        }
        sequence, sent_ns, gid_size = struct.unpack_from("<qqB", sample.attachment.to_bytes())
        assert (sequence, gid_size, len(sample.attachment)) == (number, 16, 33)
        assert began_ns <= sent_ns <= time.time_ns()
    assert len({sample.attachment.to_bytes()[17:] for sample in samples}) == 1


def test_time_from_start_is_the_time_between_two_commands(scene):
    robot = scene.connected()
    robot.send_command(np.zeros(2))
    (sample,) = scene.sent(1)
    assert read_trajectory(sample.payload.to_bytes())["time_from_start"] == (0, 5_000_000)


def test_bare_positions_with_a_joint_that_turns_the_other_way(scene):
    scene.commands = scene.router.declare_subscriber(key(0, "head/command", POSITIONS), zenoh.handlers.FifoChannel(9))
    robot = scene.connected(command_type=POSITIONS, joint_signs=(1, -1))
    assert np.array_equal(robot.send_command(np.array([0.3, 0.2])), [0.3, 0.2])
    assert np.array_equal(robot.send_command(np.array([9.0, 9.0])), NECK.position_max_rad)
    first, second = (read_positions(sample.payload.to_bytes()) for sample in scene.sent(2))
    assert first == [0.3, -0.2]
    assert second == [NECK.position_max_rad[0], -NECK.position_max_rad[1]]
    scene.states.put(joint_state([0.1, 0.2], velocities=[1.0, 2.0]))
    state = wait_for(robot.read_state)
    assert (list(state.position_rad), list(state.velocity_rad_s)) == ([0.1, -0.2], [1.0, -2.0])


@pytest.mark.parametrize("bad", [[np.nan, 0.0], [0.0, np.inf], [0.0], [0.0, 0.0, 0.0]])
def test_a_command_that_is_none_is_refused_and_not_sent(scene, bad):
    robot = scene.connected()
    with pytest.raises(RobotError, match="refused"):
        robot.send_command(np.array(bad))
    robot.send_command(np.array([0.1, 0.1]))
    scene.sent(1)


def test_joint_states_by_name_with_their_own_time(scene):
    robot = scene.connected()
    assert robot.read_state() is None
    names = ["wheel", "tilt", "arm", "pan"]
    scene.states.put(joint_state([9.0, 0.25, 8.0, -0.5], names, [9.0, 2.0, 8.0, 1.0]))
    state = wait_for(robot.read_state)
    assert state.time_s == 300.25
    assert list(state.position_rad) == [-0.5, 0.25]
    assert list(state.velocity_rad_s) == [1.0, 2.0]
    assert robot.read_state() is None
    assert robot.ignored == 0


def test_of_many_joint_states_the_newest_counts(scene):
    robot = scene.connected()
    for k in range(20):
        scene.states.put(joint_state([0.01 * k, 0.0], stamp=(UNIX_START_S + 300, k * 1_000_001)))
    seen = []

    def last():
        if (state := robot.read_state()) is not None:
            seen.append(state)
        return seen and seen[-1].position_rad[0] == 0.01 * 19

    wait_for(last)
    assert seen[-1].time_s == pytest.approx(300 + 19e-9 * 1_000_001, abs=1e-6)  # a float of Unix time
    assert all(a.time_s < b.time_s for a, b in itertools.pairwise(seen))


def test_velocities_that_are_not_reported_are_not_made_up(scene):
    robot = scene.connected()
    scene.states.put(joint_state([0.1, 0.2], velocities=[]))
    state = wait_for(robot.read_state)
    assert list(state.position_rad) == [0.1, 0.2]
    assert np.isnan(state.velocity_rad_s).all()
    assert state.velocity_rad_s.shape == (2,)


GOOD = joint_state([0.1, 0.2])
UNUSABLE = {
    "no joint 'tilt', only pan, neck": joint_state([0.1, 0.2], names=["pan", "neck"]),
    "2 names and 1 positions": joint_state([0.1]),
    "not finite": joint_state([0.1, np.nan]),
    "no time stamp": joint_state([0.1, 0.2], stamp=(0, 0)),
    r"-300.3 s from this computer's clock": joint_state([0.1, 0.2], stamp=(UNIX_START_S, 0)),
    r"\+9.7 s from this computer's clock": joint_state([0.1, 0.2], stamp=(UNIX_START_S + 310, 0)),
    "not newer": joint_state([0.1, 0.2], stamp=(UNIX_START_S + 298, 0)),
    "not a sensor_msgs/msg/JointState in CDR": b"",
    "not a sensor_msgs/msg/JointState in CD": GOOD[:-9],
    "not a sensor_msgs/msg/JointState in C": b"\0\3" + GOOD[2:],  # another encapsulation
    "not a sensor_msgs/msg/JointState in": GOOD + bytes(8),
    # 2 billion names
    "not a sensor_msgs/msg/JointState": GOOD[:24] + b"\xff\xff\xff\x7f" + GOOD[28:],
}


@pytest.mark.parametrize("reason", UNUSABLE)
def test_what_cannot_be_used_is_counted_and_its_reason_named(scene, reason):
    robot = scene.connected()
    scene.states.put(UNUSABLE[reason])
    wait_for(lambda: robot.read_state() or robot.ignored)
    assert robot.ignored == 1
    assert robot.read_state() is None
    scene.now_s += 0.6
    with pytest.raises(RobotError, match=rf"no joint state on /joint_states .* not used: .*{reason}"):
        robot.read_state()
    scene.states.put(joint_state([0.1, 0.2], stamp=(UNIX_START_S + 300, 500_000_000)))
    assert wait_for(lambda: quiet(robot.read_state)).time_s == 300.5


def quiet(read):
    try:
        return read()
    except RobotError:
        return None


def test_any_bytes_are_survived():
    rng = random.Random(5)
    whole = {"sensor_msgs/msg/JointState": GOOD, "geometry_msgs/msg/PoseStamped": pose([1.0, 2.0, 3.0])}
    for type_name, data in whole.items():
        tried = [data[:n] for n in range(len(data))] + [rng.randbytes(rng.randrange(200)) for _ in range(200)]
        for _ in range(500):
            broken = bytearray(data)
            for _ in range(rng.randrange(1, 6)):
                broken[rng.randrange(len(broken))] = rng.randrange(256)
            tried.append(bytes(broken))
        for payload in tried:
            with contextlib.suppress(ros2_wire.WireError):
                ros2_wire.decode(payload, type_name)


def test_silence_is_an_error_until_the_robot_speaks_again(scene):
    robot = scene.connected(silent_after_s=0.4)
    scene.now_s += 0.39
    assert robot.read_state() is None
    scene.now_s += 0.02
    with pytest.raises(RobotError, match=r"no joint state on /joint_states for more than 0\.4 s"):
        robot.read_state()
    # It comes back with a clock that is behind: what it says now counts.
    scene.states.put(joint_state([0.1, 0.2], stamp=(UNIX_START_S + 297, 0)))
    assert wait_for(lambda: quiet(robot.read_state)).time_s == 297.0
    assert robot.read_state() is None


def test_a_neck_without_encoders_asks_for_no_joint_states(scene):
    neck = NECK.model_copy(update={"reports_joints": False})
    robot = scene.connected(neck)
    scene.now_s += 100.0
    assert robot.read_state() is None
    assert not scene.states.matching_status.matching
    robot.send_command(np.zeros(2))
    scene.sent(1)


def test_the_router_goes_and_comes_back(scene):
    robot = scene.connected()
    scene.router.close()
    wait_for(lambda: not robot._node.connected)  # a moment before it has no listeners any more
    durations = []
    for _ in range(50):
        began = time.perf_counter()
        for call in (robot.read_state, lambda: robot.send_command(np.zeros(2))):
            with pytest.raises(RobotError, match=r"the Zenoh router at tcp/127\.0\.0\.1:\d+ has gone"):
                call()
        durations.append(time.perf_counter() - began)
    assert np.median(durations) < 0.005
    scene.start()
    sent = wait_for(lambda: quiet(lambda: robot.send_command(np.array([0.1, 0.2]))) is not None)
    assert sent
    (sample,) = scene.sent(1)
    assert read_trajectory(sample.payload.to_bytes())["positions"] == [0.1, 0.2]
    wait_for(lambda: scene.states.matching_status.matching)
    scene.states.put(GOOD)
    assert wait_for(lambda: quiet(robot.read_state)).time_s == 300.25


@pytest.mark.parametrize("mode", ["peer", "client"])  # peer: what nodes of rmw_zenoh are unless told otherwise
def test_the_controller_goes_and_comes_back(scene, mode):
    scene.commands.undeclare()
    controller = zenoh_session(mode, scene.port)
    received = controller.declare_subscriber(COMMANDS, zenoh.handlers.FifoChannel(9))
    robot = scene.connected()
    robot.send_command(np.zeros(2))
    wait_for(received.try_recv)
    controller.close()
    wait_for(lambda: quiet(lambda: robot.send_command(np.zeros(2))) is None)
    with pytest.raises(RobotError, match="nobody listens to the commands on /head/command"):
        robot.send_command(np.zeros(2))
    scene.commands = scene.router.declare_subscriber(COMMANDS, zenoh.handlers.FifoChannel(9))
    wait_for(lambda: quiet(lambda: robot.send_command(np.zeros(2))) is not None)
    scene.sent(1)


def test_node_and_topics_are_visible_in_the_graph(scene):
    def tokens():
        replies = scene.router.liveliness().get("@ros2_lv/**", timeout=2.0)
        return sorted(str(reply.ok.key_expr) for reply in replies)

    robot = scene.connected(node_name="gaze")
    zid = str(robot._node._session.zid())
    digest = {name: f"RIHS01_{value}" for name, value in HASHES.items()}
    state = f"sensor_msgs::msg::dds_::JointState_/{digest['sensor_msgs/msg/JointState']}"
    assert wait_for(tokens) == [
        f"@ros2_lv/0/{zid}/0/0/NN/%/%/gaze",
        f"@ros2_lv/0/{zid}/0/1/MP/%/%/gaze/%head%command/trajectory_msgs::msg::dds_::JointTrajectory_/"
        f"{digest[TRAJECTORY]}/::,10:,:,:,,",
        f"@ros2_lv/0/{zid}/0/2/MS/%/%/gaze/%joint_states/{state}/::,10:,:,:,,",
    ]
    robot.close()
    wait_for(lambda: not tokens())


def test_connect_names_a_router_that_does_not_answer():
    robot = Ros2Neck(
        NECK, time.monotonic, float, ("pan", "tilt"), "c", network=Ros2Network(f"tcp/127.0.0.1:{free_port()}")
    )
    with pytest.raises(RobotError, match=r"no Zenoh router answers at tcp/127.0.0.1:\d+: start one"):
        robot.connect()
    with pytest.raises(RobotError, match="not connected"):
        robot.read_state()


def announce(scene, kind, topic, type_name, domain=0):
    token = key(domain, topic, type_name).split("/")[-2:]
    return scene.router.liveliness().declare_token(
        f"@ros2_lv/{domain}/abc/0/5/{kind}/%/%/someone/%{topic.replace('/', '%')}/{token[0]}/{token[1]}/::,10:,:,:,,"
    )


def test_connect_says_why_nobody_takes_the_commands(scene):
    robot = scene.neck(topic="other", connect_timeout_s=0.1)
    with pytest.raises(RobotError, match=f"nobody listens to /other as {TRAJECTORY} in ROS 2 domain 0: is that node"):
        robot.connect()
    kept = announce(scene, "MS", "other", POSITIONS), announce(scene, "MS", "other", TRAJECTORY, domain=42)
    with pytest.raises(RobotError) as caught:
        robot.connect()
    assert f"{POSITIONS} in domain 0" in str(caught.value)
    assert f"{TRAJECTORY} in domain 42" in str(caught.value)
    assert len(kept) == 2


def test_connect_says_why_there_are_no_joint_states(scene):
    robot = scene.neck(connect_timeout_s=1.0)
    with pytest.raises(RobotError, match="nobody sends on /joint_states as sensor_msgs/msg/JointState"):
        robot.connect()


def test_connect_names_a_joint_that_the_robot_does_not_have(scene):
    robot = scene.neck(names=("pan", "tlit"), connect_timeout_s=2.0)
    with (
        zenoh_listener(scene.states, GOOD),
        pytest.raises(
            RobotError, match="no joint state on /joint_states can be used: it has no joint 'tlit', only pan"
        ),
    ):
        robot.connect()


def test_close_at_any_time_and_connect_again(scene):
    robot = scene.neck()
    robot.close()
    robot.close()
    robot = scene.connected()
    session = robot._node._session
    robot.connect()  # does nothing
    assert robot._node._session is session
    robot.close()
    assert session.is_closed()
    for call in (robot.read_state, lambda: robot.send_command(np.zeros(2))):
        with pytest.raises(RobotError, match="not connected: call connect"):
            call()
    with zenoh_listener(scene.states, GOOD):
        robot.connect()
    assert robot.read_state().time_s == 300.25
    robot._node._session.close()  # somebody else's doing
    with pytest.raises(RobotError):
        robot.send_command(np.zeros(2))
    robot.close()


@pytest.mark.parametrize("end", ["robot.close()", "pass"])
def test_nothing_keeps_the_process_alive(scene, end):
    code = f"""
import threading, numpy as np
from gazempc.neck.spec import load_neck
from gazempc.robots.ros2 import Ros2Neck
from gazempc.ros2.wire import Ros2Network
neck = load_neck("reference").model_copy(update={{"reports_joints": False}})
robot = Ros2Neck(neck, float, float, ("pan", "tilt"), "head/command", network=Ros2Network("{scene.network.endpoint}"))
robot.connect()
robot.send_command(np.zeros(2))
assert threading.active_count() == 1
{end}
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_importing_needs_neither_zenoh_nor_rosbags():
    code = "import sys, gazempc.robots.ros2, gazempc.live.sources.ros2; print({'zenoh', 'rosbags'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


@pytest.mark.parametrize("missing", ["zenoh", "rosbags.typesys"])
def test_a_missing_package_is_named(scene, monkeypatch, missing):
    ros2_wire.typestore.cache_clear()
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(MissingOptionalDependencyError, match="extra 'ros2'"):
        scene.neck().connect()
    with pytest.raises(MissingOptionalDependencyError, match="extra 'ros2'"):
        Ros2Person("/person/head", float, float).open()


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"names": ("pan", "pan")}, "joint_names"),
        ({"names": ("pan", "")}, "joint_names"),
        ({"topic": "head command"}, "topic 'head command'"),
        ({"topic": "head/**"}, "topic"),
        ({"state_topic": ""}, "topic"),
        ({"command_type": "std_msgs/msg/Float64"}, "perhaps you meant 'std_msgs/msg/Float64MultiArray'"),
        ({"joint_signs": (1, 0.5)}, "joint_signs"),
        ({"time_from_start_s": 0.0}, "time_from_start_s"),
        ({"silent_after_s": float("nan")}, "silent_after_s"),
    ],
)
def test_options_that_cannot_be_right(scene, options, what):
    with pytest.raises(SettingsError, match=what):
        scene.neck(**options)


def test_networks_that_cannot_be():
    with pytest.raises(SettingsError, match="0 to 232"):
        Ros2Network(domain_id=233)
    with pytest.raises(SettingsError, match="tcp/localhost:7447"):
        Ros2Network("localhost:7447")
    assert Ros2Network().endpoint == "tcp/localhost:7447"


def polled(person, n):
    sightings, problems = [], []

    def enough():
        arrived = person.poll()
        sightings.extend(arrived.sightings)
        problems.extend(arrived.problems)
        return len(sightings) + len(problems) >= n

    wait_for(enough)
    return sightings, problems


def test_every_pose_of_a_person_with_its_time_of_capture(scene):
    person = scene.person()
    for k in range(100):
        scene.poses.put(pose([2.0, 0.01 * k, 0.4], (0.0, 0.6, 0.0, 0.8), stamp=(UNIX_START_S + 299, k * 7_812_500)))
    sightings, problems = polled(person, 100)
    assert problems == []
    assert [s.observation.capture_time_s for s in sightings] == [299 + k * 0.0078125 for k in range(100)]
    assert [list(s.observation.head_position_base_m) for s in sightings] == [[2.0, 0.01 * k, 0.4] for k in range(100)]
    assert all(list(s.observation.head_quat_wxyz) == [0.8, 0.0, 0.6, 0.0] for s in sightings)
    assert {s.arrival_s for s in sightings} == {NOW_S}
    assert not person.finished
    assert person.poll().sightings == ()


def test_an_orientation_that_is_not_given_or_not_wanted_is_left_out(scene):
    for wanted, quat in ((True, [0.0] * 4), (False, [0.0, 0.0, 0.0, 1.0])):
        person = scene.person(use_orientation=wanted)
        scene.poses.put(pose([2.0, 0.0, 0.4], quat))
        ((sighting,), _) = polled(person, 1)
        assert sighting.observation.head_quat_wxyz is None
        person.close()
        wait_for(lambda: not scene.poses.matching_status.matching)


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (pose([np.nan, 0.0, 0.4]), "not finite"),
        (pose([2.0, 0.0, 0.4], (0.0, 0.0, 0.0, 2.0)), "not of unit length"),
        (pose([2.0, 0.0, 0.4], stamp=(0, 0)), "no time stamp"),
        (pose([2.0, 0.0, 0.4], stamp=(12, 0)), "use_sim_time"),
        (pose([2.0, 0.0, 0.4], frame_id="camera_color_optical_frame"), "z points forward"),
        (pose([2.0, 0.0, 0.4])[:-1], "not a geometry_msgs/msg/PoseStamped"),
        (b"hello", "not a geometry_msgs/msg/PoseStamped"),
    ],
    ids=["nan", "quaternion", "no-stamp", "sim-time", "optical", "cut", "text"],
)
def test_a_pose_that_cannot_be_used_is_a_problem_and_no_more(scene, payload, reason):
    person = scene.person()
    scene.poses.put(payload)
    scene.poses.put(pose([2.0, 0.0, 0.4]))
    sightings, (problem,) = polled(person, 2)
    assert problem.startswith("/person/head: ")
    assert reason in problem
    assert [list(s.observation.head_position_base_m) for s in sightings] == [[2.0, 0.0, 0.4]]


def test_a_pose_in_another_frame(scene):
    person = scene.person(frame_id="camera_link")
    scene.poses.put(pose([2.0, 0.0, 0.4], frame_id="map"))
    scene.poses.put(pose([2.0, 0.0, 0.4], frame_id="camera_link"))
    sightings, (problem,) = polled(person, 2)
    assert "frame 'map', expected is 'camera_link'" in problem
    assert len(sightings) == 1


def test_a_person_behind_a_router_that_goes_and_comes_back(scene):
    person = scene.person()
    scene.router.close()
    _, (problem,) = polled(person, 1)
    assert "router" in problem
    assert person.poll().problems == ()  # said once
    scene.start()
    wait_for(lambda: scene.poses.matching_status.matching)
    scene.poses.put(pose([2.0, 0.0, 0.4]))
    sightings, problems = polled(person, 1)
    assert (len(sightings), problems) == (1, [])
    person.close()
    person.close()
    assert person.poll().sightings == ()


def test_a_person_without_router_or_session():
    person = Ros2Person("/person/head", float, float, network=Ros2Network(f"tcp/127.0.0.1:{free_port()}"))
    with pytest.raises(SourceError, match="/person/head: no Zenoh router answers"):
        person.open()
    assert person.poll().sightings == ()
    person.close()
