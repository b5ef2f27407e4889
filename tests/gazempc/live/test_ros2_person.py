"""The source ros2: poses of a person with their time of capture."""

import numpy as np
import pytest
from builders.ros2_network import wait_for
from builders.ros2_wire import NOW_S, UNIX_START_S, key, pose, pose_with_covariance

from gazempc.live.mount import Mount
from gazempc.live.sources.ros2 import ANY_FRAME
from gazempc.ros2.wire import type_hash


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


def test_an_orientation_of_zeros_is_none(scene):
    person = scene.person()
    scene.poses.put(pose([2.0, 0.0, 0.4], [0.0] * 4))
    ((sighting,), _) = polled(person, 1)
    assert sighting.observation.head_quat_wxyz is None


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


def test_a_pose_in_an_optical_frame_is_taken_where_its_axes_are_known(scene):
    person = scene.person(frame_id=ANY_FRAME)
    scene.poses.put(pose([-0.3, 0.1, 2.0], frame_id="camera_color_optical_frame"))
    (sighting,), problems = polled(person, 1)
    assert problems == []
    in_sensor = Mount(axes="optical").in_sensor(sighting.observation)
    assert in_sensor.head_position_base_m == pytest.approx([2.0, 0.3, -0.1])


WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"


def test_a_covariance_of_position_and_yaw_is_used_and_zeros_are_not_known(scene):
    scene.router.close()
    # That the hashes of types are right is known from those in the builder.
    hashed = type_hash(WITH_COVARIANCE, humble=False)
    scene.start(poses=key(0, "person/head", WITH_COVARIANCE, hashed))
    person = scene.person(pose_type=WITH_COVARIANCE)
    full, position_only, bad = np.diag([0.25, 0.04, 0.01, 0.0, 0.0, 0.09]), np.zeros((6, 6)), np.zeros((6, 6))
    full[0, 1] = full[1, 0] = 0.05
    position_only[:3, :3] = np.eye(3)
    bad[5, 5] = -1.0
    at = [2.0, 0.1, 0.4]
    for k, covariance in enumerate((full, position_only, np.zeros((6, 6)), bad)):
        scene.poses.put(pose_with_covariance(at, covariance, stamp=(UNIX_START_S + 299, k)))
    scene.poses.put(pose_with_covariance(at, full, xyzw=(0.0, 0.0, 0.0, 0.0), stamp=(UNIX_START_S + 299, 9)))
    sightings, (problem,) = polled(person, 5)
    assert "yaw is -1.0" in problem
    first, second, third, blind = [s.observation for s in sightings]
    assert list(first.head_position_base_m) == at
    np.testing.assert_array_equal(first.position_covariance_m2, full[:3, :3])
    assert first.head_yaw_sd_rad == pytest.approx(0.3)
    np.testing.assert_array_equal(second.position_covariance_m2, np.eye(3))
    assert (second.head_yaw_sd_rad, third.position_covariance_m2, third.head_yaw_sd_rad) == (None, None, None)
    assert (blind.head_quat_wxyz, blind.head_yaw_sd_rad) == (None, None)
    np.testing.assert_array_equal(blind.position_covariance_m2, full[:3, :3])


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
