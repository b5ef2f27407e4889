"""Errors of the camera source on rendered people at known positions."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.live.sources.camera.blazeface import BlazeFace, import_opencv
from gazempc.live.sources.camera.finder import FaceFinder
from gazempc.live.sources.camera.intrinsics import from_field_of_view
from gazempc.robots.studio import Studio, StudioPerson
from gazempc.types import FloatArray
from predictors import HeadObservation

FRAME_S = 1 / 15
# Association gate: largest angle between an observation and the person.
_ASSOCIATION_DEG = 5.0
# Amplitude of the periodic head yaw relative to the direction of the camera.
_YAW_DEG = 30.0
_YAW_PERIOD_S = 3.1


@dataclass(frozen=True)
class Seen:
    """Detection errors on a walk.

    Attributes:
        frames: Number of images.
        bearing_deg: Angle between measured and true direction of the eyes, shape (n,), for the n images with a
            detection of the person.
        range_error: Relative error of the range, shape (n,).
        yaw_error_deg: Error of the head's yaw, shape (m,), for the images with a yaw.
        nees: Normalised estimation error squared of the position, shape (n,); mean 3 for a consistent covariance.
        others: Number of false observations.
        names: Number of track identities of the person.
        cpu_ms: Processor time per image, shape (frames,).
    """

    frames: int
    bearing_deg: FloatArray
    range_error: FloatArray
    yaw_error_deg: FloatArray
    nees: FloatArray
    others: int
    names: int
    cpu_ms: FloatArray

    @property
    def found(self) -> float:
        """Detection rate: share of the images with a detection of the person."""
        return self.bearing_deg.size / self.frames


def watch(
    studio: Studio,
    person_at: Callable[[float], StudioPerson | None],
    frames: int,
    spoilt: Callable[[Any], Any] = lambda picture: picture,
) -> Seen:
    """Observe a walk with a camera at the origin that points along +x.

    Args:
        studio: Renderer.
        person_at: Function from a time in seconds to the person, or None.
        frames: Number of images.
        spoilt: Degradation of an image.

    Returns:
        Detection errors.
    """
    finder, intrinsics = FaceFinder(BlazeFace()), from_field_of_view(studio.fov_deg, studio.width, studio.height)
    bearings, ranges, yaws, nees, cpu_ms, names = [], [], [], [], [], set()
    others = 0
    for k in range(frames):
        person = person_at(k * FRAME_S)
        picture = spoilt(studio.picture(person, np.zeros(3), Rotation.identity()))
        started_s = time.process_time()
        found = finder.heads(picture, k * FRAME_S, intrinsics)
        cpu_ms.append(1e3 * (time.process_time() - started_s))
        of_person = [each for each in found if _off_deg(each, person) <= _ASSOCIATION_DEG]
        others += len(found) - len(of_person[:1])
        if person is None or not of_person:
            continue
        observation = of_person[0]
        position_m = observation.head_position_base_m
        names.add(observation.person_id)
        bearings.append(_off_deg(observation, person))
        true_m = float(np.linalg.norm(person.eyes_m))
        ranges.append(float(np.linalg.norm(position_m)) / true_m - 1.0)
        error_m = position_m - person.eyes_m
        nees.append(float(error_m @ np.linalg.solve(np.asarray(observation.position_covariance_m2), error_m)))
        if observation.head_quat_wxyz is not None:
            front = Rotation.from_quat(observation.head_quat_wxyz, scalar_first=True).apply([1.0, 0.0, 0.0])
            wrong_rad = math.atan2(front[1], front[0]) - person.yaw_rad
            yaws.append(math.degrees(math.remainder(wrong_rad, math.tau)))
    seen = np.array(bearings), np.array(ranges), np.array(yaws), np.array(nees)
    return Seen(frames, *seen, others, len(names), np.array(cpu_ms))


def _off_deg(observation: HeadObservation, person: StudioPerson | None) -> float:
    return math.inf if person is None else angle_deg(observation.head_position_base_m, person.eyes_m)


def across(range_m: float, seconds: float = 4.0, yaw_deg: float = _YAW_DEG) -> Callable[[float], StudioPerson]:
    """A person who walks across the field of view at a constant distance, with periodic head yaw.

    Args:
        range_m: The distance, metres.
        seconds: Duration.
        yaw_deg: Amplitude of the yaw relative to the direction of the camera, degrees.

    Returns:
        Function from a time in seconds to the person.
    """

    def at(time_s: float) -> StudioPerson:
        azimuth_rad = math.radians(22.0) * (1 - 2 * time_s / seconds)
        up_m = 0.15 + 0.02 * math.sin(4 * math.pi * time_s)  # bobs with the steps
        eyes_m = np.array([range_m * math.cos(azimuth_rad), range_m * math.sin(azimuth_rad), up_m])
        away_rad = math.radians(yaw_deg) * math.sin(math.tau * time_s / _YAW_PERIOD_S)
        return StudioPerson(eyes_m, math.pi + azimuth_rad + away_rad)

    return at


def webcam(picture: Any) -> Any:
    """Degrade an image like a cheap webcam in a dim room: dark, noisy, blurred along the rows, JPEG compressed."""
    cv2 = import_opencv()
    rng = np.random.default_rng(int(picture.sum()) % 2**32)
    moved = cv2.blur(picture, (5, 1)).astype(np.float32)
    noisy = np.clip(0.5 * moved + rng.normal(0.0, 8.0, moved.shape), 0, 255).astype(np.uint8)
    fine, jpeg = cv2.imencode(".jpg", noisy, [cv2.IMWRITE_JPEG_QUALITY, 70])
    assert fine
    return cv2.imdecode(jpeg, cv2.IMREAD_COLOR)


def angle_deg(one: FloatArray, other: FloatArray) -> float:
    """Angle between two directions, degrees."""
    return math.degrees(math.atan2(float(np.linalg.norm(np.cross(one, other))), float(np.dot(one, other))))
