"""ROS 2 bags as recordings: known walks in the requested frame, and notes on other content."""

import json

import numpy as np
import pytest
from builders.bags import OPTICAL, face_rows, pose_rows, write_bag
from builders.exports import same_turns
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError, SettingsError
from gazempc.identify.tracker.read import of_recording
from gazempc.recordings.load import load, load_together
from gazempc.recordings.readers.options import ReadOptions
from gazempc.run import main

START_S = 1_700_000_000.0
T = np.arange(60) / 30.0
# A person who walks along y, 2 m in front of a sensor, seen from it with x forward and z up.
WALK = np.column_stack([np.full_like(T, 2.0), 1.0 - 1.0 * T, np.full_like(T, 0.3)])
# The same in optical axes.
WALK_OPTICAL = np.column_stack([-WALK[:, 1], -WALK[:, 2], WALK[:, 0]])
# From forward to optical axes, as published by camera drivers.
TO_OPTICAL = (0.5, -0.5, 0.5, -0.5)
POSE, POINT = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PointStamped"


def wxyz(turn):
    return turn.as_quat(scalar_first=True)


def bag_of(folder, rows, **more):
    return write_bag(folder / "bag", rows, **{"storage": "mcap"} | more)


def read(folder, **options):
    return load(folder, ReadOptions(**options))


def facing_rows(name, turn, parent=OPTICAL):
    """A face on the walk with an orientation in optical axes."""
    return face_rows(name, START_S + T, WALK_OPTICAL, parent, wxyz(turn))


# x out of the face, towards the sensor; z up; in optical axes.
TO_SENSOR = Rotation.from_quat(TO_OPTICAL, scalar_first=True).inv() * Rotation.from_euler("z", np.pi)


@pytest.mark.parametrize(("storage", "ending"), [("sqlite3", ".db3"), ("mcap", ".mcap")])
def test_a_face_is_read_in_the_sensor_frame_from_folder_or_file(tmp_path, storage, ending):
    bag = bag_of(tmp_path, facing_rows("face_a", TO_SENSOR), storage=storage, delay_s=0.05)
    walk = load(bag)
    assert (walk.kind, walk.has_robot, walk.name) == ("tracked", True, "bag")
    np.testing.assert_allclose(walk.times_s, T, atol=1e-6)
    np.testing.assert_allclose(walk.measured.head_position_m, WALK, atol=1e-9)
    np.testing.assert_allclose(walk.truth.head_position_m, WALK, atol=1e-6)  # unchanged by smoothing
    np.testing.assert_allclose(walk.delays_s, 0.05, atol=1e-6)
    same_turns(walk.truth.head_quat_wxyz, Rotation.from_euler("z", np.pi), 1e-5)
    assert "face_a, 60 frames in camera_color_optical_frame, optical axes rotated" in walk.notes[0]
    (file,) = bag.glob(f"*{ending}")
    assert load(file).times_s.size == 60
    alone = load(file.rename(tmp_path / f"alone{ending}"))
    assert (alone.name, alone.times_s.size) == ("alone", 60)


def test_the_truth_is_the_smoothed_track(tmp_path):
    noise_m = 0.02 * np.random.default_rng(0).standard_normal(WALK.shape)
    rows = face_rows("face_a", START_S + T, WALK + noise_m, "base_link")
    walk = load(bag_of(tmp_path, rows))
    np.testing.assert_allclose(walk.measured.head_position_m, WALK + noise_m, atol=1e-9)
    left_m = np.sqrt(np.mean((walk.truth.head_position_m - WALK) ** 2))
    assert left_m < 0.4 * np.sqrt(np.mean(noise_m**2))


def test_face_axes_are_inferred_from_the_viewing_direction(tmp_path):
    """z out of the face and y down, as in head pose estimators for cameras."""
    walk = load(bag_of(tmp_path, facing_rows("face_a", Rotation.from_euler("y", np.pi))))
    same_turns(walk.truth.head_quat_wxyz, Rotation.from_euler("z", np.pi), 1e-5)
    assert "+z is used as the axis out of the face, -y as up" in "\n".join(walk.notes)


def test_orientations_with_ambiguous_axes_are_omitted_with_a_note(tmp_path):
    # One axis is nearest to both the vertical and the line of sight.
    x = np.array([-1.0, 0.0, 1.0]) / np.sqrt(2.0)
    y = np.cos(0.7) * np.array([1.0, 0.0, 1.0]) / np.sqrt(2.0) + np.sin(0.7) * np.array([0.0, 1.0, 0.0])
    seen = Rotation.from_matrix(np.column_stack([x, y, np.cross(x, y)]))
    in_optical = Rotation.from_quat(TO_OPTICAL, scalar_first=True).inv() * seen
    rows = face_rows("face_a", START_S + T, [0.0, 0.0, 2.0], quat_wxyz=wxyz(in_optical))
    walk = load(bag_of(tmp_path, rows))
    assert walk.truth.positions_only
    assert "orientations left out" in "\n".join(walk.notes)


