"""Test doubles of the camera source: rendered people, a face detector, and failing streams."""

import functools
import os
import time

import cv2
import numpy as np
import pytest

from gazempc.live.sources.camera.blazeface import Face
from gazempc.robots.studio import Studio


@functools.cache
def studio():
    """The rendered room, one per process. Outside CI, tests skip where rendering is unavailable."""
    try:
        return Studio()
    except RuntimeError as error:
        if os.environ.get("CI"):
            pytest.fail(f"{error}; CI must not skip this")
        pytest.skip(str(error))


# Key points of a face of width 1 around the middle of its box: eyes, nose, mouth, ears.
POINTS = np.array([[-0.19, -0.2], [0.19, -0.2], [0, 0.02], [0, 0.22], [-0.42, -0.07], [0.42, -0.07]])


class Faces:
    """Detector of the faces in `here` (centre and width, pixels) that are at least 1/16 of the square wide."""

    def __init__(self):
        self.here = []
        self.score = self.mirrored_score = 0.8

    def faces(self, picture, corner_px, side_px, score_min, mirrored=False):
        found = []
        for x, y, width in self.here:
            inside = all(
                low + width / 4 <= at <= low + side_px - width / 4 for at, low in zip((x, y), corner_px, strict=True)
            )
            score = self.mirrored_score if mirrored else self.score
            if inside and side_px / 16 <= width <= side_px / 1.5 and score_min <= score:
                found.append(Face(np.array([x, y, width, width]), np.array([x, y]) + width * POINTS, score))
        return found


PICTURE = np.zeros((48, 64, 3), np.uint8)


class Falling:
    """Stands in for OpenCV's capture of an RTSP stream: real pictures, and stamps that fall behind after a while."""

    def __init__(self) -> None:
        self.opened, self._count, self._begin_s = 0, 0, 0.0

    def __call__(self, address: str, *_: object) -> "Falling":
        self.address = address
        self.opened += 1
        self._count, self._begin_s = 0, time.monotonic()
        return self

    def isOpened(self) -> bool:  # noqa: N802
        return True

    def grab(self) -> bool:
        time.sleep(0.02)
        self._count += 1
        return True

    def retrieve(self) -> tuple[bool, np.ndarray]:
        return True, PICTURE + self._count % 7

    def getBackendName(self) -> str:  # noqa: N802
        return "FFMPEG"

    def get(self, _: int) -> float:
        # From the tenth picture on the stream runs at half its frame rate.
        passed_s = time.monotonic() - self._begin_s
        return 1e3 * (passed_s if self._count < 10 else 0.5 * passed_s)

    def release(self) -> None:
        pass


class Frozen(Falling):
    """The tenth picture is repeated for ever."""

    def retrieve(self) -> tuple[bool, np.ndarray]:
        return True, PICTURE + min(self._count, 10) % 7


class Silent(Falling):
    """No picture for some seconds after the tenth."""

    def grab(self) -> bool:
        time.sleep(2.2 if self._count == 10 else 0.0)
        return super().grab()


# Right eye, left eye, nose, mouth, right ear, left ear: x to the front, y to the person's left, z up.
LEFT_M, EAR_M, RIGHT = np.array([0, 0.0315, 0]), np.array([-0.085, 0.070, -0.022]), np.array([1, -1, 1])
FACE_M = np.array([LEFT_M * RIGHT, LEFT_M, [0.022, 0, -0.036], [0.004, 0, -0.070], EAR_M * RIGHT, EAR_M])


def points_of(eyes_m, yaw_deg, roll_deg=0.0, scale=1.0):
    """Tangents of the directions to a head's key points; yaw relative to the direction of the origin."""
    yaw = np.deg2rad(180 + yaw_deg) + np.arctan2(eyes_m[1], eyes_m[0])
    c, s = np.cos(yaw), np.sin(yaw)
    r = np.deg2rad(roll_deg)
    rolled = scale * FACE_M @ np.array([[1, 0, 0], [0, np.cos(r), np.sin(r)], [0, -np.sin(r), np.cos(r)]])
    points = rolled @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + eyes_m
    return points[:, 1:] / points[:, :1]


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
