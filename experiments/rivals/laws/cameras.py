"""Cameras: AutoPTZ 2.2.0-rc9 with its default settings, obs-face-tracker, and the pan-tilt tutorials of OpenCV.

AutoPTZ uses the image coordinates of the face, and its image velocity compensated for the camera's motion. It has a
dead zone, a velocity lead, a one-euro filter, and a gain that increases with error, velocity and delay. The lead
compensates the processing delay, not the stream's. Without encoders, the camera's motion is estimated from the
background of the image; here it is the joint motion between the two frames.

The output of obs-face-tracker is one of a PTZ camera's discrete speeds. The gain is proportional to the frame period:
the speed at 60 frames per second is half the speed at 30.

The output of the tutorials' law is the servo's angle, in whole degrees: a PID law at 5 Hz of the offset from the image
centre, in pixels of a small image, without encoders, anti-windup or rate limit.
"""

from __future__ import annotations

import math

import numpy as np

from experiments.rivals.rival import SPEED_SCALES, Detection, HeadCamera, Rival, View, half_sizes
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# Constants of AutoPTZ, `engine/ptz/controller.py` and `config/models.py`; normalised image coordinates.
_AIM_GAIN = 0.4
_VELOCITY_GAIN = 0.5
_FRAMES_PER_VELOCITY = 3
_ZONE = np.array([0.15, 0.22])
_REST_INSIDE, _REST_OUTSIDE = 0.35, 1.25  # hysteresis, as shares of the zone
_DEAD_ZONE = 0.35 * _ZONE
_RAMP = 0.05
_EDGE = 0.9
_LEAD_S, _LONGEST_LEAD_S = 0.15, 0.8
_PROCESSING_S = 0.05  # delay of ingest and inference, measured by the program; assumed here
_KP, _KD, _KV = 0.6, 0.05, 0.1
_EXPONENT = 1.2
_RISE_PER_S = 3.0
_KEPT_S = 1.5


