"""Sources of ROS 2 topics: heads with capture times, points and sounds as cues."""

import math
import threading
from dataclasses import replace

import numpy as np
import pytest
from builders.ros2_graph import (
    NOW_S,
    OPTICAL,
    POINT,
    WITH_COVARIANCE,
    detections,
    header,
    make_message,
    polled,
    pose,
    pose_stamped,
    stamped_point,
    transform,
    with_covariance,
)
from scipy.spatial.transform import Rotation

from gazempc.live.run import LiveRun
from gazempc.live.setup import setup_of_gaze
from gazempc.live.sources.ros2 import Ros2Person
from gazempc.live.sources.ros2_cues import Ros2Cues
from gazempc.people.company import Glance, Sound

TOPIC, POSE = "/person/head", "geometry_msgs/msg/PoseStamped"
ARRAY, DETECTIONS = "geometry_msgs/msg/PoseArray", "vision_msgs/msg/Detection3DArray"


def opened(stage, pose_type=POSE, base_frame=None, optical=False):
    given = stage.given(pose_type=pose_type, base_frame=base_frame)
    return stage.listening(Ros2Person(TOPIC, given, optical))


def test_poses_have_capture_times_and_unusable_ones_are_problems(stage):
    person = opened(stage)
    captured_s = NOW_S - 1.0 + np.arange(100) / 128
    for k, at_s in enumerate(captured_s):
        stage.put(TOPIC, POSE, pose_stamped([2.0, 0.01 * k, 0.4], (0.8, 0.0, 0.6, 0.0), at_s=at_s))
    wrong = {
        "not finite": pose_stamped([np.nan, 0.0, 0.4]),
        "not of unit length": pose_stamped([2.0, 0.0, 0.4], (2.0, 0.0, 0.0, 0.0)),
        "z points forward": pose_stamped([2.0, 0.0, 0.4], frame_id=OPTICAL),
    }
    for message in wrong.values():
        stage.put(TOPIC, POSE, message)
    seen, problems = polled(person, 103)
    assert all(TOPIC in problem and reason in problem for problem, reason in zip(problems, wrong, strict=True))
    assert [each.capture_time_s for each in seen] == pytest.approx(captured_s)
    assert [list(each.head_position_base_m) for each in seen] == [[2.0, 0.01 * k, 0.4] for k in range(100)]
    assert all(list(each.head_quat_wxyz) == [0.8, 0.0, 0.6, 0.0] for each in seen)
    assert person.poll().sightings == ()


def test_position_and_yaw_covariances_are_used_and_zeros_mean_unknown(stage):
    person = opened(stage, WITH_COVARIANCE)
    full, position_only, bad = np.diag([0.25, 0.04, 0.01, 0.0, 0.0, 0.09]), np.zeros((6, 6)), np.zeros((6, 6))
    full[0, 1] = full[1, 0] = 0.05
    position_only[:3, :3] = np.eye(3)
    bad[5, 5] = -1.0
    at = [2.0, 0.1, 0.4]
    for covariance in (full, position_only, np.zeros((6, 6)), bad):
        stage.put(TOPIC, WITH_COVARIANCE, with_covariance(at, covariance))
    stage.put(TOPIC, WITH_COVARIANCE, with_covariance(at, full, quat_wxyz=(0.0, 0.0, 0.0, 0.0)))
    (first, second, third, blind), (problem,) = polled(person, 5)
    assert "yaw is -1.0" in problem
    assert list(first.head_position_base_m) == at
    np.testing.assert_array_equal(first.position_covariance_m2, full[:3, :3])
    assert first.head_yaw_sd_rad == pytest.approx(0.3)
    np.testing.assert_array_equal(second.position_covariance_m2, np.eye(3))
    assert (second.head_yaw_sd_rad, third.position_covariance_m2, third.head_yaw_sd_rad) == (None, None, None)
    assert (blind.head_quat_wxyz, blind.head_yaw_sd_rad) == (None, None)
    np.testing.assert_array_equal(blind.position_covariance_m2, full[:3, :3])


def test_points_and_pose_arrays_are_read(stage):
    pointed = opened(stage, POINT)
    stage.put(TOPIC, POINT, stamped_point("camera_link", [1.0, 2.0, 0.3], NOW_S))
    (seen,), _ = polled(pointed, 1)
    assert (list(seen.head_position_base_m), seen.head_quat_wxyz) == ([1.0, 2.0, 0.3], None)
    several = opened(stage, ARRAY)
    poses = [pose([1.0, 0.0, 0.3]), pose([np.nan, 0.0, 0.0]), pose([2.0, 0.0, 0.3])]
    stage.put(TOPIC, ARRAY, make_message(ARRAY, header=header("camera_link", NOW_S), poses=poses))
    found, (problem,) = polled(several, 3)
    assert [each.head_position_base_m[0] for each in found] == [1.0, 2.0]
    assert "not finite" in problem


def test_detections_have_ids_scores_and_a_box_as_fallback_pose(stage):
    person = opened(stage, DETECTIONS)
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = 0.01 * np.eye(3)

    stated = [("7", 0.8, [1.0, 0.0, 0.2], [0.0] * 3), ("", 1.2, [0.0] * 3, [2.0, 0.0, 0.2])]
    stage.put(TOPIC, DETECTIONS, detections(*stated, covariance=covariance))
    (first, second), _ = polled(person, 2)
    assert (first.person_id, first.confidence, second.person_id, second.confidence) == ("7", 0.8, None, 1.0)
    np.testing.assert_array_equal(first.position_covariance_m2, covariance[:3, :3])
    assert (list(second.head_position_base_m), second.position_covariance_m2) == ([2.0, 0.0, 0.2], None)


