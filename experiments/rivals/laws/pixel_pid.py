"""The pan-tilt face tracker of the OpenCV tutorials: a PID on pixels whose output is the servo's angle.

Five times a second the distance of the face from the image's middle, in pixels of a small image, becomes an absolute
angle in whole degrees. There are no encoders, no limit of the integral and none of the rate.
"""

from __future__ import annotations

import numpy as np

from experiments.rivals.rival import HeadCamera, Rival, View
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# Gains of pan and tilt: degrees for a pixel, for a pixel held one second, for a pixel a second.
_P = np.array([0.09, 0.11])
_I = np.array([0.08, 0.10])
_D = np.array([0.002, 0.002])
_LARGEST_DEG = 90.0


class PixelPid(Rival):
    """Commands the PID's output as an angle.

    Args:
        neck: The neck; the law uses none of its limits.
        camera: The camera on the head.
        image_width_px: Width of the image in which pixels are counted.
    """

    name = "pixel_pid"
    period_s = 0.2

    def __init__(self, neck: NeckSpec, camera: HeadCamera, *, image_width_px: float = 320.0) -> None:
        height_px = image_width_px * camera.height_px / camera.width_px
        self._halves_px = 0.5 * np.array([image_width_px, height_px])

    def start(self, view: View) -> None:
        """See `Rival.start`; the head's angle at the start is in the integral."""
        self._command_deg = np.rad2deg(view.joints.position_rad)
        self._integral_px_s = self._command_deg / _I
        self._error_px = np.zeros(2)

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`."""
        error_px = -view.detections[-1].offset * self._halves_px if view.detections else np.zeros(2)
        self._integral_px_s = self._integral_px_s + error_px * self.period_s
        change_px_s = (error_px - self._error_px) / self.period_s
        self._error_px = error_px
        angle_deg = np.round(_P * error_px + _I * self._integral_px_s + _D * change_px_s)
        self._command_deg = np.where(np.abs(angle_deg) <= _LARGEST_DEG, angle_deg, self._command_deg)
        return np.deg2rad(self._command_deg)
