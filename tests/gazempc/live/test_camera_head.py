"""From pixels to a head: directions as OpenCV projects them, and a pose with errors as stated."""

import cv2
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from gazempc.errors import SettingsError
from gazempc.live.sources.camera.head import head_from_points
from gazempc.live.sources.camera.intrinsics import from_calibration, from_field_of_view

MATRIX = np.array([[610.0, 0, 331.0], [0, 605.0, 236.0], [0, 0, 1]])
DISTORTION = np.array([-0.31, 0.11, 0.001, -0.0005, -0.02])
POINTS_M = np.array([[2.0, 0.7, 0.3], [1.0, -0.3, -0.2], [3.0, 0.0, 0.0]])  # x along the view, y left, z up
TANGENTS = POINTS_M[:, 1:] / POINTS_M[:, :1]


def projected(matrix, distortion):
    """Pixels by OpenCV, whose z is along the view, x right, y down."""
    optical = np.stack([-POINTS_M[:, 1], -POINTS_M[:, 2], POINTS_M[:, 0]], axis=1)
    return cv2.projectPoints(optical, np.zeros(3), np.zeros(3), matrix, distortion)[0][:, 0]


def opencv_file(path, **fields):
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in fields.items():
        storage.write(name, value)
    storage.release()
    return path


@pytest.mark.parametrize(
    ("ending", "names"),
    [("yml", ("camera_matrix", "distortion_coefficients")), ("xml", ("cameraMatrix", "distCoeffs")), ("json", "KD")],
)
def test_opencvs_calibration_files(tmp_path, ending, names):
    file = opencv_file(tmp_path / f"camera.{ending}", **{names[0]: MATRIX, names[1]: DISTORTION})
    assert from_calibration(file, 640, 480).rays(projected(MATRIX, DISTORTION)) == pytest.approx(TANGENTS, abs=1e-4)


def test_a_calibration_file_of_ros(tmp_path):
    file = tmp_path / "head_camera.yaml"
    matrix = {"rows": 3, "cols": 3, "data": MATRIX.ravel().tolist()}
    distortion = {"rows": 1, "cols": 5, "data": DISTORTION.tolist()}
    matrices = {"camera_matrix": matrix, "distortion_coefficients": distortion}
    file.write_text(yaml.safe_dump({"image_width": 640, "image_height": 480} | matrices))
    assert from_calibration(file, 640, 480).rays(projected(MATRIX, DISTORTION)) == pytest.approx(TANGENTS, abs=1e-4)
    # At another size of the same shape: edges double, middles of pixels with them.
    pixels = 2 * (projected(MATRIX, DISTORTION) + 0.5) - 0.5
    assert from_calibration(file, 1280, 960).rays(pixels) == pytest.approx(TANGENTS, abs=1e-4)


def test_a_field_of_view_spans_the_picture():
    camera = from_field_of_view(60.0, 640, 480)
    left_edge, middle, top_edge = camera.rays(np.array([[-0.5, 239.5], [319.5, 239.5], [319.5, -0.5]]))
    assert left_edge == pytest.approx([np.tan(np.deg2rad(30)), 0])
    assert middle == pytest.approx([0, 0])
    assert top_edge == pytest.approx([0, np.tan(np.deg2rad(30)) * 480 / 640])


@pytest.mark.parametrize(
    ("fields", "named"),
    [
        ({"camera": MATRIX}, "camera_matrix"),
        ({"K": MATRIX[:2]}, "3 x 3"),
        ({"K": -MATRIX}, "focal"),
        ({"K": MATRIX, "image_width": 1280, "image_height": 720}, "1280 x 720"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused(tmp_path, fields, named):
    with pytest.raises(SettingsError, match=named):
        from_calibration(opencv_file(tmp_path / "c.yml", **fields), 640, 480)


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
    heads = [head_from_points(seen(eyes_m, 15) + rng.normal(0, sd, (6, 2)), sd) for _ in range(60)]
    head, yaws = heads[-1], [facing_deg(each) for each in heads]
    bearings = [np.cross(each.position_m, eyes_m) / (eyes_m @ eyes_m) for each in heads]
    stated_yaw = [np.rad2deg(each.yaw_sd_rad) for each in heads]
    measured_rad = np.sqrt(np.mean(np.sum(np.square(bearings), axis=1)) / 2)
    stated_rad = np.sqrt(np.linalg.eigvalsh(head.covariance_m2)[0]) / np.linalg.norm(eyes_m)
    assert 0.3 * stated_rad < measured_rad < 1.1 * stated_rad  # stated are differences between faces, too
    assert 0.3 * np.mean(stated_yaw) < np.std(yaws) < 1.1 * np.mean(stated_yaw)


def test_a_face_of_a_few_blurred_pixels_has_no_yaw():
    head = head_from_points(seen(np.array([4.0, 0.0, 0.0]), 0), 0.02)
    assert head.quat_wxyz is None
    assert head.yaw_sd_rad is None