def test_static_and_moving_transforms_compose_to_the_base(tmp_path):
    # The camera stands 1.2 m high on a head that pans by 0.2 rad/s; its pose is interpolated between messages.
    static = [
        (START_S, "base_link", "torso", (0.1, 0.0, 0.7), (1, 0, 0, 0)),
        (START_S, "pan", "camera_link", (0.05, 0.0, 0.1), (1, 0, 0, 0)),
        (START_S, "camera_link", OPTICAL, (0.0, 0.0, 0.0), TO_OPTICAL),
    ]
    slow = np.arange(-0.1, 2.2, 0.1)
    frames = [(START_S + t, "torso", "pan", (0.0, 0.0, 0.4), wxyz(Rotation.from_euler("z", 0.2 * t))) for t in slow]
    bag = bag_of(tmp_path, [*frames, *facing_rows("face_a", TO_SENSOR)], static=static)
    in_pan = WALK + np.array([0.05, 0.0, 0.1])
    c, s = np.cos(0.2 * T), np.sin(0.2 * T)
    base = np.column_stack([c * in_pan[:, 0] - s * in_pan[:, 1], s * in_pan[:, 0] + c * in_pan[:, 1], in_pan[:, 2]])
    walk = read(bag, bag_frame="base_link")
    np.testing.assert_allclose(walk.measured.head_position_m, base + np.array([0.1, 0.0, 1.1]), atol=1e-6)
    same_turns(walk.truth.head_quat_wxyz, Rotation.from_euler("z", 0.2 * T[:, None] + np.pi), 1e-4)
    with pytest.raises(SettingsError, match=r"no transform from camera_color_optical_frame to 'bas_link'.*'base_link'"):
        read(bag, bag_frame="bas_link")


def test_the_pelvis_is_that_of_the_same_skeleton(tmp_path):
    # body_b walks; torso_b and head_b are its descendants.
    hips = WALK - np.array([0.0, 0.0, 0.6])
    rows = face_rows("body_b", START_S + T, hips, "camera_link", wxyz(Rotation.from_euler("z", -np.pi / 2)))
    static = [
        (START_S, "body_b", "torso_b", (0.0, 0.0, 0.4), (1, 0, 0, 0)),
        (START_S, "torso_b", "head_b", (0.0, 0.0, 0.2), wxyz(Rotation.from_euler("z", 0.5))),
    ]
    walk = load(bag_of(tmp_path, rows, static=static))
    np.testing.assert_allclose(walk.measured.head_position_m, WALK, atol=1e-9)
    np.testing.assert_allclose(walk.measured.pelvis_position_m, hips, atol=1e-9)
    same_turns(walk.measured.head_quat_wxyz, Rotation.from_euler("z", 0.5 - np.pi / 2), 1e-5)
    same_turns(walk.measured.pelvis_quat_wxyz, Rotation.from_euler("z", -np.pi / 2), 1e-5)


@pytest.mark.parametrize(
    ("kind", "stamped"), [(POINT, True), ("geometry_msgs/msg/PoseWithCovarianceStamped", True), (POINT, False)]
)
def test_pose_and_point_topics_are_read(tmp_path, kind, stamped):
    """Without stamps the time of recording is used."""
    turn = wxyz(Rotation.from_euler("z", 2.0))
    rows = pose_rows(START_S + T, WALK, "camera_link", turn)
    walk = load(bag_of(tmp_path, [], topics=[("/head", kind, rows)], lists=(), stamped=stamped))
    np.testing.assert_allclose(walk.times_s, T, atol=1e-6)
    np.testing.assert_allclose(walk.measured.head_position_m, WALK, atol=1e-9)
    assert walk.truth.positions_only == (kind == POINT)
    if kind != POINT:
        np.testing.assert_allclose(walk.truth.head_quat_wxyz, np.tile(turn, (60, 1)), atol=1e-9)


