"""The directions of pixels are those of OpenCV's own projection."""

import cv2
import numpy as np
import pytest
import yaml

from gazempc.errors import SettingsError
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
    ("fields", "complaint"),
    [
        ({"camera": MATRIX}, "camera_matrix"),
        ({"K": MATRIX[:2]}, "3 x 3"),
        ({"K": -MATRIX}, "focal"),
        ({"K": MATRIX, "image_width": 1280, "image_height": 720}, "1280 x 720"),
        (None, "no such file"),
        ("{[", "YAML"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused(tmp_path, fields, complaint):
    file = tmp_path / "c.yml"
    if isinstance(fields, str):
        file.write_text(fields)
    elif fields is not None:
        opencv_file(file, **fields)
    with pytest.raises(SettingsError, match=complaint):
        from_calibration(file, 640, 480)
