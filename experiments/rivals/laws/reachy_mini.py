"""Reachy Mini: its daemon (reachy_mini 1.10, August 2026), the same with times of capture (#1396), and an app.

A detected face becomes a direction in space, and the head's orientation follows it with a first-order lag at 50 Hz. The
daemon rotates the image direction by the head's pose at *processing*, so the head's motion since the capture is added
to the target. #1396 uses the pose at *capture*. The daemon also ignores faces below 0.3 % of the image; here all laws
get the same detections.

The conversation app of early 2026 (0.2.2) scales the look-at pose of the newest frame, by the head's pose at
processing, by 0.6, and commands it without filter or limit. Today the app uses the daemon's law.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.rivals.rival import Detection, FrameRate, HeadCamera, Rival, View, bearing_rad, ray
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

_FORWARD = np.array([1.0, 0.0, 0.0])
# Constants of reachy_mini, `vision/face_tracking.py`; normalised image coordinates.
_DETECTION_PERIOD_S = 0.1
_EASE = 0.15  # gain of the first-order lag at each step
_LOSS_S = 2.0
_LONGEST_JUMP, _MISSES = 0.5, 20
_STILL, _FAST_CHANGE, _FAST_GAIN, _SLOW_GAIN = 0.02, 0.15, 0.6, 0.3


class ReachyMini(Rival):
    """First-order lag towards the face's direction, with the head's pose at processing.

    Args:
        neck: Model of the neck, without use of its limits.
        camera: Model of the camera, without use of its offset.
        filtered: Whether the image coordinates of the face are filtered.
    """

    name = "reachy_mini"

    def __init__(self, neck: NeckSpec, camera: HeadCamera, *, filtered: bool = True) -> None:
        super().__init__(neck, camera)
        self._filtered = filtered

    def start(self, view: View) -> None:
        """See `Rival.start`."""
        self._detector, self._gate, self._filter = FrameRate(_DETECTION_PERIOD_S), Gate(), ImageFilter()
        self._seen_s = -math.inf
        self._command_rad = view.joints.position_rad
        self._aim = self._target = _orientation(view.joints.position_rad)

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`; commands are delayed by one step."""
        for detection in self._detector.take(view.detections):
            head_rad = self._head_rad(view, detection)
            if head_rad is None or not self._gate.takes(detection):
                continue
            offset = self._filter.update(detection.offset) if self._filtered else detection.offset
            self._target = _look_along(_orientation(head_rad).apply(ray(self._camera, offset)))
            self._seen_s = view.time_s
        if view.time_s - self._seen_s >= _LOSS_S and self._seen_s > -math.inf:
            self._filter = ImageFilter()
            self._target = Rotation.identity()
        sent_rad = self._command_rad
        left = self._aim.inv() * self._target
        self._aim = self._aim * Rotation.from_rotvec(_EASE * left.as_rotvec())
        forward, to_left, up = self._aim.apply(_FORWARD)
        self._command_rad = np.array([np.arctan2(to_left, forward), np.arctan2(up, np.hypot(forward, to_left))])
        return sent_rad

    def _head_rad(self, view: View, detection: Detection) -> FloatArray | None:
        """Pan and tilt for the transformation of a detection to the base frame; None rejects it."""
        return view.joints.position_rad


class ReachyMiniCaptureRaw(ReachyMini):
    """Variant with the head's pose at capture, and without the image filter; arguments as of `Rival`.

    Frames without a known pose are rejected.
    """

    name = "reachy_mini_capture_raw"

    def __init__(self, neck: NeckSpec, camera: HeadCamera) -> None:
        super().__init__(neck, camera, filtered=False)

    def _head_rad(self, view: View, detection: Detection) -> FloatArray | None:
        return view.joints_at(detection.capture_time_s)


def _orientation(head_rad: FloatArray) -> Rotation:
    pan_rad, tilt_rad = head_rad
    # Positive tilt is a rotation about the axis to the right.
    return Rotation.from_euler("ZY", [pan_rad, -tilt_rad])


def _look_along(direction: FloatArray) -> Rotation:
    """Minimal rotation from straight ahead to a direction."""
    forward, left, up = direction
    across = math.hypot(left, up)
    if across == 0.0:
        return Rotation.identity()
    angle_rad = math.atan2(across, forward)
    return Rotation.from_rotvec(angle_rad / across * np.array([0.0, -up, left]))


class Gate:
    """Gate around the last face; open after 20 missed detections, here after their duration."""

    def __init__(self) -> None:
        self._offset, self._seen_s = np.zeros(2), -math.inf

    def takes(self, detection: Detection) -> bool:
        """Whether a detection is associated with the tracked face."""
        recent = detection.capture_time_s - self._seen_s <= _MISSES * _DETECTION_PERIOD_S
        if recent and np.linalg.norm(detection.offset - self._offset) > _LONGEST_JUMP:
            return False
        self._offset, self._seen_s = detection.offset, detection.capture_time_s
        return True


class ImageFilter:
    """Low-pass filter with a dead zone and a higher gain for fast changes."""

    def __init__(self) -> None:
        self._filtered: FloatArray | None = None
        self._raw: FloatArray | None = None

    def update(self, raw: FloatArray) -> FloatArray:
        """Filtered normalised image coordinates, shape (2,)."""
        if self._filtered is None or self._raw is None:
            self._filtered = raw
        elif np.linalg.norm(raw - self._filtered) >= _STILL:
            fast = np.linalg.norm(raw - self._raw) > _FAST_CHANGE
            self._filtered = self._filtered + (_FAST_GAIN if fast else _SLOW_GAIN) * (raw - self._filtered)
        self._raw = raw
        return self._filtered


# Constants of the app: gain, period of the detector, hold and return times after the last face.
_APP_GAIN, _APP_DETECTION_PERIOD_S, _HOLD_S, _RETURN_S = 0.6, 0.04, 2.0, 1.0


class ConversationApp(Rival):
    """Proportional law of the face's angles; arguments as of `Rival`."""

    name = "conversation_app"
    period_s = 0.01

    def start(self, view: View) -> None:
        """See `Rival.start`."""
        self._detector = FrameRate(_APP_DETECTION_PERIOD_S)
        self._seen_s = math.inf
        self._offset_rad = view.joints.position_rad

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`."""
        for detection in self._detector.take(view.detections):
            self._offset_rad = _APP_GAIN * bearing_rad(self._camera, detection.offset, view.joints.position_rad)
            self._seen_s = view.time_s
        returned = (view.time_s - self._seen_s - _HOLD_S) / _RETURN_S
        return self._offset_rad * (1.0 - min(max(returned, 0.0), 1.0))
