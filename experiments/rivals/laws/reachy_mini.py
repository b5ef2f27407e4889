"""Reachy Mini's daemon (reachy_mini 1.10, `main` of August 2026), and the same law with times of capture (#1396).

A detected face becomes a direction in space, and the head's orientation eases towards it 50 times a second. The daemon
turns the face's place in the image by the head's pose when the frame was *processed*. A head that moved meanwhile adds
its own motion to the target. With #1396 the pose is that of the frame's *capture*.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.rivals.laws.faces import Association, ImageFilter
from experiments.rivals.laws.frames import FrameRate
from experiments.rivals.laws.sight import ray
from experiments.rivals.rival import Detection, HeadCamera, View
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

_FORWARD = np.array([1.0, 0.0, 0.0])


class ReachyMini:
    """Eases the head towards the face's direction, by the head's pose when the frame was processed.

    Args:
        neck: The neck; the law uses none of its limits, and no offset of the camera.
        camera: The camera on the head.
        detection_period_s: Time between two images that the detector looks at, seconds.
        least_share: Area of the smallest face that counts, as a share of the image's.
        ease: Share of the way to the target at each step.
        loss_s: How long the target is held after the last face, seconds; then it is straight ahead.
        filtered: Whether the face's place in the image is filtered.
    """

    name = "reachy_mini"
    command: Literal["position"] = "position"
    period_s = 0.02

    def __init__(
        self,
        neck: NeckSpec,
        camera: HeadCamera,
        *,
        detection_period_s: float = 0.1,
        least_share: float = 0.003,
        ease: float = 0.15,
        loss_s: float = 2.0,
        filtered: bool = True,
    ) -> None:
        self._camera = camera
        self._ease, self._loss_s = ease, loss_s
        self._filtered = filtered
        self._detector = FrameRate(detection_period_s)
        self._association = Association(camera, detection_period_s, least_share)
        self._filter = ImageFilter()

    def start(self, view: View) -> None:
        """See `experiments.rivals.rival.Rival.start`."""
        self._detector.reset()
        self._association.reset()
        self._filter.reset()
        self._seen_s = -math.inf
        self._command_rad = view.joints.position_rad
        self._aim = self._target = _orientation(view.joints.position_rad)

    def step(self, view: View) -> FloatArray:
        """See `experiments.rivals.rival.Rival.step`; what is computed now is sent at the next step."""
        for detection in self._detector.take(view.detections):
            head_rad = self._head_rad(view, detection)
            if head_rad is None or not self._association.takes(detection):
                continue
            offset = self._filter.update(detection.offset) if self._filtered else detection.offset
            self._target = _look_along(_orientation(head_rad).apply(ray(self._camera, offset)))
            self._seen_s = view.time_s
        if view.time_s - self._seen_s >= self._loss_s and self._seen_s > -math.inf:
            self._filter.reset()
            self._target = Rotation.identity()
        sent_rad = self._command_rad
        left = self._aim.inv() * self._target
        self._aim = self._aim * Rotation.from_rotvec(self._ease * left.as_rotvec())
        forward, to_left, up = self._aim.apply(_FORWARD)
        self._command_rad = np.array([np.arctan2(to_left, forward), np.arctan2(up, np.hypot(forward, to_left))])
        return sent_rad

    def _head_rad(self, view: View, detection: Detection) -> FloatArray | None:
        """Pan and tilt by which the detection is turned into space; None if it is not to be used."""
        return view.joints.position_rad


class ReachyMiniCapture(ReachyMini):
    """The same law with the head's pose when the frame was captured; a frame of an unknown pose is dropped."""

    name = "reachy_mini_capture"

    def _head_rad(self, view: View, detection: Detection) -> FloatArray | None:
        return view.joints_at(detection.capture_time_s)


class ReachyMiniCaptureRaw(ReachyMiniCapture):
    """The same without the filter in the image, as #1396 may be read.

    Args:
        neck: The neck; the law uses none of its limits, and no offset of the camera.
        camera: The camera on the head.
        constants: As of `ReachyMini`.
    """

    name = "reachy_mini_capture_raw"

    def __init__(self, neck: NeckSpec, camera: HeadCamera, **constants: float) -> None:
        super().__init__(neck, camera, filtered=False, **constants)


def _orientation(head_rad: FloatArray) -> Rotation:
    pan_rad, tilt_rad = head_rad
    # Tilting up turns about the axis that points to the right.
    return Rotation.from_euler("ZY", [pan_rad, -tilt_rad])


def _look_along(direction: FloatArray) -> Rotation:
    """The shortest turn from straight ahead to a direction."""
    forward, left, up = direction
    across = math.hypot(left, up)
    if across == 0.0:
        return Rotation.identity()
    angle_rad = math.atan2(across, forward)
    return Rotation.from_rotvec(angle_rad / across * np.array([0.0, -up, left]))