def test_topics_of_people_rank_before_goals_by_length(tmp_path):
    rows = [*facing_rows("face_a", TO_SENSOR)[:30], *face_rows("face_b", START_S + T[:36], [0.3, 0.0, 1.5])]
    topics = [
        ("/goal_pose", POSE, pose_rows(START_S + T, np.tile([1.0, 0, 0], (60, 1)), "map")),
        ("/person", POINT, pose_rows(START_S + T[:30], WALK[:30], "camera_link")),
        ("/humans/persons/mia/face_id", "std_msgs/msg/String", [(START_S, "a"), (START_S + 1, "")]),
        ("/other", "std_msgs/msg/Bool", [(START_S, True)]),
    ]
    bag = bag_of(tmp_path, rows, topics=topics)
    found = "\n".join(load(bag).notes)
    assert "face_b, 36 frames" in found
    assert "face_a (30 in camera_color_optical_frame), /person (30 in camera_link), /goal_pose (60 in map)" in found
    chosen = read(bag, person="mia")
    assert (chosen.name, chosen.times_s.size) == ("bag_mia", 30)
    np.testing.assert_allclose(read(bag, bag_topic="/person").measured.head_position_m, WALK[:30], atol=1e-9)
    with pytest.raises(SettingsError, match=r"no 'mai' in .*perhaps you meant 'mia'.*face_b"):
        read(bag, person="mai")
    with pytest.raises(SettingsError, match=r"no person on /persons.*'/person'.*/goal_pose, /person, /tf"):
        read(bag, bag_topic="/persons")
    together = load_together(bag)
    assert [each.name for each in together] == ["bag_b", "bag_mia"]


def test_faces_of_one_person_are_joined(tmp_path):
    first, second = facing_rows("face_a", TO_SENSOR)[:25], facing_rows("face_b", TO_SENSOR)[30:]
    faces = [(START_S, "a"), (START_S + 1, "b")]
    topics = [("/humans/persons/mia/face_id", "std_msgs/msg/String", faces)]
    walk = load(bag_of(tmp_path, [*first, *second], topics=topics))
    np.testing.assert_allclose(walk.times_s, np.delete(T, np.s_[25:30]), atol=1e-6)
    assert "face_mia, 55 frames" in walk.notes[0]


def test_an_unlisted_face_is_not_observed(tmp_path):
    lists = [(START_S + t, ("a",) if t < 1.0 else ()) for t in T]
    walk = load(bag_of(tmp_path, facing_rows("face_a", TO_SENSOR), lists=lists))
    assert walk.times_s[-1] == pytest.approx(1.0, abs=0.04)
    assert "29 messages" in "\n".join(walk.notes)


def test_frames_without_stamps_use_the_recording_time(tmp_path):
    walk = load(bag_of(tmp_path, face_rows("face_a", START_S + T, WALK, "camera_link"), stamped=False))
    np.testing.assert_allclose(walk.times_s, T, atol=1e-6)
    np.testing.assert_allclose(walk.delays_s, 0.0)


def test_bad_rows_are_dropped_and_counted(tmp_path):
    rows = face_rows("face_a", START_S + T[:5], [0.0, 0.0, 1.0])
    rows += [rows[2], (START_S + 1, rows[0][1], "face_a", [0, 0, np.nan], (1, 0, 0, 0))]
    rows += [(START_S + 2, rows[0][1], "face_a", [0, 0, 1.0], (0, 0, 0, 0))]
    walk = load(bag_of(tmp_path, rows))
    assert walk.times_s.size == 5
    assert any(note.startswith("3 messages repeat a stamp") for note in walk.notes)


def test_bags_without_a_person_and_damaged_ones_are_refused(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(RecordingError, match="neither a ROS 2 bag"):
        load(tmp_path / "empty")
    wheel = write_bag(tmp_path / "wheel", face_rows("wheel_left", START_S + T, [0.0, 0.0, 1.0]))
    with pytest.raises(RecordingError, match=r"topics are /humans/faces/tracked, /tf.*face_<id>"):
        load(wheel)
    mapped = write_bag(tmp_path / "mapped", face_rows("person_a", START_S + T, [0.0, 0.0, 1.0], "map"))
    with pytest.raises(RecordingError, match="not in the frame of a sensor: person_a, 60 frames in map"):
        of_recording(mapped)
    (database,) = mapped.glob("*.db3")
    database.write_bytes(b"not a database" * 100)
    with pytest.raises(RecordingError, match="cannot be read"):
        load(mapped)


def test_a_replay_of_a_bag(tmp_path):
    folder = bag_of(tmp_path, facing_rows("face_a", TO_SENSOR))
    words = ["--replay", str(folder), "--controllers", "reactive", "--no-figures", "--noise-seeds", "1"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["kind"], summary["scored_against"].startswith("the tracker's own track")) == ("tracked", True)
    assert (summary["settings"]["sensor"], summary["settings"]["placement"]) == ("recorded", "recorded")


def test_a_track_too_short_for_a_recording_is_left_out_of_the_people(tmp_path):
    rows = [*facing_rows("face_a", TO_SENSOR), *facing_rows("face_b", TO_SENSOR)[10:13]]
    bag = bag_of(tmp_path, rows)
    assert [each.name for each in load_together(bag)] == ["bag_a"]
    short = bag_of(tmp_path / "short", facing_rows("face_b", TO_SENSOR)[10:13])
    with pytest.raises(RecordingError, match="only 3 frame"):
        load_together(short)
