"""Key points of a head at a known place give that place, with errors as stated."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gazempc.live.sources.camera.head import head_from_points

# Right eye, left eye, nose, mouth, right ear, left ear: x to the front, y to the person's left, z up.
FACE_M = np.array(
    [
        [0, -0.0315, 0],
        [0, 0.0315, 0],
        [0.022, 0, -0.036],
        [0.004, 0, -0.070],
        [-0.085, -0.070, -0.022],
        [-0.085, 0.070, -0.022],
    ]
)


def seen(eyes_m, yaw_deg, roll_deg=0.0, scale=1.0):
    """Tangents at which a head's points are seen; yaw from straight towards the origin."""
    yaw = np.deg2rad(180 + yaw_deg) + np.arctan2(eyes_m[1], eyes_m[0])
    c, s = np.cos(yaw), np.sin(yaw)
    r = np.deg2rad(roll_deg)
    rolled = scale * FACE_M @ np.array([[1, 0, 0], [0, np.cos(r), np.sin(r)], [0, -np.sin(r), np.cos(r)]])
    points = rolled @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + eyes_m
    return points[:, 1:] / points[:, :1]


def facing_deg(head):
    front = Rotation.from_quat(head.quat_wxyz, scalar_first=True).apply([1, 0, 0])
    return np.rad2deg(np.arctan2(front[1], front[0])) % 360


@pytest.mark.parametrize("yaw_deg", [-30, 0, 30])
@pytest.mark.parametrize("eyes_m", [[1.0, 0.0, 0.0], [3.5, -1.2, 0.4]])
def test_an_exact_face_is_found_where_it_is(eyes_m, yaw_deg):
    eyes_m = np.array(eyes_m)
    head = head_from_points(seen(eyes_m, yaw_deg), 1e-4)
    assert np.linalg.norm(head.position_m) == pytest.approx(np.linalg.norm(eyes_m), rel=0.02)
    across_m = head.position_m - eyes_m * (head.position_m @ eyes_m) / (eyes_m @ eyes_m)
    assert np.rad2deg(np.linalg.norm(across_m) / np.linalg.norm(eyes_m)) < 0.05
    expected_deg = 180 + yaw_deg + np.rad2deg(np.arctan2(eyes_m[1], eyes_m[0]))
    assert facing_deg(head) == pytest.approx(expected_deg, abs=2.5)  # what is likely draws it to the front a little


def test_the_range_is_uncertain_and_the_bearing_is_not():
    eyes_m = np.array([2.0, 0.8, -0.3])
    head = head_from_points(seen(eyes_m, 10), 0.001)
    variances, axes = np.linalg.eigh(head.covariance_m2)
    sight = head.position_m / np.linalg.norm(head.position_m)
    assert abs(axes[:, 2] @ sight) == pytest.approx(1.0, abs=1e-6)
    assert np.sqrt(variances[2]) / np.linalg.norm(eyes_m) == pytest.approx(0.105, abs=0.01)
    assert np.rad2deg(np.sqrt(variances[:2]) / np.linalg.norm(eyes_m)) == pytest.approx([0.15, 0.15], abs=0.07)


def test_errors_of_the_points_are_as_large_as_stated():
    """Monte Carlo: points with the stated error; errors of positions and yaws are as the covariance states, or less."""
    rng = np.random.default_rng(0)
    eyes_m, sd = np.array([2.5, -0.5, 0.2]), 0.002
    bearings, yaws, stated_yaw = [], [], []
    for _ in range(60):
        head = head_from_points(seen(eyes_m, 15) + rng.normal(0, sd, (6, 2)), sd)
        bearings.append(np.cross(head.position_m, eyes_m) / (eyes_m @ eyes_m))
        yaws.append(facing_deg(head) - (180 + 15 + np.rad2deg(np.arctan2(eyes_m[1], eyes_m[0]))))
        stated_yaw.append(np.rad2deg(head.yaw_sd_rad))
    measured_rad = np.sqrt(np.mean(np.sum(np.square(bearings), axis=1)) / 2)
    stated_rad = np.sqrt(np.linalg.eigvalsh(head.covariance_m2)[0]) / np.linalg.norm(eyes_m)
    assert 0.3 * stated_rad < measured_rad < 1.1 * stated_rad  # stated are differences between faces, too
    assert 0.3 * np.mean(stated_yaw) < np.std(yaws) < 1.1 * np.mean(stated_yaw)


def test_a_face_of_a_few_blurred_pixels_has_no_yaw():
    head = head_from_points(seen(np.array([4.0, 0.0, 0.0]), 0), 0.02)
    assert head.quat_wxyz is None
    assert head.yaw_sd_rad is None
