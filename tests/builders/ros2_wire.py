"""Messages packed and read by hand, as the wire has them."""

import struct

# From the sources that rosidl generated for ROS 2 Jazzy, and from `ros2 topic info --verbose`.
HASHES = {
    "std_msgs/msg/String": "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "std_msgs/msg/Float64MultiArray": "1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f",
    "trajectory_msgs/msg/JointTrajectory": "179b33eba59d676f6d967ac71fe35e7ca2f64b2f3928f4a018cec115e213796e",
    "sensor_msgs/msg/JointState": "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    "geometry_msgs/msg/PoseStamped": "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
}


TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
POSITIONS = "std_msgs/msg/Float64MultiArray"


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


def pose_with_covariance(position, covariance, **fields):
    """A PoseWithCovarianceStamped: the same, and 36 numbers row by row."""
    p = Packer()
    p.data = pose(position, **fields)[4:]
    for value in (number for row in covariance for number in row):
        p.number("d", value)
    return p.done()


GOOD = joint_state([0.1, 0.2])
