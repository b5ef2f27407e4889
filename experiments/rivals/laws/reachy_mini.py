"""Reachy Mini: its daemon (reachy_mini 1.10, August 2026), the same with times of capture (#1396), and an app.

A detected face becomes a direction in space, and the head's orientation eases towards it 50 times a second. The daemon
turns the face's place in the image by the head's pose when the frame was *processed*. A head that moved meanwhile adds
its own motion to the target. With #1396 the pose is that of the frame's *capture*.

The conversation app as it was early in 2026 (0.2.2) goes 0.6 of the way to the face, at once: the daemon's look-at pose
of the newest frame, with the head's pose when it was processed, is scaled by 0.6 and becomes the head's offset from its
neutral pose. Nothing is filtered or limited. Today the app uses the daemon's own law.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.rivals.rival import Detection, FrameRate, HeadCamera, Rival, View, bearing_rad, ray
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

_FORWARD = np.array([1.0, 0.0, 0.0])


class ReachyMini(Rival):
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
        """See `Rival.start`."""
        self._detector.reset()
        self._association.reset()
        self._filter.reset()
        self._seen_s = -math.inf
        self._command_rad = view.joints.position_rad
        self._aim = self._target = _orientation(view.joints.position_rad)

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`; what is computed now is sent at the next step."""
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


class ReachyMiniCaptureRaw(ReachyMini):
    """The same with the head's pose when the frame was captured, and without the filter in the image.

    A frame of an unknown pose is dropped.

    Args:
        neck: The neck; the law uses none of its limits, and no offset of the camera.
        camera: The camera on the head.
        constants: As of `ReachyMini`.
    """

    name = "reachy_mini_capture_raw"

    def __init__(self, neck: NeckSpec, camera: HeadCamera, **constants: float) -> None:
        super().__init__(neck, camera, filtered=False, **constants)

    def _head_rad(self, view: View, detection: Detection) -> FloatArray | None:
        return view.joints_at(detection.capture_time_s)


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


# Constants of reachy_mini, `vision/face_tracking.py`; lengths in halves of the image.
_LONGEST_JUMP = 0.5
_MISSES = 20
_STILL = 0.02
_FAST_CHANGE = 0.15
_FAST_GAIN = 0.6
_SLOW_GAIN = 0.3


class Association:
    """Takes faces that are large enough, and near the last one.

    Args:
        camera: Whose images.
        detection_period_s: Time between two images that the detector looks at, seconds.
        least_share: Of the image's area; smaller faces are ignored.
    """

    def __init__(self, camera: HeadCamera, detection_period_s: float, least_share: float) -> None:
        self._least_px2 = least_share * camera.width_px * camera.height_px
        self._patience_s = _MISSES * detection_period_s
        self.reset()

    def reset(self) -> None:
        """Forget the last face."""
        self._offset: FloatArray | None = None
        self._seen_s = -math.inf

    def takes(self, detection: Detection) -> bool:
        """Whether this is the person; the daemon counts misses, here their time."""
        if detection.box_px.prod() < self._least_px2:
            return False
        if detection.capture_time_s - self._seen_s > self._patience_s:
            self.reset()
        if self._offset is not None and np.linalg.norm(detection.offset - self._offset) > _LONGEST_JUMP:
            return False
        self._offset, self._seen_s = detection.offset, detection.capture_time_s
        return True


class ImageFilter:
    """Keeps the face's place where it hardly changes, and follows it faster where it changes fast."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Take the next place as it is."""
        self._filtered: FloatArray | None = None
        self._raw: FloatArray | None = None

    def update(self, raw: FloatArray) -> FloatArray:
        """The filtered place, shape (2,), in halves of the image."""
        if self._filtered is None or self._raw is None:
            self._filtered = raw
        elif np.linalg.norm(raw - self._filtered) >= _STILL:
            fast = np.linalg.norm(raw - self._raw) > _FAST_CHANGE
            self._filtered = self._filtered + (_FAST_GAIN if fast else _SLOW_GAIN) * (raw - self._filtered)
        self._raw = raw
        return self._filtered


class ConversationApp(Rival):
    """Commands a share of the face's angles.

    Args:
        neck: The neck; the law uses none of its limits, and no offset of the camera.
        camera: The camera on the head.
        gain: Share of the angles that is commanded.
        detection_period_s: Time between two images that the detector looks at, seconds.
        loss_s: How long the offset is held after the last face, seconds.
        return_s: In which time it then goes to neutral, seconds.
    """

    name = "conversation_app"
    period_s = 0.01

    def __init__(
        self,
        neck: NeckSpec,
        camera: HeadCamera,
        *,
        gain: float = 0.6,
        detection_period_s: float = 0.04,
        loss_s: float = 2.0,
        return_s: float = 1.0,
    ) -> None:
        self._camera = camera
        self._gain, self._loss_s, self._return_s = gain, loss_s, return_s
        self._detector = FrameRate(detection_period_s)

    def start(self, view: View) -> None:
        """See `Rival.start`."""
        self._detector.reset()
        self._seen_s = math.inf
        self._offset_rad = view.joints.position_rad

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`."""
        for detection in self._detector.take(view.detections):
            self._offset_rad = self._gain * bearing_rad(self._camera, detection.offset, view.joints.position_rad)
            self._seen_s = view.time_s
        returned = (view.time_s - self._seen_s - self._loss_s) / self._return_s
        return self._offset_rad * (1.0 - min(max(returned, 0.0), 1.0))