class AutoPtz(Rival):
    """Velocity law, one command per frame.

    Args:
        neck: Model of the neck, with its top speed.
        camera: Model of the camera.
        speed_scale: Speed of the command 1, relative to the neck's top speed; a free parameter of the program.
    """

    name = "autoptz"
    free = tuple({"speed_scale": scale} for scale in SPEED_SCALES)
    command = "velocity"

    def __init__(self, neck: NeckSpec, camera: HeadCamera, *, speed_scale: float = 1.0) -> None:
        super().__init__(neck, camera)
        self.period_s = 1.0 / camera.rate_hz
        self._top_rad_s = speed_scale * neck.velocity_max_rad_s

    def start(self, view: View) -> None:
        """See `Rival.start`."""
        self._command = np.zeros(2)
        self._slewed = np.zeros(2)
        self._arrival_s = -math.inf
        self._reset()

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`."""
        for detection in view.detections:
            self._update(view, detection)
        # A delay above one and a half periods is treated as a frame without a face.
        if view.time_s - self._arrival_s > 1.5 * self.period_s:
            self._command = np.zeros(2)
            self._reset()
        return self._command * self._top_rad_s

    def _reset(self) -> None:
        self._error: FloatArray | None = None
        self._filter = OneEuro(least_cutoff_hz=1.1, beta=0.03, speed_cutoff_hz=1.0)
        self._velocity, self._filtered, self._sign = np.zeros(2), np.zeros(2), np.zeros(2)
        self._resting, self._swings, self._frames = False, 0.0, 0
        self._anchor: tuple[float, FloatArray, FloatArray] | None = None

    def _update(self, view: View, detection: Detection) -> None:
        seen = -detection.offset
        gap_s = detection.arrival_time_s - self._arrival_s
        dt_s = gap_s if self._error is not None else self.period_s
        if gap_s > _KEPT_S:
            self._slewed = np.zeros(2)
        self._arrival_s = detection.arrival_time_s
        self._error = seen if self._error is None else self._error + _AIM_GAIN * (seen - self._error)
        self._measure_velocity(view, detection)
        error, velocity = self._apply_dead_zone(self._error)
        u = self._speed(error, velocity, dt_s)
        before = np.where(u * self._slewed > 0.0, np.abs(self._slewed), 0.0)
        self._command = self._slewed = np.sign(u) * np.minimum(np.abs(u), before + _RISE_PER_S * dt_s)

    def _measure_velocity(self, view: View, detection: Detection) -> None:
        """Image velocity of the face, compensated for the camera's motion, at each third frame."""
        self._frames += 1
        if self._frames % _FRAMES_PER_VELOCITY != 1 or self._error is None:
            return
        head_rad = view.joints_at(detection.capture_time_s)
        if head_rad is None:
            return
        if self._anchor is not None:
            before_s, error, before_rad = self._anchor
            dt_s = detection.capture_time_s - before_s
            own = -(head_rad - before_rad) / half_sizes(self._camera) / dt_s
            fresh = (self._error - error) / dt_s - own
            self._velocity = _VELOCITY_GAIN * fresh + (1.0 - _VELOCITY_GAIN) * self._velocity
        self._anchor = (detection.capture_time_s, self._error, head_rad)

    def _apply_dead_zone(self, error: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Error with velocity lead, and velocity; zero inside the dead zone."""
        lead_s = min(_LEAD_S + _PROCESSING_S, _LONGEST_LEAD_S)
        if np.abs(error).max() >= _EDGE:
            self._resting = False
            return error + lead_s * self._velocity, self._velocity
        away = float(np.linalg.norm(error / _ZONE))
        self._resting = away <= (_REST_OUTSIDE if self._resting else _REST_INSIDE)
        if self._resting:
            return np.zeros(2), np.zeros(2)
        beyond = np.maximum(np.abs(error) - _DEAD_ZONE, 0.0)
        part = np.minimum(beyond / _RAMP, 1.0)
        counted = np.sign(error) * beyond * part**2 * (3.0 - 2.0 * part)
        return counted + lead_s * self._velocity, self._velocity

    def _speed(self, error: FloatArray, velocity: FloatArray, dt_s: float) -> FloatArray:
        filtered = self._filter.update(error, dt_s)
        u = _KP * filtered + _KD * (filtered - self._filtered) / dt_s + _KV * velocity
        self._filtered = filtered
        boost = max(
            min(1.0, float(np.linalg.norm(filtered)) / 0.6),
            0.65 * min(1.0, float(np.linalg.norm(velocity)) / 1.5),
            0.55 * min(1.0, _PROCESSING_S / 0.3),
        )
        u = np.clip(0.7 * (1.0 + 0.9 * boost) * u, -1.0, 1.0)
        u = np.sign(u) * np.abs(u) ** _EXPONENT
        # Gain reduction on oscillation.
        flips = np.count_nonzero(np.sign(u) * self._sign < 0.0)
        self._sign = np.where(u == 0.0, self._sign, np.sign(u))
        self._swings = min(4.0, 0.6 * self._swings + flips)
        return u / (1.0 + 0.6 * self._swings)


class OneEuro:
    """One-euro filter of each element of an array.

    Args:
        least_cutoff_hz: Cutoff frequency at constant input.
        beta: Slope of the cutoff frequency over the input's speed, hertz for a unit per second.
        speed_cutoff_hz: Cutoff frequency of the low-pass filter of the speed.
    """

    def __init__(self, least_cutoff_hz: float, beta: float, speed_cutoff_hz: float) -> None:
        self._least_cutoff_hz, self._beta, self._speed_cutoff_hz = least_cutoff_hz, beta, speed_cutoff_hz
        self._value: FloatArray | None = None
        self._input: FloatArray | None = None

    def update(self, value: FloatArray, dt_s: float) -> FloatArray:
        """Filtered value, of the input's shape; `dt_s` is the time since the last update, seconds."""
        if self._value is None or self._input is None:
            self._value, self._speed = value, np.zeros_like(value)
        else:
            speed = (value - self._input) / dt_s
            self._speed = self._speed + _share(np.asarray(self._speed_cutoff_hz), dt_s) * (speed - self._speed)
            cutoff_hz = self._least_cutoff_hz + self._beta * np.abs(self._speed)
            self._value = self._value + _share(cutoff_hz, dt_s) * (value - self._value)
        self._input = value
        return self._value


def _share(cutoff_hz: FloatArray, dt_s: float) -> FloatArray:
    step = 2.0 * math.pi * cutoff_hz * dt_s
    return step / (step + 1.0)


# obs-face-tracker.
_GAIN_PX = 316.0  # 50 dB
_INTEGRAL_PER_S = 0.3
_TD_S = 0.42
_TL_S = 2.0
_DECAY_S = 2.0
# Thresholds of the first VISCA speeds; higher outputs are rounded (assumed).
_FIRST_SPEEDS = np.array([0.5, 1.25, 1.85])
_MOST_SPEEDS = np.array([24.0, 20.0])


def visca_speed(u: FloatArray) -> FloatArray:
    """Quantise an output to the speed steps of a VISCA camera.

    Args:
        u: Output of pan and tilt, shape (2,).

    Returns:
        Integer speed steps, shape (2,), at most 24 (pan) and 20 (tilt).
    """
    size = np.abs(u)
    steps = np.searchsorted(_FIRST_SPEEDS, size, side="right")
    steps = np.where(steps < _FIRST_SPEEDS.size, steps, np.maximum(3.0, np.round(size)))
    speeds: FloatArray = np.sign(u) * np.minimum(steps, _MOST_SPEEDS)
    return speeds


class ObsFaceTracker(Rival):
    """PID law with quantised velocity output.

    Args:
        neck: Model of the neck, with the speed of the camera's fastest step.
        camera: Model of the camera.
        speed_scale: Speed of step 24, relative to the neck's top speed; depends on the camera.
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
            self._update(detection)
        # A delay above one and a half periods is treated as a frame without a face.
        if view.time_s - self._arrival_s > 1.5 * self.period_s:
            self._u = np.zeros(2)
            self._integral_px = self._integral_px * math.exp(-self.period_s / _DECAY_S)
        speeds_rad_s: FloatArray = visca_speed(self._u) * self._rad_s_per_step
        return speeds_rad_s

    def _update(self, detection: Detection) -> None:
        dt_s, size_px = self.period_s, np.array([self._camera.width_px, self._camera.height_px])
        self._arrival_s = detection.arrival_time_s
        error_px = -detection.offset * 0.5 * size_px
        step_px = _INTEGRAL_PER_S * error_px * dt_s
        opposed = self._integral_px * step_px < 0.0
        step_px = np.where(opposed, np.sign(step_px) * np.minimum(np.abs(step_px), np.abs(self._integral_px)), step_px)
        self._integral_px = self._integral_px + step_px
        low_pass_px = (self._low_pass_px * _TL_S + error_px * dt_s) / (_TL_S + dt_s)
        derivative_px_s = _TD_S * (low_pass_px - self._low_pass_px)
        self._low_pass_px = low_pass_px
        gain = _GAIN_PX / math.sqrt(float(size_px.prod()))
        self._u = gain * ((error_px + self._integral_px) * dt_s + derivative_px_s)


# PID gains of pan and tilt: deg/px, deg/(px s), deg s/px.
_TUTORIAL_P = np.array([0.09, 0.11])
_TUTORIAL_I = np.array([0.08, 0.10])
_TUTORIAL_D = np.array([0.002, 0.002])
_LARGEST_DEG = 90.0
_IMAGE_WIDTH_PX = 320.0


class PixelPid(Rival):
    """PID law with angle output, without the neck's limits; arguments as of `Rival`."""

    name = "pixel_pid"
    period_s = 0.2

    def start(self, view: View) -> None:
        """See `Rival.start`; the integral is initialised with the head's angles."""
        height_px = _IMAGE_WIDTH_PX * self._camera.height_px / self._camera.width_px
        self._halves_px = 0.5 * np.array([_IMAGE_WIDTH_PX, height_px])
        self._command_deg = np.rad2deg(view.joints.position_rad)
        self._integral_px_s = self._command_deg / _TUTORIAL_I
        self._error_px = np.zeros(2)

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`."""
        error_px = -view.detections[-1].offset * self._halves_px if view.detections else np.zeros(2)
        self._integral_px_s = self._integral_px_s + error_px * self.period_s
        change_px_s = (error_px - self._error_px) / self.period_s
        self._error_px = error_px
        angle_deg = np.round(_TUTORIAL_P * error_px + _TUTORIAL_I * self._integral_px_s + _TUTORIAL_D * change_px_s)
        self._command_deg = np.where(np.abs(angle_deg) <= _LARGEST_DEG, angle_deg, self._command_deg)
        return np.deg2rad(self._command_deg)
