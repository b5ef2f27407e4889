"""The ROS package in a workspace: launch files, parameter files, a bag of a run."""

from builders.ros2_real import rclpy_or_skip

rclpy_or_skip()

import math
from xml.etree import ElementTree

import pytest
import yaml
from geometry_msgs.msg import PoseStamped
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from stage import PACKAGE
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

pytestmark = pytest.mark.slow
LAUNCH, CONFIG = PACKAGE / "launch", PACKAGE / "config"


def nodes(name):
    """Nodes of a launch file: executable, and files of parameters."""
    tree = ElementTree.parse(LAUNCH / name)
    share = "$(find-pkg-share gazempc_ros)"
    return {
        node.get("exec"): [param.get("from", "").replace(share, str(PACKAGE)) for param in node.iter("param")]
        for node in tree.iter("node")
    }


def test_launch_files_refer_to_existing_files_and_nodes():
    setup = (PACKAGE / "setup.py").read_text()
    for name in ("gaze.launch.xml", "demo.launch.xml"):
        for executable in nodes(name):
            assert executable == "rviz2" or f"{executable} = gazempc_ros.{executable}:main" in setup
    for path in CONFIG.glob("*.yaml"):
        assert yaml.safe_load(path.read_text())["/**"]["ros__parameters"]


def test_the_demonstration_shows_markers_and_its_bag_replays(stage):
    """The nodes of the launch file with its parameter files; people and frames are recorded in a bag."""
    client, started = stage.client(), nodes("demo.launch.xml")
    client.listen(MarkerArray, "/gaze/markers")
    raw = {"/person/pose": [], "/tf_static": []}
    for topic, kind in (("/person/pose", PoseStamped), ("/tf_static", TFMessage)):
        from rclpy.qos import DurabilityPolicy, QoSProfile

        durability = DurabilityPolicy.TRANSIENT_LOCAL if "static" in topic else DurabilityPolicy.VOLATILE
        qos = QoSProfile(depth=50, durability=durability)
        client.node.create_subscription(kind, topic, raw[topic].append, qos, raw=True)
    running = {}
    for name in ("gaze", "walk"):
        (file,) = [path for path in started[name] if path]
        running[name] = stage.start(name, "-m", f"gazempc_ros.{name}", "--ros-args", "--params-file", file)

    def shown():
        return {marker.ns for message in client.received["/gaze/markers"] for marker in message.markers}

    complete = {"gaze", "attended", "forecast"}
    client.wait(
        lambda: len(raw["/person/pose"]) > 90 and shown() == complete,
        why=f"{running['gaze'].text()}{running['walk'].text()}",
    )
    last = client.received["/gaze/markers"][-1].markers
    assert all(math.isfinite(each.scale.x) for each in last)
    for process in running.values():
        assert process.stop() == 0, process.text()
    bag = stage.folder / "bag"
    types = {"/person/pose": "geometry_msgs/msg/PoseStamped", "/tf_static": "tf2_msgs/msg/TFMessage"}
    with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        store = get_typestore(Stores.ROS2_JAZZY)
        made = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in types.items()}
        for topic, messages in raw.items():
            for k, data in enumerate(messages):
                pose = store.deserialize_cdr(bytes(data), types[topic])
                stamp = pose.header.stamp if topic == "/person/pose" else None
                now_ns = k + 1 if stamp is None else stamp.sec * 10**9 + stamp.nanosec + 70_000_000
                writer.write(made[topic], now_ns, bytes(data))
    out = stage.folder / "replayed"
    words = ["--replay", str(bag), "--noise-seeds", "1", "--no-figures", "--out", str(out)]
    replayed = stage.start("run", "-m", "gazempc.run", *words)
    assert replayed.stop(how=0, timeout_s=200.0) == 0, replayed.text()
    assert (out / "summary.json").is_file()
