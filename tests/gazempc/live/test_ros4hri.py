"""The source ros4hri: everybody in /tf with the tracker's ids, as a tracker puts them on the wire."""

import math

import numpy as np
import pytest
import zenoh
from builders.ports import free_port
from builders.ros2_network import wait_for, zenoh_session
from builders.ros2_wire import NOW_S, UNIX_START_S

from gazempc.live.sources.ros4hri import Ros4HriPeople
from gazempc.live.sources.source import SourceError
from gazempc.ros2.wire import Ros2Network, encode, make_message, topic_key

OPTICAL = "camera_color_optical_frame"


def header(frame_id, at_s):
    whole = math.floor(at_s)
    stamp = make_message("builtin_interfaces/msg/Time", sec=UNIX_START_S + whole, nanosec=round(1e9 * (at_s - whole)))
    return make_message("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)


def transform(child, position_m, quat_wxyz=(1.0, 0.0, 0.0, 0.0), frame_id="camera_link", at_s=NOW_S - 0.1):
    w, x, y, z = quat_wxyz
    moved = make_message(
        "geometry_msgs/msg/Transform",
        translation=make_message("geometry_msgs/msg/Vector3", **dict(zip("xyz", position_m, strict=True))),
        rotation=make_message("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
    )
    return make_message(
        "geometry_msgs/msg/TransformStamped", header=header(frame_id, at_s), child_frame_id=child, transform=moved
    )


def frames(*transforms):
    return encode(make_message("tf2_msgs/msg/TFMessage", transforms=list(transforms)))


def tracked(*ids):
    return encode(make_message("hri_msgs/msg/IdsList", header=header("", NOW_S), ids=list(ids)))


@pytest.fixture
def stage():
    port = free_port()
    router = zenoh_session("router", port)
    block = {"congestion_control": zenoh.CongestionControl.BLOCK}
    tf = router.declare_publisher(topic_key(0, "/tf", "tf2_msgs/msg/TFMessage"), **block)
    lists = router.declare_publisher(topic_key(0, "/humans/faces/tracked", "hri_msgs/msg/IdsList"), **block)
    network = Ros2Network(f"tcp/127.0.0.1:{port}")
    source = Ros4HriPeople(lambda: NOW_S, lambda unix_s: unix_s - UNIX_START_S, network)
    source.open()
    wait_for(lambda: tf.matching_status.matching and lists.matching_status.matching)
    yield source, tf, lists
    source.close()
    router.close()


def polled(source, count):
    sightings, problems = [], []

    def enough():
        arrived = source.poll()
        sightings.extend(arrived.sightings)
        problems.extend(arrived.problems)
        return len(sightings) + len(problems) >= count

    wait_for(enough)
    return [sighting.observation for sighting in sightings], problems


def test_everybody_in_tf_is_seen_with_their_id(stage):
    source, tf, _ = stage
    tf.put(
        frames(
            transform("face_a1b2c", [1.0, 0.2, 0.1]),
            transform("gaze_a1b2c", [0.0, 0.0, 0.0], frame_id="face_a1b2c"),
            transform("head_1_link", [0.0, 0.0, 0.5], frame_id="torso"),
            transform("face_zzzzz", [2.0, -0.2, 0.3]),
        )
    )
    seen, problems = polled(source, 2)
    assert problems == []
    assert [each.person_id for each in seen] == ["a1b2c", "zzzzz"]
    np.testing.assert_allclose(seen[1].head_position_base_m, [2.0, -0.2, 0.3])
    assert seen[0].capture_time_s == pytest.approx(NOW_S - 0.1)


def test_optical_axes_are_turned(stage):
    source, tf, _ = stage
    # Two metres ahead, half a metre to the right, 0.1 m up; x of the face against the camera's z.
    facing = (0.5, 0.5, 0.5, -0.5)
    tf.put(frames(transform("face_a", [0.5, -0.1, 2.0], facing, OPTICAL)))
    (seen,), _ = polled(source, 1)
    np.testing.assert_allclose(seen.head_position_base_m, [2.0, -0.5, 0.1], atol=1e-12)


def test_a_face_that_is_not_listed_any_more_is_nobody(stage):
    source, tf, lists = stage
    lists.put(tracked("a"))
    wait_for(lambda: source.poll() is not None and source._tracked is not None)
    tf.put(frames(transform("face_a", [1.0, 0.0, 0.0]), transform("face_gone", [2.0, 0.0, 0.0])))
    tf.put(frames(transform("face_a", [1.0, 0.1, 0.0], at_s=NOW_S - 0.05)))
    seen, problems = polled(source, 2)
    assert ([each.person_id for each in seen], problems) == (["a", "a"], [])


def test_what_cannot_be_used_is_a_problem_that_names_the_frame(stage):
    source, tf, _ = stage
    tf.put(frames(transform("face_a", [np.nan, 0.0, 0.0]), transform("face_b", [1.0, 0.0, 0.0], at_s=NOW_S - 60.0)))
    tf.put(b"hello")
    _, problems = polled(source, 3)
    assert problems[0].startswith("/tf, face_a: head_position_base_m is not finite")
    assert "use_sim_time" in problems[1]
    assert "not a tf2_msgs/msg/TFMessage" in problems[2]


def test_without_a_router_it_says_so():
    source = Ros4HriPeople(lambda: 0.0, lambda s: s, Ros2Network(f"tcp/127.0.0.1:{free_port()}"))
    with pytest.raises(SourceError, match="no Zenoh router answers"):
        source.open()
