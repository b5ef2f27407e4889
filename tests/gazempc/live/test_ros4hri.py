"""The source ros4hri: people by their tf frames and tracked ids, in serialised messages."""

from dataclasses import replace

import numpy as np
import pytest
from builders.ros2_graph import IDS, NOW_S, OPTICAL, TEXT, TF, polled, text, tracked, transform, typestore
from rosbags.rosbag2 import Reader
from scipy.spatial.transform import Rotation

from gazempc.live.sources.ros4hri import Ros4HriPeople
from gazempc.loop.events import Event
from gazempc.recordings.readers.bag import people_in
from gazempc.recordings.readers.bag_frames import FrameTree, forward
from gazempc.recordings.readers.bag_messages import read_messages

BODIES, PERSONS = (f"/humans/{part}/tracked" for part in ("bodies", "persons"))
# x of a face against the camera's z.
FACING = (0.5, 0.5, 0.5, -0.5)


def opened(stage, base_frame=None):
    return stage.listening(Ros4HriPeople(stage.given(base_frame=base_frame)))


def publish(source, stage, topic, type_name, data):
    stage.put(topic, type_name, data)
    source.poll()


def names(found):
    return [each.person_id for each in found]


def test_people_in_tf_are_observed_by_id_and_unusable_ones_are_problems(stage):
    source = opened(stage)
    stage.tf(
        transform("face_a1b2c", [1.0, 0.2, 0.1]),
        transform("gaze_a1b2c", [0.0, 0.0, 0.0], frame_id="face_a1b2c"),
        transform("head_link", [0.0, 0.0, 0.5], frame_id="torso"),
        transform("face_zzzzz", [2.0, -0.2, 0.3]),
        transform("face_a", [np.nan, 0.0, 0.0]),
        transform("face_b", [1.0, 0.0, 0.0], at_s=NOW_S - 60.0),
        transform("face_c", [1.0, 0.0, 0.0], (0.0, 0.0, 0.0, 0.0)),
        transform("face_d", [1.0, 1e300, 0.0]),
    )
    seen, problems = polled(source, 6)
    assert names(seen) == ["a1b2c", "zzzzz"]
    np.testing.assert_allclose(seen[1].head_position_base_m, [2.0, -0.2, 0.3])
    assert sorted(text.split(":")[0] for text in problems) == [f"/tf, face_{name}" for name in "abcd"]


def test_a_face_is_transformed_from_a_turning_camera(stage):
    """From the face to the robot's base by moving and static frames, at the time of capture."""
    source = opened(stage, "base_link")
    stage.tf_static(
        transform("neck_link", [0.1, 0.0, 1.2], frame_id="base_link", at_s=None),
        transform(OPTICAL, [0.05, 0.02, 0.1], (0.5, -0.5, 0.5, -0.5), "head_link", at_s=None),
    )
    pan = [Rotation.from_euler("z", deg, degrees=True).as_quat(scalar_first=True) for deg in (20.0, 40.0)]
    captured_s = NOW_S - 0.1
    stage.tf(transform("head_link", [0.0, 0.0, 0.0], pan[0], "neck_link", captured_s - 0.015))
    # The transform of the robot's head arrives later than the face.
    stage.tf(transform("face_a", [0.3, -0.2, 2.0], FACING, OPTICAL, captured_s))
    assert source.poll().sightings == ()
    stage.tf(transform("head_link", [0.0, 0.0, 0.0], pan[1], "neck_link", captured_s + 0.005))
    (seen,), problems = polled(source, 1)
    assert problems == []
    assert seen.capture_time_s == pytest.approx(captured_s)
    turn = Rotation.from_euler("z", 35.0, degrees=True)
    # Along the optical axis 2 m, 0.3 m to the right, 0.2 m up.
    expected_m = np.array([0.1, 0.0, 1.2]) + turn.apply([0.05 + 2.0, 0.02 - 0.3, 0.1 + 0.2])
    np.testing.assert_allclose(seen.head_position_base_m, expected_m, atol=1e-5)
    facing = Rotation.from_quat(seen.head_quat_wxyz, scalar_first=True).apply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(facing, turn.apply([-1.0, 0.0, 0.0]), atol=1e-5)


def test_a_person_has_one_name_for_any_face_id(stage):
    source = opened(stage)
    publish(source, stage, PERSONS, IDS, tracked("anna"))
    publish(source, stage, "/humans/persons/anna/face_id", TEXT, text("f1"))
    stage.tf(transform("face_f1", [1.0, 0.0, 0.0]), transform("face_f9", [2.0, 1.0, 0.0]))
    assert names(polled(source, 2)[0]) == ["anna", "f9"]
    publish(source, stage, "/humans/persons/anna/face_id", TEXT, text("f2"))
    stage.tf(transform("face_f2", [1.0, 0.0, 0.0]), transform("face_f1", [1.0, 2.0, 0.0], at_s=NOW_S - 0.05))
    assert names(polled(source, 2)[0]) == ["anna", "f1"]
    # A person no longer tracked has no face: the face keeps its own id.
    publish(source, stage, PERSONS, IDS, tracked("bob"))
    stage.tf(transform("face_f2", [1.0, 0.0, 0.0], at_s=NOW_S - 0.02))
    assert names(polled(source, 1)[0]) == ["f2"]


