"""Faces and their names in pictures, directions against OpenCV's projection, head positions with stated errors."""

import numpy as np
import pytest
import yaml
from builders.cameras import DISTORTION, MATRIX, TANGENTS, Faces, opencv_file, points_of, projected
from scipy.spatial.transform import Rotation
from skimage import data

from gazempc.errors import SettingsError
from gazempc.live.sources.camera.blazeface import BlazeFace
from gazempc.live.sources.camera.finder import FaceFinder
from gazempc.live.sources.camera.head import head_from_points
from gazempc.live.sources.camera.intrinsics import from_calibration, from_field_of_view

FRAME_S = 1 / 15
PICTURE = np.zeros((480, 640, 3), np.uint8)


@pytest.fixture
def faces():
    return Faces()


@pytest.fixture
def finder(faces):
    return FaceFinder(faces)


def names(found):
    return [person.person_id for person in found]


def after(finder, pictures, start_s=0.0):
    """Names in the last of these pictures."""
    return names([finder.detect(PICTURE, start_s + k * FRAME_S) for k in range(pictures)][-1])


@pytest.mark.parametrize("face", [(100, 100, 24), (320, 260, 300), (610, 450, 30)])
def test_a_new_face_is_confirmed_within_half_a_second(faces, finder, face):
    faces.here = [face]
    assert after(finder, 8) == ["1"]


@pytest.mark.parametrize(("rate_hz", "pictures"), [(15, 3), (5, 2), (60, 12)])
def test_a_short_detection_is_not_confirmed(faces, finder, rate_hz, pictures):
    """Heads from behind score like faces for up to 0.2 s."""
    for k in range(40):
        faces.here = [(320, 240, 90)] if k % 20 < pictures else []
        assert finder.detect(PICTURE, k / rate_hz) == []


def test_a_detection_absent_in_the_mirror_image_is_rejected(faces, finder):
    faces.here, faces.mirrored_score = [(320, 240, 90)], 0.35
    assert all(finder.detect(PICTURE, k * FRAME_S) == [] for k in range(30))
    faces.mirrored_score = 0.8
    assert after(finder, 8, 2.0) == ["1"]
    # A tracked person turns away: the score stays high, but the mirror image is no face.
    faces.score, faces.mirrored_score = 0.45, 0.32
    assert names(finder.detect(PICTURE, 3.0)) == ["1"]
    faces.mirrored_score = 0.28
    assert finder.detect(PICTURE, 3.1) == []


def test_a_name_persists_while_person_or_camera_moves(faces, finder):
    for k in range(60):
        faces.here = [(60 + 4 * k + (60 if k > 30 else 0), 200, 30)]
        found = finder.detect(PICTURE, k * FRAME_S)
        if k > 5:
            assert names(found) == ["1"]
            assert found[0].face.box_px[:2] == pytest.approx(faces.here[0][:2])
    for k in range(6):  # also on a slow computer
        faces.here = [(380 + 4 * k, 200, 30)]
        assert names(finder.detect(PICTURE, 4.0 + 1.5 * k)) == ["1"]


def test_crossing_people_keep_their_names(faces, finder):
    for k in range(60):
        faces.here = [(100 + 6 * k, 200, 40), (500 - 6 * k, 260, 60)]
        found = finder.detect(PICTURE, k * FRAME_S)
    left, right = sorted(found, key=lambda person: person.face.box_px[0])
    assert {left.person_id, right.person_id} == {"1", "2"}
    assert left.face.width_px == pytest.approx(60)


def test_a_name_persists_over_a_short_absence_only(faces, finder):
    for here, pictures, start_s, found in (
        ([(300, 200, 40)], 8, 0.0, ["1"]),
        ([], 8, 0.6, []),
        ([(330, 200, 40)], 3, 1.2, ["1"]),
        ([], 30, 2.0, []),
        ([(330, 200, 40)], 8, 5.0, ["2"]),
    ):
        faces.here = here
        assert after(finder, pictures, start_s) == found


# The portrait's pupils and tip of the nose, measured by hand, pixels.
RIGHT_EYE, LEFT_EYE, NOSE = (203, 101), (246, 103), (226, 127)


@pytest.mark.parametrize(("corner", "side"), [((0, 0), 512), ((-100, -150), 700), ((150, 30), 150)])
def test_faces_have_picture_coordinates_also_beyond_the_edges(corner, side):
    detector = BlazeFace()
    (found,) = detector.faces(data.astronaut(), corner, side, 0.5)
    assert found.points_px[0] == pytest.approx(RIGHT_EYE, abs=0.025 * side)
    assert found.points_px[1] == pytest.approx(LEFT_EYE, abs=0.025 * side)
    assert found.points_px[2] == pytest.approx(NOSE, abs=0.035 * side)
    assert detector.faces(data.astronaut(), (0, 250), 256, 0.5) == []


