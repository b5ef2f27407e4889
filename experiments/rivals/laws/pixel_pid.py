"""PIDs on pixels: obs-face-tracker, and the pan-tilt face tracker of the OpenCV tutorials.

The output of obs-face-tracker is one of a PTZ camera's few speeds. Its gain scales with the frame period, so a camera
of 60 frames a second gets half the speed of one of 30.

The output of the tutorials' law is the servo's angle: five times a second the PID turns the distance from the image
centre, in pixels of a small image, into whole degrees, without encoders, anti-windup or rate limit.
"""

from __future__ import annotations

import math

import numpy as np

from experiments.rivals.rival import SPEED_SCALES, Detection, HeadCamera, Rival, View
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

_KP = 316.0  # 50 dB
_KI_PER_S = 0.3
_TD_S = 0.42
_TL_S = 2.0
_DECAY_S = 2.0
# Outputs from which the first VISCA speeds are used; beyond them the output is rounded to a speed (assumed).
_FIRST_SPEEDS = np.array([0.5, 1.25, 1.85])
_MOST_SPEEDS = np.array([24.0, 20.0])


def visca_speed(u: FloatArray) -> FloatArray:
    """Speed step of a VISCA camera for an output.

    Args:
        u: Output of pan and tilt, shape (2,).

    Returns:
        Whole speeds, shape (2,), at most 24 (pan) and 20 (tilt).
    """
    size = np.abs(u)
    steps = np.searchsorted(_FIRST_SPEEDS, size, side="right")
    steps = np.where(steps < _FIRST_SPEEDS.size, steps, np.maximum(3.0, np.round(size)))
    speeds: FloatArray = np.sign(u) * np.minimum(steps, _MOST_SPEEDS)
    return speeds


class ObsFaceTracker(Rival):
    """Drives the camera with one of its speeds.

    Args:
        neck: Model of the neck: its top speed is that of the camera's fastest step.
        camera: Model of the camera.
        speed_scale: Speed of the camera's step 24 as a share of the neck's top speed; depends on the camera.
    """

    name = "obs_face_tracker"
    free = tuple({"speed_scale": scale} for scale in SPEED_SCALES)
    command = "velocity"

    def __init__(self, neck: NeckSpec, camera: HeadCamera, *, speed_scale: float = 1.0) -> None:
        super().__init__(neck, camera)
        self.period_s = 1.0 / camera.rate_hz
        self._rad_s_per_step = speed_scale * neck.velocity_max_rad_s / _MOST_SPEEDS[0]

    def start(self, view: View) -> None:
        """See `Rival.start`."""
        self._integral_px, self._low_pass_px, self._u = np.zeros(2), np.zeros(2), np.zeros(2)
        self._arrival_s = -math.inf

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`."""
        for detection in view.detections:
            self._see(detection)
        # A frame later than one and a half periods counts as one without a face.
        if view.time_s - self._arrival_s > 1.5 * self.period_s:
            self._u = np.zeros(2)
            self._integral_px = self._integral_px * math.exp(-self.period_s / _DECAY_S)
        speeds_rad_s: FloatArray = visca_speed(self._u) * self._rad_s_per_step
        return speeds_rad_s

    def _see(self, detection: Detection) -> None:
        dt_s, size_px = self.period_s, np.array([self._camera.width_px, self._camera.height_px])
        self._arrival_s = detection.arrival_time_s
        error_px = -detection.offset * 0.5 * size_px
        step_px = _KI_PER_S * error_px * dt_s
        opposed = self._integral_px * step_px < 0.0
        step_px = np.where(opposed, np.sign(step_px) * np.minimum(np.abs(step_px), np.abs(self._integral_px)), step_px)
        self._integral_px = self._integral_px + step_px
        low_pass_px = (self._low_pass_px * _TL_S + error_px * dt_s) / (_TL_S + dt_s)
        derivative_px_s = _TD_S * (low_pass_px - self._low_pass_px)
        self._low_pass_px = low_pass_px
        gain = _KP / math.sqrt(float(size_px.prod()))
        self._u = gain * ((error_px + self._integral_px) * dt_s + derivative_px_s)


# Gains of pan and tilt: degrees for a pixel, for a pixel held one second, for a pixel a second.
_P = np.array([0.09, 0.11])
_I = np.array([0.08, 0.10])
_D = np.array([0.002, 0.002])
_LARGEST_DEG = 90.0
_IMAGE_WIDTH_PX = 320.0


class PixelPid(Rival):
    """Commands the PID's output as an angle; arguments as of `Rival`. The law uses none of the neck's limits."""

    name = "pixel_pid"
    period_s = 0.2

    def start(self, view: View) -> None:
        """See `Rival.start`; the integral begins at the head's angles."""
        height_px = _IMAGE_WIDTH_PX * self._camera.height_px / self._camera.width_px
        self._halves_px = 0.5 * np.array([_IMAGE_WIDTH_PX, height_px])
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
