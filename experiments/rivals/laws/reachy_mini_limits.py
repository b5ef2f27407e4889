"""Reachy Mini's daemon as proposed in #1409: no filter in the image, and at most 90 deg/s.

Each angle eases by itself towards a target that is made with the head's pose when the frame was processed.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from experiments.rivals.laws.faces import Association
from experiments.rivals.laws.frames import FrameRate
from experiments.rivals.laws.sight import bearing_rad
from experiments.rivals.rival import HeadCamera, View
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray


class ReachyMiniLimits:
    """Eases each angle towards the face, within a speed.

    Args:
        neck: The neck; the law uses none of its limits, and no offset of the camera.
        camera: The camera on the head.
        detection_period_s: Time between two images that the detector looks at, seconds.
        least_share: Area of the smallest face that counts, as a share of the image's.
        ease: Share of the way to the target at each step.
        largest_step_deg: What an angle may change at each step, degrees.
        loss_s: How long the target is held after the last face, seconds; then it is straight ahead.
    """

    name = "reachy_mini_limits"
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
        largest_step_deg: float = 1.8,
        loss_s: float = 2.0,
    ) -> None:
        self._camera = camera
        self._ease, self._loss_s = ease, loss_s
        self._largest_rad = math.radians(largest_step_deg)
        self._detector = FrameRate(detection_period_s)
        self._association = Association(camera, detection_period_s, least_share)

    def start(self, view: View) -> None:
        """See `experiments.rivals.rival.Rival.start`."""
        self._detector.reset()
        self._association.reset()
        self._seen_s = -math.inf
        self._aim_rad = self._target_rad = view.joints.position_rad

    def step(self, view: View) -> FloatArray:
        """See `experiments.rivals.rival.Rival.step`; what is computed now is sent at the next step."""
        for detection in self._detector.take(view.detections):
            if self._association.takes(detection):
                self._target_rad = bearing_rad(self._camera, detection.offset, view.joints.position_rad)
                self._seen_s = view.time_s
        if view.time_s - self._seen_s >= self._loss_s and self._seen_s > -math.inf:
            self._target_rad = np.zeros(2)
        sent_rad = self._aim_rad
        step_rad = self._ease * (self._target_rad - self._aim_rad)
        self._aim_rad = self._aim_rad + np.clip(step_rad, -self._largest_rad, self._largest_rad)
        return sent_rad
