"""Reachy Mini's conversation app as it was early in 2026 (0.2.2): 0.6 of the way to the face, at once.

The daemon's look-at pose of the newest frame, with the head's pose when it was processed, is scaled by 0.6 and becomes
the head's offset from its neutral pose. Nothing is filtered or limited. Today the app uses the daemon's own law.
"""

from __future__ import annotations

import math
from typing import Literal

from experiments.rivals.laws.frames import FrameRate
from experiments.rivals.laws.sight import bearing_rad
from experiments.rivals.rival import HeadCamera, View
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray


class ConversationApp:
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
    command: Literal["position"] = "position"
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
        """See `experiments.rivals.rival.Rival.start`."""
        self._detector.reset()
        self._seen_s = math.inf
        self._offset_rad = view.joints.position_rad

    def step(self, view: View) -> FloatArray:
        """See `experiments.rivals.rival.Rival.step`."""
        for detection in self._detector.take(view.detections):
            self._offset_rad = self._gain * bearing_rad(self._camera, detection.offset, view.joints.position_rad)
            self._seen_s = view.time_s
        returned = (view.time_s - self._seen_s - self._loss_s) / self._return_s
        return self._offset_rad * (1.0 - min(max(returned, 0.0), 1.0))
