"""The synthetic data set: exact reproducibility, human gait, and the room."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from gazempc.recordings.readers.labels import route_group
from gazempc.recordings.synthetic.walks import ROUTES, generate, synthetic_names

FRAME_S = 1.0 / 30.0


@pytest.fixture(scope="module")
def walks():
    return {name: generate(name) for name in synthetic_names()}


def yaw_rate(walk):
    yaw = Rotation.from_quat(walk.truth.head_quat_wxyz, scalar_first=True).as_euler("ZYX")[:, 0]
    return gaussian_filter1d(np.gradient(np.unwrap(yaw)), 8.0)


def travel_rate(walk):
    """Direction of the pelvis after smoothing of the gait."""
    velocity = np.gradient(walk.truth.pelvis_position_m[:, :2], axis=0)
    velocity = gaussian_filter1d(velocity, 8.0, axis=0, mode="nearest")
    return gaussian_filter1d(np.gradient(np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))), 1.0)


def lead_s(early, late):
    """Time by which `early` leads `late`: the peak of their cross-correlation, within 0.6 s."""
    lags = np.arange(-18, 19)
    count = len(early)
    similarity = [
        np.corrcoef(early[max(0, -lag) : count - max(0, lag)], late[max(0, lag) : count - max(0, -lag)])[0, 1]
        for lag in lags
    ]
    best = int(np.argmax(similarity))
    assert 0 < best < len(lags) - 1
    before, peak, after = similarity[best - 1 : best + 2]
    return float(lags[best] + 0.5 * (before - after) / (before - 2 * peak + after)) * FRAME_S


def test_a_recording_is_the_same_on_every_platform(walks):
    walk = walks["subject03_R5"]
    rows = [0, 70, -1]
    expected = [
        5.013262172314, 1.367599517557, 0.419692020173, 2.728130409325, 0.819224365177, 0.417529619145,
        3.257223171937, -1.300852871127, 0.405438923427, 0.279968778511, 0.055983771996, -0.004215026902,
        -0.958366075089, 0.309252247329, 0.000000000000, 0.000000000000, -0.950980045806, 2.735070327453,
        0.824824858816, 0.419059721325,
    ]  # fmt: skip
    found = np.concatenate(
        [
            walk.truth.head_position_m[rows].ravel(),
            walk.truth.head_quat_wxyz[70],
            walk.truth.pelvis_quat_wxyz[70],
            walk.measured.head_position_m[70],
        ]
    )
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9)


def test_groups_follow_from_the_motion(walks):
    for walk in walks.values():
        assert route_group(walk.times_s, walk.truth.pelvis_position_m) == walk.labels.group, walk.name


def test_head_yaw_leads_the_direction_of_travel_in_sharp_turns(walks):
    turns = [[walks[f"subject{subject:02}_R{route}"] for route in (5, 6)] for subject in range(1, 15)]
    leads = np.array([[lead_s(yaw_rate(walk), travel_rate(walk)) for walk in both] for both in turns]).mean(axis=1)
    assert 0.15 < leads.mean() < 0.26
    assert leads.min() > 0.0


def noise_m(walk):
    """Distance, error along the ray, and error across it in one direction, of frames with a person."""
    seen = walk.measured.valid
    true = walk.truth.head_position_m[seen]
    error = walk.measured.head_position_m[seen] - true
    distance = np.linalg.norm(true, axis=1)
    along = (error * true).sum(axis=1) / distance
    left = np.stack([-true[:, 1], true[:, 0]], axis=1) / np.hypot(true[:, 0], true[:, 1])[:, None]
    return distance, along, (error[:, :2] * left).sum(axis=1)


def test_position_noise_equals_that_of_the_depth_camera(walks):
    parts = [noise_m(walk) for walk in walks.values()]
    biases = np.array([along.mean() for _, along, _ in parts])
    assert np.abs(biases).max() < 0.011 + 0.005  # the noise leaves about 1.4 mm in a mean over a clip
    assert biases.std() > 0.004
    distance = np.concatenate([part[0] for part in parts])
    along = np.concatenate([part[1] - part[1].mean() for part in parts])
    across = np.concatenate([part[2] for part in parts])
    far, near = distance > 3.4, distance < 2.4
    assert 0.015 < along[far].std() < 0.0175
    assert 0.005 < along[near].std() < 0.013
    assert 0.2 < across.std() / along.std() < 0.6
    assert abs(np.corrcoef(along[:-1], along[1:])[0, 1]) < 0.05


# ---------------------------------------------------------------- the room of the experiment


# Size of the room, number of desks and camera are those of Tamaru et al. (2021); the layout is assumed, x forward and y
# left of the sensor. Partitions stand just outside of the view.
ROOM_M = np.array([[-0.3, -4.5], [7.0, 4.5]])
PARTITIONS_M = np.array([[[1.5, 3.45], [3.2, 3.45]], [[1.5, -3.45], [3.2, -3.45]], [[5.7, -0.8], [5.7, 0.8]]])
SENSOR_RANGE_M, SENSOR_HALF_ANGLE_RAD = (0.5, 5.46), np.radians(37.5)
# Desks at which each route starts and ends. A left turn toward the robot ends on the robot's right.
DESKS = {
    "R1": ("right", "left"), "R2": ("left", "right"), "R3": ("far", "right"),
    "R4": ("far", "left"), "R5": ("far", "right"), "R6": ("far", "left"),
}  # fmt: skip
CLEARANCE_M = 0.25  # half the breadth of the shoulders


def partition_points():
    share = np.linspace(0.0, 1.0, 100)[:, None, None]
    return ((1 - share) * PARTITIONS_M[:, 0] + share * PARTITIONS_M[:, 1]).reshape(-1, 2)


def test_every_walk_keeps_clear_of_walls_and_partitions(walks):
    low, high = ROOM_M
    for head in (walk.truth.head_position_m for walk in walks.values()):
        path = head[:, :2]
        assert np.minimum(path - low, high - path).min() >= CLEARANCE_M
        assert np.linalg.norm(path[:, None] - partition_points(), axis=-1).min() >= CLEARANCE_M


def test_every_walk_is_in_view_and_no_partition_is(walks):
    def in_view(x, y, distance):
        nearest_m, farthest_m = SENSOR_RANGE_M
        beside = np.abs(np.arctan2(y, x)) <= SENSOR_HALF_ANGLE_RAD
        return beside & (nearest_m <= distance) & (distance <= farthest_m)

    for head in (walk.truth.head_position_m for walk in walks.values()):
        assert in_view(head[:, 0], head[:, 1], np.linalg.norm(head, axis=1)).all()
    x, y = partition_points().T
    assert not in_view(x, y, np.hypot(x, y)).any()


def test_routes_end_on_their_named_side(walks):
    assert DESKS.keys() == ROUTES.keys()
    for name, (start, end) in DESKS.items():
        path = walks[f"subject01_{name}"].truth.head_position_m
        assert (start == "far") == (ROUTES[name].group != "straight")
        assert np.sign(path[-1, 1] - path[0, 1]) == (1 if end == "left" else -1)