@pytest.mark.parametrize(
    ("ending", "names"),
    [("yml", ("camera_matrix", "distortion_coefficients")), ("xml", ("cameraMatrix", "distCoeffs")), ("json", "KD")],
)
def test_opencv_calibration_files_are_read(tmp_path, ending, names):
    file = opencv_file(tmp_path / f"camera.{ending}", **{names[0]: MATRIX, names[1]: DISTORTION})
    assert from_calibration(file, 640, 480).rays(projected(MATRIX, DISTORTION)) == pytest.approx(TANGENTS, abs=1e-4)


def test_a_ros_calibration_file_is_read(tmp_path):
    file = tmp_path / "head_camera.yaml"
    matrix = {"rows": 3, "cols": 3, "data": MATRIX.ravel().tolist()}
    distortion = {"rows": 1, "cols": 5, "data": DISTORTION.tolist()}
    matrices = {"camera_matrix": matrix, "distortion_coefficients": distortion}
    file.write_text(yaml.safe_dump({"image_width": 640, "image_height": 480} | matrices))
    assert from_calibration(file, 640, 480).rays(projected(MATRIX, DISTORTION)) == pytest.approx(TANGENTS, abs=1e-4)
    # At another size of the same aspect ratio: edges scale by two, pixel centres accordingly.
    pixels = 2 * (projected(MATRIX, DISTORTION) + 0.5) - 0.5
    assert from_calibration(file, 1280, 960).rays(pixels) == pytest.approx(TANGENTS, abs=1e-4)


def test_the_field_of_view_gives_the_focal_length():
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
def test_an_unusable_calibration_file_is_refused(tmp_path, fields, named):
    with pytest.raises(SettingsError, match=named):
        from_calibration(opencv_file(tmp_path / "c.yml", **fields), 640, 480)


def facing_deg(head):
    front = Rotation.from_quat(head.head_quat_wxyz, scalar_first=True).apply([1, 0, 0])
    return np.rad2deg(np.arctan2(front[1], front[0])) % 360


@pytest.mark.parametrize("yaw_deg", [-30, 0, 30])
@pytest.mark.parametrize("eyes_m", [[1.0, 0.0, 0.0], [3.5, -1.2, 0.4]])
def test_an_exact_face_gives_the_exact_head_pose(eyes_m, yaw_deg):
    eyes_m = np.array(eyes_m)
    head = head_from_points(points_of(eyes_m, yaw_deg), 1e-4)
    assert np.linalg.norm(head.head_position_base_m) == pytest.approx(np.linalg.norm(eyes_m), rel=0.02)
    across_m = head.head_position_base_m - eyes_m * (head.head_position_base_m @ eyes_m) / (eyes_m @ eyes_m)
    assert np.rad2deg(np.linalg.norm(across_m) / np.linalg.norm(eyes_m)) < 0.05
    expected_deg = 180 + yaw_deg + np.rad2deg(np.arctan2(eyes_m[1], eyes_m[0]))
    assert facing_deg(head) == pytest.approx(expected_deg, abs=2.5)  # the prior draws the estimate to the front


def test_range_variance_dominates_bearing_variance():
    eyes_m = np.array([2.0, 0.8, -0.3])
    head = head_from_points(points_of(eyes_m, 10), 0.001)
    variances, axes = np.linalg.eigh(head.position_covariance_m2)
    sight = head.head_position_base_m / np.linalg.norm(head.head_position_base_m)
    assert abs(axes[:, 2] @ sight) == pytest.approx(1.0, abs=1e-6)
    assert np.sqrt(variances[2]) / np.linalg.norm(eyes_m) == pytest.approx(0.105, abs=0.01)
    assert np.rad2deg(np.sqrt(variances[:2]) / np.linalg.norm(eyes_m)) == pytest.approx([0.15, 0.15], abs=0.07)


def test_keypoint_errors_have_the_stated_covariance():
    """Monte Carlo over keypoint errors: errors of positions and yaws are at most those of the covariance."""
    rng = np.random.default_rng(0)
    eyes_m, sd = np.array([2.5, -0.5, 0.2]), 0.002
    heads = [head_from_points(points_of(eyes_m, 15) + rng.normal(0, sd, (6, 2)), sd) for _ in range(60)]
    head, yaws = heads[-1], [facing_deg(each) for each in heads]
    bearings = [np.cross(each.head_position_base_m, eyes_m) / (eyes_m @ eyes_m) for each in heads]
    stated_yaw = [np.rad2deg(each.head_yaw_sd_rad) for each in heads]
    measured_rad = np.sqrt(np.mean(np.sum(np.square(bearings), axis=1)) / 2)
    stated_rad = np.sqrt(np.linalg.eigvalsh(head.position_covariance_m2)[0]) / np.linalg.norm(eyes_m)
    assert 0.3 * stated_rad < measured_rad < 1.1 * stated_rad  # the stated error includes differences between faces
    assert 0.3 * np.mean(stated_yaw) < np.std(yaws) < 1.1 * np.mean(stated_yaw)


def test_a_face_of_a_few_blurred_pixels_has_no_yaw():
    head = head_from_points(points_of(np.array([4.0, 0.0, 0.0]), 0), 0.02)
    assert head.head_quat_wxyz is None
    assert head.head_yaw_sd_rad is None