def test_a_pose_in_a_moving_frame_is_placed_by_tf_at_its_stamp(stage):
    person = opened(stage, WITH_COVARIANCE, base_frame="base_link")
    turns = [Rotation.from_euler("z", deg, degrees=True).as_quat(scalar_first=True) for deg in (0.0, 40.0)]
    stage.tf(transform("camera_link", [0.0, 0.0, 1.0], turns[0], "base_link", NOW_S - 0.1))
    covariance = np.diag([0.04, 0.0001, 0.0001, 0.0, 0.0, 0.09])
    stage.put(TOPIC, WITH_COVARIANCE, with_covariance([2.0, 0.0, 0.0], covariance, at_s=NOW_S - 0.05))
    assert person.poll().sightings == ()  # the transform at the stamp has not arrived yet
    stage.tf(transform("camera_link", [0.0, 0.0, 1.0], turns[1], "base_link", NOW_S))
    (seen,), problems = polled(person, 1)
    assert problems == []
    turn = Rotation.from_euler("z", 20.0, degrees=True)
    np.testing.assert_allclose(
        seen.head_position_base_m, turn.apply([2.0, 0.0, 0.0]) + np.array([0.0, 0.0, 1.0]), atol=1e-6
    )
    expected_m2 = turn.as_matrix() @ covariance[:3, :3] @ turn.as_matrix().T
    np.testing.assert_allclose(seen.position_covariance_m2, expected_m2, atol=1e-9)
    np.testing.assert_allclose(abs(seen.head_quat_wxyz @ turn.as_quat(scalar_first=True)), 1.0, atol=1e-9)


INT = "std_msgs/msg/Int32"


def opened_cues(stage, to_base=lambda place_m: place_m, **options):
    return stage.listening(Ros2Cues(stage.given(**options), to_base))


def test_a_glance_point_waits_for_its_transform_and_then_is_a_problem(stage):
    source = opened_cues(stage, point_topic="pointing", base_frame="base_link", point_lasts_s=1.5)
    stage.put("/pointing", POINT, stamped_point("base_link", [np.nan, 0, 0]))
    _, (problem,) = polled(source, 1)
    assert "/pointing" in problem
    stage.put("/pointing", POINT, stamped_point("cup", [1, 0, 0]))
    polled(source, 0)
    for y_m, at_s in ((5.0, NOW_S - 0.2), (1.0, NOW_S - 0.1)):
        stage.tf(transform("cup", [0, y_m, 0], frame_id="base_link", at_s=at_s))
    (glance,), _ = polled(source, 1)
    assert (type(glance), glance.lasts_s, glance.target_base_m.tolist()) == (Glance, 1.5, [1, 1, 0])
    stage.put("/pointing", POINT, stamped_point("cup", [1, 0, 0], NOW_S - 0.15))
    (glance,), _ = polled(source, 1)
    np.testing.assert_allclose(glance.target_base_m, [1, 3, 0], atol=1e-5)
    stage.put("/pointing", POINT, stamped_point("bottle", [1, 0, 0]))
    polled(source, 0)
    stage.now_s += 0.25
    _, (problem,) = polled(source, 1)
    assert "'bottle' to 'base_link'" in problem


def test_a_sound_direction_is_in_degrees(stage):
    source = opened_cues(stage, sound_topic="/sound_direction")
    for data in (-90, 1000):
        stage.put("/sound_direction", INT, make_message(INT, data=data))
    found, (problem,) = polled(source, 2)
    assert found == [Sound(NOW_S, -math.pi / 2)]
    assert "is 1000" in problem


def test_a_sound_direction_is_transformed_from_a_turned_head(stage):
    def turned_left(place_m):
        return Rotation.from_euler("z", 10.0, degrees=True).apply(place_m) + 1.0

    source = opened_cues(stage, turned_left, sound_topic="heard", sound_frame="microphones", base_frame="base_link")
    stage.put("/heard", INT, make_message(INT, data=20))
    _, (problem,) = polled(source, 1)
    assert "'microphones' to 'base_link'" in problem
    quat = Rotation.from_euler("z", -50.0, degrees=True).as_quat(scalar_first=True)
    stage.tf(transform("microphones", [0, 0, 1], quat, "base_link"))
    source.poll()
    stage.put("/heard", INT, make_message(INT, data=20))
    (sound,), _ = polled(source, 1)
    assert math.degrees(sound.azimuth_rad) == pytest.approx(20 - 50 + 10)


def test_a_python_gaze_receives_ros_cues(stage):
    settings = {"attend": "speaker"}
    setup, _, _ = setup_of_gaze("reference", "simulated", "lookahead", "constant_velocity", settings)
    given = replace(stage.given(sound_topic="heard"), clock_s=setup.clock.now_s, to_loop_s=lambda unix_s: unix_s)
    cues = Ros2Cues(given, lambda at_m: at_m)
    run = LiveRun(replace(setup, more_sources=(cues,)), lambda log, times: None)

    def publish():
        for degrees in (20, 1000):
            stage.put("/heard", INT, make_message(INT, data=degrees))

    run.run(threading.Event(), 0.3, publish)
    assert run.logs.events["bad_observation"] == 1
    (sound,) = setup.several.several.attention._sounds
    assert math.degrees(sound.azimuth_rad) == pytest.approx(20)
    assert "/heard" in run.report.problems[0]
