"""A ROS 2 graph inside the test: messages with the standard fields, without rclpy."""

import math
from collections import defaultdict, deque
from functools import cache
from types import SimpleNamespace

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from gazempc.live.sources.ros2 import Ros2Input
from gazempc.robots.options import Ros2Options

OPTICAL = "camera_color_optical_frame"
TF, IDS, TEXT = "tf2_msgs/msg/TFMessage", "hri_msgs/msg/IdsList", "std_msgs/msg/String"
POINT, WITH_COVARIANCE = "geometry_msgs/msg/PointStamped", "geometry_msgs/msg/PoseWithCovarianceStamped"
# The loop's clock began at this Unix time, and now it is 300.3 s later.
UNIX_START_S = 1763718000
NOW_S = 300.3


@cache
def typestore():
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg("std_msgs/Header header\nstring[] ids", IDS))
    return store


def make_message(type_name, **fields):
    return typestore().types[type_name](**fields)


def header(frame_id, at_s):
    """Header with a loop time as stamp; None for no stamp."""
    whole = -UNIX_START_S if at_s is None else math.floor(at_s)
    nanosec = 0 if at_s is None else round(1e9 * (at_s - whole))
    stamp = make_message("builtin_interfaces/msg/Time", sec=UNIX_START_S + whole, nanosec=nanosec)
    return make_message("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)


def point(position_m):
    return make_message("geometry_msgs/msg/Point", **dict(zip("xyz", map(float, position_m), strict=True)))


def pose(position_m, quat_wxyz=(1.0, 0.0, 0.0, 0.0)):
    w, x, y, z = map(float, quat_wxyz)
    turn = make_message("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
    return make_message("geometry_msgs/msg/Pose", position=point(position_m), orientation=turn)


def pose_stamped(position_m, quat_wxyz=(1.0, 0.0, 0.0, 0.0), frame_id="camera_link", at_s=NOW_S - 0.05):
    return make_message(
        "geometry_msgs/msg/PoseStamped", header=header(frame_id, at_s), pose=pose(position_m, quat_wxyz)
    )


def with_covariance(position_m, covariance, quat_wxyz=(1.0, 0.0, 0.0, 0.0), frame_id="camera_link", at_s=NOW_S):
    stated = make_message(
        "geometry_msgs/msg/PoseWithCovariance", pose=pose(position_m, quat_wxyz), covariance=covariance.ravel()
    )
    return make_message(WITH_COVARIANCE, header=header(frame_id, at_s), pose=stated)


def stamped_point(frame_id, place_m, at_s=None):
    return make_message(POINT, header=header(frame_id, at_s), point=point(place_m))


def detections(*stated, covariance):
    """Heads with name, score, position and box."""
    found = []
    for name, score, position_m, box_m in stated:
        at = SimpleNamespace(pose=pose(position_m), covariance=covariance.ravel())
        result = SimpleNamespace(hypothesis=SimpleNamespace(class_id="head", score=score), pose=at)
        found.append(SimpleNamespace(id=name, results=[result], bbox=SimpleNamespace(center=pose(box_m))))
    return SimpleNamespace(header=header("camera_link", NOW_S), detections=found)


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
    return make_message(TF, transforms=list(transforms))


def tracked(*ids):
    return make_message(IDS, header=header("", NOW_S), ids=list(ids))


def text(content):
    return make_message(TEXT, data=content)


class _Subscription:
    def __init__(self, stage, topic, type_name):
        self.stage, self.topic, self.type_name, self.queue = stage, topic, type_name, deque(maxlen=256)

    def take(self):
        return [self.queue.popleft() for _ in range(len(self.queue))]

    @property
    def senders(self):
        return tuple(node for node, kind in self.stage.senders[self.topic] if kind == self.type_name)

    @property
    def described(self):
        senders = self.stage.senders[self.topic]
        others = [f"{node} has the type {kind}" for node, kind in senders if kind != self.type_name]
        return f"{self.topic} as {self.type_name}" + (f", but {' and '.join(sorted(others))}" if others else "")


class _Node:
    def __init__(self, stage):
        self.stage = stage

    def subscription(self, topic, type_name, latched=False):
        full = "/" + topic.removeprefix("/")
        made = _Subscription(self.stage, full, type_name)
        self.stage.listeners.append(made)
        if latched and full in self.stage.kept:
            made.queue.append(self.stage.kept[full])
        return made

    def forget(self, subscription):
        self.stage.listeners.remove(subscription)

    def unix_s(self, ros_s):
        return ros_s

    def close(self):
        """See `gazempc.ros2.node.Ros2Node.close`."""


class Stage:
    """Publishers, and the source that subscribes."""

    def __init__(self):
        self.now_s, self.opened, self.listeners, self.kept = NOW_S, [], [], {}
        self.senders = defaultdict(list)

    def make_node(self, name, use_sim_time):
        return _Node(self)

    def clock_s(self):
        return self.now_s

    def given(self, **options):
        return Ros2Input(self.clock_s, lambda unix_s: unix_s - UNIX_START_S, Ros2Options(**options), self.make_node)

    def put(self, topic, type_name, message, latched=False):
        if latched:
            self.kept[topic] = message
        for listener in self.listeners:
            if (listener.topic, listener.type_name) == (topic, type_name):
                listener.queue.append(message)

    def tf(self, *transforms):
        self.put("/tf", TF, frames(*transforms))

    def tf_static(self, *transforms):
        self.put("/tf_static", TF, frames(*transforms), latched=True)

    def announced(self, topic, type_name, node="/sender"):
        """Announce a publisher."""
        self.senders[topic].append((node, type_name))

    def gone(self, topic):
        self.senders[topic].clear()

    def listening(self, source):
        self.opened.append(source)
        source.open()
        return source

    def close(self):
        for source in self.opened:
            source.close()


def polled(source, count):
    """Observations and cues of polls until there are `count`, and the problems."""
    arrived = source.poll()
    found = [*(sighting.observation for sighting in arrived.sightings), *arrived.cues]
    assert len(found) + len(arrived.problems) == count
    return found, list(arrived.problems)
