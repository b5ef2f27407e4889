"""People and robots on the wire as tf and ROS4HRI have them, and a stage with a router of its own."""

import math

import zenoh
import zenoh.ext

from builders.ports import free_port
from builders.ros2_network import wait_for, zenoh_session
from builders.ros2_wire import NOW_S, UNIX_START_S
from gazempc.ros2.wire import Ros2Network, encode, make_message, topic_key, type_hash

OPTICAL = "camera_color_optical_frame"
TF, IDS, TEXT = "tf2_msgs/msg/TFMessage", "hri_msgs/msg/IdsList", "std_msgs/msg/String"


def header(frame_id, at_s):
    """At a time of the loop; None for no stamp."""
    whole = -UNIX_START_S if at_s is None else math.floor(at_s)
    nanosec = 0 if at_s is None else round(1e9 * (at_s - whole))
    stamp = make_message("builtin_interfaces/msg/Time", sec=UNIX_START_S + whole, nanosec=nanosec)
    return make_message("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)


def transform(child, position_m, quat_wxyz=(1.0, 0.0, 0.0, 0.0), frame_id="camera_link", at_s=NOW_S - 0.1):
    w, x, y, z = map(float, quat_wxyz)
    moved = make_message(
        "geometry_msgs/msg/Transform",
        translation=make_message("geometry_msgs/msg/Vector3", **dict(zip("xyz", map(float, position_m), strict=True))),
        rotation=make_message("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
    )
    return make_message(
        "geometry_msgs/msg/TransformStamped", header=header(frame_id, at_s), child_frame_id=child, transform=moved
    )


def frames(*transforms):
    return encode(make_message(TF, transforms=list(transforms)))


def tracked(*ids):
    return encode(make_message(IDS, header=header("", NOW_S), ids=list(ids)))


def text(said):
    return encode(make_message(TEXT, data=said))


class Stage:
    """A router, and senders on it; the source that listens is opened by `listening`."""

    def __init__(self):
        self.port = free_port()
        self.network = Ros2Network(f"tcp/127.0.0.1:{self.port}")
        self.now_s = NOW_S
        self.opened = []
        self.start()

    def start(self):
        """Begin anew, with nobody who sends."""
        self.router, self._senders = zenoh_session("router", self.port), {}

    def clock_s(self):
        return self.now_s

    @staticmethod
    def to_loop_s(unix_s):
        return unix_s - UNIX_START_S

    def sends(self, topic, type_name, latched=False):
        """A sender that waits for nobody."""
        if topic not in self._senders:
            key = topic_key(0, topic, type_name)
            if latched:
                cache = zenoh.ext.CacheConfig(1)
                sender = zenoh.ext.declare_advanced_publisher(self.router, key, cache=cache, publisher_detection=True)
            else:
                block = zenoh.CongestionControl.BLOCK
                sender = self.router.declare_publisher(key, congestion_control=block)
            self._senders[topic] = sender
        return self._senders[topic]

    def put(self, topic, type_name, data):
        """Send as soon as somebody listens."""
        sender = self.sends(topic, type_name)
        wait_for(lambda: sender.matching_status.matching)
        sender.put(data)

    def tf(self, *transforms):
        self.put("/tf", TF, frames(*transforms))

    def tf_static(self, *transforms):
        self.put("/tf_static", TF, frames(*transforms))

    def announced(self, topic, type_name):
        """A node that says that it sends; gone once this is undeclared."""
        package, _, name = type_name.split("/")
        entity = f"{topic.replace('/', '%')}/{package}::msg::dds_::{name}_/{type_hash(type_name, False)}"
        token = f"@ros2_lv/0/{self.router.zid()}/0/7/MP/%/%/somebody/{entity}/::,10:,:,:,,"
        return self.router.liveliness().declare_token(token)

    def listening(self, source):
        self.opened.append(source)
        source.open()
        return source

    def close(self):
        for source in self.opened:
            source.close()
        self.router.close()


def polled(source, count):
    """The next observations, cues and problems, so many of them all together."""
    found, problems = [], []

    def enough():
        arrived = source.poll()
        found.extend(sighting.observation for sighting in arrived.sightings)
        found.extend(arrived.cues)
        problems.extend(arrived.problems)
        return len(found) + len(problems) >= count

    wait_for(enough)
    return found, problems