def test_a_body_is_used_without_a_face(stage):
    source = opened(stage)
    leaning = Rotation.from_euler("zy", [90.0, 30.0], degrees=True)
    hips_m = np.array([2.0, 0.0, -0.5])
    head_m = hips_m + 0.69 * leaning.apply([0.0, 0.0, 1.0])
    body = leaning.as_quat(scalar_first=True)
    # A robot may have such frames.
    stage.tf(transform("body_b", hips_m, body, at_s=NOW_S - 0.4))
    publish(source, stage, BODIES, IDS, tracked("b"))
    stage.tf(transform("body_b", hips_m, body, at_s=NOW_S - 0.3), transform("body_other", hips_m))
    (seen,), problems = polled(source, 1)
    assert (seen.person_id, problems, seen.head_quat_wxyz) == ("b", [], None)
    np.testing.assert_allclose(seen.head_position_base_m, head_m)
    np.testing.assert_allclose(seen.pelvis_quat_wxyz, body)
    stage.tf(
        transform("face_a", head_m + 0.1, at_s=NOW_S - 0.2),
        transform("body_b", hips_m, body, at_s=NOW_S - 0.19),
        transform("face_c", head_m + 1.0, at_s=NOW_S - 0.18),
    )
    assert names(polled(source, 2)[0]) == ["a", "c"]
    stage.now_s += 0.6
    stage.tf(transform("body_b", hips_m, body, at_s=NOW_S + 0.5))
    assert names(polled(source, 1)[0]) == ["b"]


def test_a_missing_publisher_is_reported_once_per_absence(stage):
    source = opened(stage)
    assert source.poll().notices == ()

    def noticed():
        stage.now_s += 3.1
        return [(notice.event, notice.count) for notice in source.poll().notices]

    for _ in range(2):
        assert noticed() == [(Event.NO_SENDER, 0)]
        assert noticed() == []
        stage.announced("/tf", TF)
        assert noticed() == []
        stage.gone("/tf")


def test_a_skeleton_is_observed_at_its_head_joint(stage):
    """A chain of static and moving transforms: head, neck joint, torso, hips."""
    source = opened(stage)
    publish(source, stage, PERSONS, IDS, tracked("anna"))
    publish(source, stage, "/humans/persons/anna/body_id", TEXT, text("b"))
    publish(source, stage, BODIES, IDS, tracked("b"))
    stage.tf_static(transform("head_b", [0.0, 0.0, 0.1], frame_id="p_head_b", at_s=None))
    for at_s in (NOW_S - 0.1, NOW_S - 0.05):
        stage.tf(
            transform("p_head_b", [0.0, 0.0, 0.2], frame_id="torso_b", at_s=at_s),
            transform("torso_b", [0.0, 0.0, 0.4], frame_id="body_b", at_s=at_s),
        )
        stage.tf(transform("body_b", [2.0, 0.3, -0.4], at_s=at_s))
    seen, problems = polled(source, 2)
    assert (names(seen), problems) == (["anna", "anna"], [])
    np.testing.assert_allclose([each.head_position_base_m for each in seen], [[2.0, 0.3, 0.3]] * 2)


NAME, PEOPLE = "2p_AA_FV_eng_1", {"eloek", "ghfbv"}
READ = ("tf2_msgs/msg/TFMessage", "hri_msgs/msg/IdsList", "std_msgs/msg/String")


def test_faces_of_real_nodes_equal_the_recording(stage, bags_dir):
    """The first 1.8 s of two people at 30 Hz, re-serialised."""
    with Reader(bags_dir / NAME) as bag:
        sent = [(c.topic, c.msgtype, 1e-9 * ns, raw) for c, ns, raw in bag.messages() if c.msgtype in READ]
    start_s = sent[0][2]
    source = stage.listening(Ros4HriPeople(replace(stage.given(), to_loop_s=lambda unix_s: unix_s - start_s)))
    found = []
    for topic, type_name, at_s, raw in sent:
        stage.now_s = at_s - start_s
        if stage.now_s <= 1.8:
            stage.put(topic, type_name, typestore().deserialize_cdr(raw, type_name), latched=topic != "/tf")
            arrived = source.poll()
            assert arrived.problems == ()
            found += [sighting.observation for sighting in arrived.sightings]
    assert len(found) >= 90
    topics, messages = read_messages(bags_dir / NAME)
    tracks = [forward(seen.frame, seen.poses)[0] for seen in people_in(FrameTree(messages), topics, messages)]
    times_s = np.concatenate([track.times_s for track in tracks]) - start_s
    position_m = np.concatenate([track.position_m for track in tracks])
    for seen in found:
        at = abs(times_s - seen.capture_time_s) < 1e-4
        assert np.linalg.norm(position_m[at] - seen.head_position_base_m, axis=1).min() < 1e-9
    assert {seen.person_id for seen in found[len(found) // 2 :]} == PEOPLE
