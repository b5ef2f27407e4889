"""Interface of the rival control laws: measurements and command.

A rival is a control law of an existing robot or camera. Its measurements are faces in a camera on the moving head, and
the encoders. Pan is positive to the left, tilt is positive up.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from gazempc.neck.kinematics import gaze_ray
from gazempc.neck.spec import Geometry, NeckSpec
from gazempc.types import FloatArray, JointState

# Height of a face detector's box: chin to hairline of an adult.
FACE_HEIGHT_M = 0.24
# Full speed of a law with normalised output, relative to the top speed of the neck, at which it saturates.
SPEED_SCALES = (0.5, 1.0, 2.0, 4.0, 8.0)


@dataclass(frozen=True)
class HeadCamera:
    """A camera on the head, aligned with the gaze.

    Attributes:
        half_width_rad: Half of the horizontal field of view, radians.
        half_height_rad: Half of the vertical field of view, radians.
        width_px: Width of the image, pixels.
        height_px: Height of the image, pixels.
        rate_hz: Detections per second.
        latency_s: From capture to the arrival of the detection, seconds.
        pixel_noise_px: Standard deviation of the detected centre, on each axis, pixels.
        face_height_m: Height of a face's box, metres.
    """

    half_width_rad: float
    half_height_rad: float
    width_px: int
    height_px: int
    rate_hz: float
    latency_s: float
    pixel_noise_px: float
    face_height_m: float = FACE_HEIGHT_M


@dataclass(frozen=True)
class Detection:
    """A face in one frame of the camera on the moving head.

    Attributes:
        capture_time_s: Capture time of the frame, seconds.
        arrival_time_s: Time from which the detection is available, seconds.
        offset: Centre of the face in normalised image coordinates, shape (2,): x positive to the right, y positive
            down, -1 to 1. Pinhole model: ``x = -tan(angle to the left) / tan(half_width_rad)``.
        range_m: Measured distance of the face, metres; for laws with a target point in space.
        box_px: Width and height of the face's box, shape (2,), pixels.
    """

    capture_time_s: float
    arrival_time_s: float
    offset: FloatArray
    range_m: float
    box_px: FloatArray


@dataclass(frozen=True)
class View:
    """Measurements of a rival at one step.

    Attributes:
        time_s: The time, seconds.
        detections: Detections since the law's last step, oldest first.
        joints: Current encoder readings.
        joints_at: Function from an earlier time to pan and tilt, shape (2,), radians, by linear interpolation of the
            encoder readings of the last 3 s; the nearest end up to 0.05 s outside them, otherwise None.
        idle: Whether the device is at rest without a pending move.
    """

    time_s: float
    detections: tuple[Detection, ...]
    joints: JointState
    joints_at: Callable[[float], FloatArray | None]
    idle: bool


class Rival(ABC):
    """A control law, constructed from models of the neck and of the camera on the head.

    Args:
        neck: Model of the neck.
        camera: Model of the camera.

    Attributes:
        name: Name in tables.
        period_s: Sampling period, seconds.
        command: Type of the output: joint angles in radians, or joint velocities in rad/s.
        free: Tunable constants, one mapping for each candidate.
    """

    name: ClassVar[str]
    command: ClassVar[Literal["position", "velocity"]] = "position"
    free: ClassVar[tuple[dict[str, float], ...]] = ({},)
    period_s: float = 0.02

    def __init__(self, neck: NeckSpec, camera: HeadCamera) -> None:
        self._neck, self._camera = neck, camera

    @abstractmethod
    def start(self, view: View) -> None:
        """Reset the state.

        Args:
            view: Initial measurements, without detections.
        """

    @abstractmethod
    def step(self, view: View) -> FloatArray:
        """One period of the law.

        Args:
            view: Measurements.

        Returns:
            Pan and tilt, shape (2,): absolute angles in radians, or velocities in rad/s, see `command`.
        """

    def _within_range(self, angles_rad: FloatArray) -> FloatArray:
        return np.clip(angles_rad, self._neck.position_min_rad, self._neck.position_max_rad)


# Tolerance for rounded time stamps: frames at 0.1 s intervals are 10 Hz.
_SAME_TIME_S = 1e-3


class FrameRate:
    """Limiter of the frame rate.

    Args:
        period_s: Least time between two accepted frames, seconds.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s, self._last_s = period_s, -math.inf

    def take(self, detections: tuple[Detection, ...]) -> Iterator[Detection]:
        """Detections of the accepted frames, oldest first."""
        for detection in detections:
            if detection.capture_time_s > self._last_s + self._period_s - _SAME_TIME_S:
                self._last_s = detection.capture_time_s
                yield detection


def half_sizes(camera: HeadCamera) -> FloatArray:
    """Tangents of half of the field of view: half width and height of the image at distance 1, shape (2,)."""
    return np.tan([camera.half_width_rad, camera.half_height_rad])


def ray(camera: HeadCamera, offset: FloatArray) -> FloatArray:
    """Viewing ray of an image point, in the camera's frame.

    Args:
        camera: Pinhole camera.
        offset: Normalised image coordinates, shape (2,): to the right, down.

    Returns:
        Direction with x forward (1), y left, z up, shape (3,); not normalised.
    """
    right, down = np.asarray(offset) * half_sizes(camera)
    return np.array([1.0, -right, -down])


def left_and_up_rad(camera: HeadCamera, offset: FloatArray) -> FloatArray:
    """Horizontal and vertical angle of an image point from the camera's axis: left, up, shape (2,), radians."""
    return -np.arctan(np.asarray(offset) * half_sizes(camera))


def bearing_rad(camera: HeadCamera, offset: FloatArray, head_rad: FloatArray) -> FloatArray:
    """Absolute pan and tilt of the ray of an image point.

    Axes and eye are assumed to coincide, as in all laws that use directions.

    Args:
        camera: Pinhole camera on the head.
        offset: Normalised image coordinates, shape (2,): to the right, down.
        head_rad: Pan and tilt that the law assumes for the frame, shape (2,), radians.

    Returns:
        Pan and tilt, shape (2,), radians; pan within pi of the head's.
    """
    forward, left, up = ray(camera, offset)
    pan_rad, tilt_rad = head_rad
    cosine, sine = np.cos(tilt_rad), np.sin(tilt_rad)
    ahead, above = cosine * forward - sine * up, sine * forward + cosine * up
    return np.array([pan_rad + np.arctan2(left, ahead), np.arctan2(above, np.hypot(ahead, left))])


def point_base_m(geometry: Geometry, camera: HeadCamera, detection: Detection, head_rad: FloatArray) -> FloatArray:
    """The face as a point in the base frame.

    Args:
        geometry: Geometry of the neck, with the position of its eye.
        camera: Pinhole camera at the eye.
        detection: The face and its measured distance.
        head_rad: Pan and tilt that the law assumes for the frame, shape (2,), radians.

    Returns:
        Position, shape (3,), metres.
    """
    eye_m, _ = gaze_ray(geometry, head_rad)
    pan_rad, tilt_rad = bearing_rad(camera, detection.offset, head_rad)
    level = np.cos(tilt_rad)
    direction = np.array([level * np.cos(pan_rad), level * np.sin(pan_rad), np.sin(tilt_rad)])
    return eye_m + detection.range_m * direction
