"""The interface of all control laws of rivals: measurements and command.

A rival is a control law as a robot or a camera runs it. It gets faces in a camera on the moving head, and the encoders.
Pan is positive to the left, tilt is positive up, as everywhere.
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

# Between the chin and the hairline of an adult; what face detectors draw their boxes round.
FACE_HEIGHT_M = 0.24
# "Full speed" of a law that answers -1 to 1, over the top speed of the neck; faster is cut to that.
SPEED_SCALES = (0.5, 1.0, 2.0, 4.0, 8.0)


@dataclass(frozen=True)
class HeadCamera:
    """A camera on the head, that looks along the gaze.

    Attributes:
        half_width_rad: Half its horizontal field of view, radians.
        half_height_rad: Half its vertical field of view, radians.
        width_px: Width of its image, pixels.
        height_px: Height of its image, pixels.
        rate_hz: Detections a second.
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
        capture_time_s: When the frame was captured, seconds.
        arrival_time_s: When the detection can first be used, seconds.
        offset: Centre of the face from the image's centre in halves of the image, shape (2,): x positive to the right,
            y positive down, -1 to 1. A pinhole: ``x = -tan(angle to the left) / tan(half_width_rad)``.
        range_m: Distance of the face as it was measured, metres; for laws that use a point in space.
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
        detections: What arrived since the law's last step, oldest first.
        joints: The encoders now.
        joints_at: Pan and tilt at an earlier time, shape (2,), radians: linear between the encoders' readings of the
            last 3 s. The nearest end where that is at most 0.05 s away, otherwise None.
        idle: Whether the device is at rest without a pending move.
    """

    time_s: float
    detections: tuple[Detection, ...]
    joints: JointState
    joints_at: Callable[[float], FloatArray | None]
    idle: bool


class Rival(ABC):
    """A control law for its models of a neck and of the camera on the head.

    Args:
        neck: Model of the neck.
        camera: Model of the camera.

    Attributes:
        name: Its name in tables.
        period_s: Time between two steps, seconds.
        command: What it answers: joint angles in radians, or joint velocities in rad/s.
        free: Constants that the law leaves to its user, one mapping for each choice that is tried.
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
            view: Measurements at the start, without detections.
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


# Frames a tenth of a second apart are ten a second, with stamps that are rounded.
_SAME_TIME_S = 1e-3


class FrameRate:
    """Takes a frame only if the one before is long enough ago.

    Args:
        period_s: Least time between two frames that it looks at, seconds.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s, self._last_s = period_s, -math.inf

    def take(self, detections: tuple[Detection, ...]) -> Iterator[Detection]:
        """The detections of the frames that it looks at, oldest first."""
        for detection in detections:
            if detection.capture_time_s > self._last_s + self._period_s - _SAME_TIME_S:
                self._last_s = detection.capture_time_s
                yield detection


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
