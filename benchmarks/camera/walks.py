"""What the camera source makes of rendered people at known places."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.live.sources.camera.blazeface import BlazeFace, import_opencv
from gazempc.live.sources.camera.finder import FaceSensor
from gazempc.live.sources.camera.intrinsics import from_field_of_view
from gazempc.robots.studio import Studio, StudioPerson
from gazempc.types import FloatArray
from predictors import HeadObservation

FRAME_S = 1 / 15
# What is found within this of the person is the person.
_THEIRS_DEG = 5.0
# The person turns the head to and fro by so much, against the direction to the camera.
_YAW_DEG = 30.0
_YAW_PERIOD_S = 3.1


@dataclass(frozen=True)
class Seen:
    """What was seen of a walk.

    Attributes:
        frames: Number of pictures.
        bearing_deg: Angle between measured and true direction of the eyes, shape (n,), of the n pictures in which the
            person was found.
        range_error: Error of the range as a share of it, shape (n,).
        yaw_error_deg: Error of the head's yaw, shape (m,), of the pictures that gave one.
        nees: Squared error of the position by its stated covariance, shape (n,); 3 in the mean for an exact one.
        others: Observations that were not of the person.
        names: Number of names that the person was given.
        cpu_ms: Processor time a picture, shape (frames,).
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
        """Share of the pictures in which the person was found."""
        return self.bearing_deg.size / self.frames


def watch(
    studio: Studio,
    person_at: Callable[[float], StudioPerson | None],
    frames: int,
    spoilt: Callable[[Any], Any] = lambda picture: picture,
) -> Seen:
    """Watch a walk through a camera that stands in the origin and looks along +x.

    Args:
        studio: Renders it.
        person_at: The person at a time in seconds; None if there is none.
        frames: Number of pictures.
        spoilt: Makes of a picture what a worse camera would have given.

    Returns:
        What was seen.
    """
    sensor = FaceSensor(BlazeFace(), from_field_of_view(studio.fov_deg, studio.width, studio.height))
    bearings, ranges, yaws, nees, cpu_ms, names = [], [], [], [], [], set()
    others = 0
    for k in range(frames):
        person = person_at(k * FRAME_S)
        picture = spoilt(studio.picture(person, np.zeros(3), Rotation.identity()))
        started_s = time.process_time()
        found = sensor.see(picture, k * FRAME_S)
        cpu_ms.append(1e3 * (time.process_time() - started_s))
        theirs = [each for each in found if _off_deg(each, person) <= _THEIRS_DEG]
        others += len(found) - len(theirs[:1])
        if person is None or not theirs:
            continue
        observation = theirs[0]
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
    """A person who walks across the view at one distance, and turns the head.

    Args:
        range_m: The distance, metres.
        seconds: How long it takes.
        yaw_deg: How far the head turns from the direction to the camera, degrees.

    Returns:
        The person by time in seconds.
    """

    def at(time_s: float) -> StudioPerson:
        azimuth_rad = math.radians(22.0) * (1 - 2 * time_s / seconds)
        up_m = 0.15 + 0.02 * math.sin(4 * math.pi * time_s)  # bobs with the steps
        eyes_m = np.array([range_m * math.cos(azimuth_rad), range_m * math.sin(azimuth_rad), up_m])
        away_rad = math.radians(yaw_deg) * math.sin(math.tau * time_s / _YAW_PERIOD_S)
        return StudioPerson(eyes_m, math.pi + azimuth_rad + away_rad)

    return at


def webcam(picture: Any) -> Any:
    """What a cheap webcam in a dim room makes of a picture: dark, noisy, blurred along the rows, packed as JPEG."""
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
