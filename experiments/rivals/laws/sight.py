"""From the place of a face in the image to directions and points, as the laws compute them."""

from __future__ import annotations

import numpy as np

from experiments.rivals.rival import Detection, HeadCamera
from gazempc.neck.kinematics import gaze_ray
from gazempc.neck.spec import Geometry
from gazempc.types import FloatArray


def half_sizes(camera: HeadCamera) -> FloatArray:
    """Tangents of half the field of view: half the image's width and height at distance 1, shape (2,)."""
    return np.tan([camera.half_width_rad, camera.half_height_rad])


def ray(camera: HeadCamera, offset: FloatArray) -> FloatArray:
    """Where a point of the image is, in the camera's frame.

    Args:
        camera: A pinhole.
        offset: Place in halves of the image, shape (2,): to the right, down.

    Returns:
        x forward (1), y left, z up, shape (3,); not of unit length.
    """
    right, down = np.asarray(offset) * half_sizes(camera)
    return np.array([1.0, -right, -down])


def left_and_up_rad(camera: HeadCamera, offset: FloatArray) -> FloatArray:
    """Angles of a point of the image from the camera's axis, each by itself: left, up, shape (2,), radians."""
    return -np.arctan(np.asarray(offset) * half_sizes(camera))


def bearing_rad(camera: HeadCamera, offset: FloatArray, head_rad: FloatArray) -> FloatArray:
    """Absolute pan and tilt that look along the ray of a point of the image.

    Axes and eye count as one point, as in all laws that work with directions.

    Args:
        camera: A pinhole on the head.
        offset: Place in halves of the image, shape (2,): to the right, down.
        head_rad: Pan and tilt that the law takes for those of the frame, shape (2,), radians.

    Returns:
        Pan and tilt, shape (2,), radians; pan within half a turn of the head's.
    """
    forward, left, up = ray(camera, offset)
    pan_rad, tilt_rad = head_rad
    cosine, sine = np.cos(tilt_rad), np.sin(tilt_rad)
    ahead, above = cosine * forward - sine * up, sine * forward + cosine * up
    return np.array([pan_rad + np.arctan2(left, ahead), np.arctan2(above, np.hypot(ahead, left))])


def point_base_m(geometry: Geometry, camera: HeadCamera, detection: Detection, head_rad: FloatArray) -> FloatArray:
    """The face as a point in the base frame.

    Args:
        geometry: Of the neck: where its eye is.
        camera: A pinhole at the eye.
        detection: The face and its measured distance.
        head_rad: Pan and tilt that the law takes for those of the frame, shape (2,), radians.

    Returns:
        Position, shape (3,), metres.
    """
    eye_m, _ = gaze_ray(geometry, head_rad)
    pan_rad, tilt_rad = bearing_rad(camera, detection.offset, head_rad)
    level = np.cos(tilt_rad)
    direction = np.array([level * np.cos(pan_rad), level * np.sin(pan_rad), np.sin(tilt_rad)])
    return eye_m + detection.range_m * direction
