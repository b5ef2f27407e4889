"""Camera intrinsics, from a field of view or from a calibration by OpenCV."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gazempc.errors import SettingsError
from gazempc.files.documents import parse_yaml, read_settings
from gazempc.live.sources.camera.blazeface import import_opencv
from gazempc.types import FloatArray

# Names in files of OpenCV's calibration programs, ROS's camera_calibration and common scripts.
_MATRIX_NAMES = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "mtx")
_DISTORTION_NAMES = ("distortion_coefficients", "distCoeffs", "Distortion_Coefficients", "D", "dist")
# Tolerance of the aspect ratio, as sizes are whole numbers.
_SAME_SHAPE = 0.01
_SIZE_NAMES = (("image_width", "image_height"), ("imageWidth", "imageHeight"), ("width", "height"))


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera with OpenCV's distortion.

    Attributes:
        matrix: fx, 0, cx; 0, fy, cy; 0, 0, 1 in pixels, shape (3, 3); the middle of the first pixel is (0, 0).
        distortion: OpenCV's coefficients, shape (n,); empty for none.
    """

    matrix: FloatArray
    distortion: FloatArray

    def rays(self, points_px: FloatArray) -> FloatArray:
        """Back-project pixels to viewing rays.

        Args:
            points_px: Columns and rows, shape (n, 2), pixels.

        Returns:
            Normalised image coordinates, positive left and up, shape (n, 2).
        """
        if self.distortion.size:
            cv2 = import_opencv()
            straight = cv2.undistortPoints(points_px[:, None].astype(np.float64), self.matrix, self.distortion)[:, 0]
        else:
            straight = (points_px - self.matrix[:2, 2]) / np.diag(self.matrix)[:2]
        return np.asarray(-straight, dtype=np.float64)

    def half_view_rad(self, width: int, height: int) -> tuple[float, float]:
        """Half of a picture's width and height, on the wider side of the optical axis, radians."""
        edges = np.array([[-0.5, (height - 1) / 2], [width - 0.5, (height - 1) / 2]])
        ends = np.array([[(width - 1) / 2, -0.5], [(width - 1) / 2, height - 0.5]])
        across, along = np.abs(self.rays(edges)[:, 0]).max(), np.abs(self.rays(ends)[:, 1]).max()
        return float(np.arctan(across)), float(np.arctan(along))


def from_field_of_view(fov_deg: float, width: int, height: int) -> Intrinsics:
    """A camera without distortion, with square pixels and a centred principal point.

    Args:
        fov_deg: Horizontal field of view, degrees.
        width: Width of its picture, pixels.
        height: Height, pixels.

    Returns:
        The camera.
    """
    focal_px = width / 2 / math.tan(math.radians(fov_deg) / 2)
    matrix = np.array([[focal_px, 0.0, (width - 1) / 2], [0.0, focal_px, (height - 1) / 2], [0.0, 0.0, 1.0]])
    return Intrinsics(matrix, np.empty(0))


def from_calibration(path: Path, width: int, height: int) -> Intrinsics:
    """A calibrated camera.

    Args:
        path: YAML, XML or JSON as OpenCV's FileStorage writes it, or YAML of ROS's camera_calibration.
        width: Width of the pictures, pixels. A calibration at another size is scaled if the aspect ratio is equal.
        height: Height, pixels.

    Returns:
        The camera.

    Raises:
        SettingsError: If the file cannot be read, lacks the camera matrix, or is of pictures of another aspect ratio.
    """
    values = _values(path)
    matrix = next((values[name] for name in _MATRIX_NAMES if name in values), None)
    if matrix is None:
        names = ", ".join(_MATRIX_NAMES)
        raise SettingsError(f"--camera.calibration {path}: no camera matrix; accepted names: {names}")
    if matrix.size != 9 or not np.isfinite(matrix).all() or not (matrix.flat[0] > 0 and matrix.flat[4] > 0):
        raise SettingsError(
            f"--camera.calibration {path}: the camera matrix is {matrix.tolist()}; expected 3 x 3 numbers with "
            "positive focal lengths"
        )
    matrix = np.array(matrix.reshape(3, 3))
    distortion = next((values[name] for name in _DISTORTION_NAMES if name in values), np.empty(0))
    sizes = [(float(values[w]), float(values[h])) for w, h in _SIZE_NAMES if values.get(w) and values.get(h)]
    made = sizes[0] if sizes else (width, height)
    if abs(made[0] * height - made[1] * width) > _SAME_SHAPE * made[1] * width:
        raise SettingsError(
            f"--camera.calibration {path}: made for pictures of {made[0]:.0f} x {made[1]:.0f} pixels, but the camera "
            f"gives {width} x {height}, another aspect ratio: set --camera.width and --camera.height"
        )
    scale = width / made[0]
    matrix[:2] *= scale
    # Pixel coordinates count from the centre of the first pixel, lengths from its edge.
    matrix[:2, 2] += 0.5 * (scale - 1.0)
    return Intrinsics(matrix, distortion.ravel())


def _values(path: Path) -> dict[str, FloatArray]:
    """Matrices and numbers of a calibration file by name."""
    cv2 = import_opencv()
    if not path.is_file():
        raise SettingsError(f"--camera.calibration {path}: there is no such file")
    matrices = (*_MATRIX_NAMES, *_DISTORTION_NAMES)
    names = (*matrices, *itertools.chain(*_SIZE_NAMES))
    text = read_settings(path) if path.suffix in (".yaml", ".yml") else ""
    is_opencv = text.startswith("%YAML:1.0") or "!!opencv-matrix" in text
    plain = {} if is_opencv or not text else parse_yaml(text, f"--camera.calibration {path}")
    if plain and isinstance(plain, dict):
        found = {name: plain[name] for name in names if name in plain}
        found = {name: value.get("data") if isinstance(value, dict) else value for name, value in found.items()}
        try:
            return {name: np.asarray(value, dtype=np.float64) for name, value in found.items() if _is_numbers(value)}
        except ValueError as error:
            raise SettingsError(f"--camera.calibration {path}: {str(error)[:200]}") from None
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        if not storage.isOpened():
            raise SettingsError(f"--camera.calibration {path}: OpenCV cannot read it; needed: .yml, .xml or .json")
        nodes = {name: node for name in names if not (node := storage.getNode(name)).empty()}
        return {name: np.asarray(node.mat() if name in matrices else node.real()) for name, node in nodes.items()}
    except (cv2.error, SystemError) as error:  # depending on the damage
        cause = error.__cause__ or error
        why = getattr(cause, "err", "") or cause
        raise SettingsError(f"--camera.calibration {path}: OpenCV cannot read it ({why})") from None


def _is_numbers(value: object) -> bool:
    return isinstance(value, int | float) or (isinstance(value, list) and bool(value))
