"""Rotation of a camera from image registration, and estimation of delay, lag and speeds.

Pictures are projected onto a cylinder about the axis, on which a rotation is a translation. Phase correlation gives it
to a pixel, robust least squares on the grey values to a fraction. Of several candidates the one that explains half of
the pixels is chosen, so a person who moves in the picture has no effect.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from gazempc.identify.estimate import Interval
from gazempc.identify.record import IdentificationError
from gazempc.identify.servo_fit import Z_95, fit
from gazempc.live.sources.camera.blazeface import import_opencv
from gazempc.types import BoolArray, FloatArray

# Largest shift, as a share of the picture: beyond it the overlap is too small.
_LARGEST_SHIFT = 0.45
# Least ratio of the focal lengths of a guessed and the true lens: a zoom of 30 with a margin. Least motion by position
# replies: below their resolution.
_LEAST_RATIO, _LEAST_MOTION_RAD = 0.02, 1e-9
# Standard deviation of the time at which a device receives a command.
_SEND_JITTER_S = 0.004


class Turning:
    """Measures the rotation of a camera about one axis.

    Args:
        axis: ``pan`` or ``tilt``.
        fov_rad: Horizontal angle of the picture.
        width: Width of the picture, pixels.
        height: Height of the picture, pixels.
    """

    def __init__(self, axis: str, fov_rad: float, width: int, height: int) -> None:
        self._cv2, self._tilts = import_opencv(), axis == "tilt"
        across, along = (height, width) if self._tilts else (width, height)
        self._focal_px = 0.5 * width / math.tan(0.5 * fov_rad)
        half_rad = math.atan(0.5 * across / self._focal_px)
        columns, rows = int(2.0 * half_rad * self._focal_px), int(0.9 * along * math.cos(half_rad))
        angle = (np.arange(columns) - 0.5 * (columns - 1)) / self._focal_px
        up = np.arange(rows) - 0.5 * (rows - 1)
        self._x = np.tile(0.5 * (across - 1) + self._focal_px * np.tan(angle), (rows, 1)).astype(np.float32)
        self._y = (0.5 * (along - 1) + up[:, None] / np.cos(angle)).astype(np.float32)

    def flat(self, grey: Any) -> Any:
        """Project a grey picture onto the cylinder, shape (rows, columns), float32.

        Raises:
            IdentificationError: If the picture is dark or blank.
        """
        # Least standard deviation of grey levels; below it a picture is dark, or a blank wall.
        if float(np.std(grey)) < 4.0:
            raise IdentificationError(
                "the picture is dark or blank: point the camera at a scene with texture, in light"
            )
        turned = np.ascontiguousarray(grey.T) if self._tilts else grey
        return self._cv2.remap(turned, self._x, self._y, self._cv2.INTER_LINEAR).astype(np.float32)

    def between(self, before: Any, after: Any, guess_rad: float = 0.0) -> float:
        """Rotation between two projected pictures.

        Args:
            before: The first, from `flat`.
            after: The second.
            guess_rad: Initial estimate, radians.

        Returns:
            Radians, positive to the left or up; NaN if the overlap is too small.
        """
        columns, start_px = before.shape[1], round(guess_rad * self._focal_px)
        tried = {start_px, *self._peaks(before, after, start_px), *self._peaks(before, after, 0)}
        # Median over pixels: the background, robust to moving objects.
        pairs = {px: _common(before, after, px) for px in tried if abs(px) < columns // 2}
        left = {px: float(np.median(np.abs(one - other))) for px, (one, other) in pairs.items()}
        best = min(left, key=lambda whole_px: left[whole_px])
        # Largest median difference of two registered pictures, in standard deviations; above it they do not overlap.
        if abs(best) > _LARGEST_SHIFT * columns or left[best] > 0.35 * float(np.std(before)):
            return math.nan
        return self._refined(before, after, best) / self._focal_px

    def _peaks(self, before: Any, after: Any, start_px: int) -> list[int]:
        """Shifts at the highest peaks of the phase correlation of the overlap at an initial shift."""
        if abs(start_px) > _LARGEST_SHIFT * before.shape[1]:
            return []
        one, other = _common(before, after, start_px)
        window = self._cv2.createHanningWindow(one.shape[::-1], self._cv2.CV_32F)
        cross = np.conj(np.fft.rfft2(one * window)) * np.fft.rfft2(other * window)
        surface = np.fft.irfft2(cross / np.maximum(np.abs(cross), 1e-9), one.shape)
        # Rotation about this axis causes no transverse shift.
        profile, columns = surface[[-1, 0, 1]].max(axis=0), one.shape[1]
        # Number of candidates: a correlation peak is two or three columns wide, and a moving person may cause another
        # one.
        highest = np.argsort(profile)[-12:]
        return [start_px + int((k + columns // 2) % columns - columns // 2) for k in highest]

    def _refined(self, before: Any, after: Any, whole_px: int) -> float:
        # The peak of a phase correlation is biased to whole pixels; robust least squares on the grey values is not.
        cv2 = self._cv2
        one, other = _common(cv2.GaussianBlur(before, (0, 0), 1.5), cv2.GaussianBlur(after, (0, 0), 1.5), whole_px)
        part_px = 0.0
        # Gauss-Newton steps of the subpixel registration.
        for _ in range(5):
            moved = cv2.warpAffine(other, np.array([[1.0, 0.0, -part_px], [0.0, 1.0, 0.0]]), other.shape[::-1])
            slope = 0.25 * (np.gradient(one, axis=1) + np.gradient(moved, axis=1))[4:-4, 4:-4]
            error = (one - moved)[4:-4, 4:-4]
            left = float(np.median(np.abs(error)))
            weight = slope / (1.0 + (error / (1.5 * left + 1e-6)) ** 2)
            step_px = 0.5 * float(np.sum(weight * error)) / max(float(np.sum(weight * slope)), 1e-9)
            part_px = min(max(part_px + step_px, -1.5), 1.5)
        return whole_px + part_px


def _common(before: Any, after: Any, whole_px: int) -> tuple[Any, Any]:
    """The overlap of two pictures, the second of which is shifted to the right."""
    columns = before.shape[1]
    one = before[:, max(-whole_px, 0) : columns - max(whole_px, 0)]
    return one, after[:, max(whole_px, 0) : columns + min(whole_px, 0)]


def turned_rad(turning: Turning, greys: Sequence[Any], most_rad: float) -> FloatArray:
    """Visual odometry over pictures, with key frames: drift accumulates only at changes of the key frame.

    Args:
        turning: Measures the rotation between two pictures.
        greys: The N pictures, grey.
        most_rad: Rotation beyond which a new key frame is taken.

    Returns:
        The rotation since the first picture, shape (N,), radians; NaN for an invalid picture, such as a blurred one.
    """
    key, found_rad = turning.flat(greys[0]), [0.0]
    key_rad = last_rad = rate_rad = 0.0
    for flat in map(turning.flat, greys[1:]):
        moved_rad = turning.between(key, flat, last_rad + rate_rad - key_rad)
        found_rad.append(key_rad + moved_rad)
        if not math.isnan(moved_rad):
            rate_rad, last_rad = found_rad[-1] - last_rad, found_rad[-1]
        if abs(moved_rad) > most_rad:
            key, key_rad = flat, last_rad
    return np.array(found_rad)


def lens_angle_rad(motions: Sequence[tuple[FloatArray, Any, Any]], guess_rad: float) -> float:
    """Horizontal lens angle from the ratio of rotations by pictures and by position replies.

    Args:
        motions: For each motion in pan the angles by position replies, shape (N,), radians, and the first and the last
            picture, grey, shape (height, width).
        guess_rad: Initial lens angle, radians.

    Returns:
        The lens angle, radians; the initial one without replies.

    Raises:
        IdentificationError: If the pictures of all motions lack overlap, or the rotations differ too much.
    """
    height, width = motions[0][1].shape
    focal_px = 0.5 * width / math.tan(0.5 * guess_rad)
    reported = [motion for motion in motions if motion[0].size > 1]
    for _ in range(3 if reported else 0):
        turning, ratios = Turning("pan", 2.0 * math.atan(0.5 * width / focal_px), width, height), []
        for angle_rad, before, after in reported:
            moved_rad = turning.between(turning.flat(before), turning.flat(after))
            ratios.append(abs(moved_rad) / max(abs(angle_rad[-1] - angle_rad[0]), _LEAST_MOTION_RAD))
        # To first order, angle = pixels / focal length. NaN: pictures without overlap.
        ratio = float(np.median([each for each in ratios if math.isfinite(each)] or math.nan))
        if not _LEAST_RATIO < ratio < 1.0 / _LEAST_RATIO:
            reason = "the rotations of the pictures do not fit the camera's position replies"
            raise IdentificationError(f"{reason}; expected: the lens angle, --camera.fov-deg")
        focal_px *= ratio
    return 2.0 * math.atan(0.5 * width / focal_px)


@dataclass(frozen=True)
class Pulse:
    """One speed for a while, and the angles around it.

    Attributes:
        step: The device's step, with its sign.
        on_s: Send time of the speed, seconds.
        off_s: Send time of the stop, seconds.
        time_s: Stamps of the angles, shape (N,), seconds.
        angle_rad: Shape (N,), radians; NaN if unknown.
    """

    step: int
    on_s: float
    off_s: float
    time_s: FloatArray
    angle_rad: FloatArray


@dataclass(frozen=True)
class TurnEstimate:
    """Estimate of an axis from pulses.

    Attributes:
        delay_s: Delay from sending a command to its effect in the angles.
        natural_frequency_rad_s: Natural frequency of a speed servo with damping ratio 1.
        speeds_rad_s: Speed of each step, with the sign of the angles.
        residual_deg: RMS of angles minus model.
    """

    delay_s: Interval
    natural_frequency_rad_s: Interval
    speeds_rad_s: Mapping[int, Interval]
    residual_deg: float

    @property
    def sign(self) -> int:
        """1 if positive steps turn to the left or up, else -1."""
        return 1 if sum(step * speed.value for step, speed in self.speeds_rad_s.items()) >= 0.0 else -1


def estimate_turns(pulses: Sequence[Pulse], delay_max_s: float) -> TurnEstimate:
    """Fit delay, lag and the speed of each step.

    Variable projection: delay and natural frequency by `scipy.optimize.least_squares`, speed and initial angle of each
    pulse in closed form.

    Args:
        pulses: Pulses of one axis.
        delay_max_s: Upper bound of the delay, seconds.

    Raises:
        IdentificationError: If the delay is not identifiable.
    """
    used = _masked(pulses, [np.isfinite(pulse.angle_rad) for pulse in pulses])
    if not used:
        raise IdentificationError("no pulse has enough pictures that can be compared: more light, less blur")

    def solved(values: Sequence[float] | FloatArray) -> tuple[list[FloatArray], list[float]]:
        residuals, speeds = [], []
        for pulse in used:
            since_s = pulse.time_s - values[0]
            shape = _ramp(since_s - pulse.on_s, math.exp(values[1])) - _ramp(since_s - pulse.off_s, math.exp(values[1]))
            design = np.stack([np.ones_like(shape), shape], axis=1)
            found, *_ = np.linalg.lstsq(design, pulse.angle_rad, rcond=None)
            residuals.append(pulse.angle_rad - design @ found)
            speeds.append(float(found[1]))
        return residuals, speeds

    def residual(values: Sequence[float] | FloatArray) -> FloatArray:
        return np.concatenate(solved(values)[0])

    starts = [(delay_s, math.log(lag)) for delay_s in np.arange(0.05, delay_max_s, 0.2) for lag in (8.0, 30.0)]
    scanned = sorted(starts, key=lambda values: float(np.sum(residual(values) ** 2)))
    low, high = (-0.05, math.log(2.0)), (delay_max_s + 0.2, math.log(100.0))
    best = fit(residual, scanned[:2], low, high)
    # Refit without outliers from wrong registrations.
    least_rad = 4.0 * 1.48 * float(np.median(np.abs(best.residual))) + 1e-4
    used = _masked(used, [np.abs(own) <= least_rad for own in solved(best.values)[0]])
    best = fit(residual, [tuple(best.values)], low, high)
    residuals, speeds = solved(best.values)
    noise_rad = float(np.sqrt(np.mean(best.residual**2)))
    if noise_rad > 0.3 * float(np.sqrt(np.mean(np.concatenate([p.angle_rad - p.angle_rad.mean() for p in used]) ** 2))):
        raise IdentificationError("the picture does not follow the commands: check the camera and the scene")
    found: dict[int, list[tuple[float, float]]] = {}
    for pulse, own, speed in zip(used, residuals, speeds, strict=True):
        found.setdefault(pulse.step, []).append(_speed(pulse, best.values, speed, own))
    wide = Z_95 * np.sqrt(np.diag(best.covariance))
    wn = math.exp(best.values[1])
    return TurnEstimate(
        delay_s=Interval.around(best.values[0], wide[0]),
        natural_frequency_rad_s=Interval(wn, wn * math.exp(-wide[1]), wn * math.exp(wide[1])),
        # The median is robust to single pulses with motion in the scene.
        speeds_rad_s={
            step: Interval.around(np.median(speeds), Z_95 * max(sds) / math.sqrt(len(sds)))
            for step, (speeds, sds) in sorted((step, zip(*each, strict=True)) for step, each in found.items())
        },
        residual_deg=math.degrees(noise_rad),
    )


def _masked(pulses: Sequence[Pulse], masks: Sequence[BoolArray]) -> list[Pulse]:
    """The pulses at the masked times, without those that have too few."""
    pairs = [(pulse, mask) for pulse, mask in zip(pulses, masks, strict=True) if mask.sum() >= 4]
    return [replace(pulse, time_s=pulse.time_s[mask], angle_rad=pulse.angle_rad[mask]) for pulse, mask in pairs]


def _speed(pulse: Pulse, servo: FloatArray, start_rad_s: float, residual: FloatArray) -> tuple[float, float]:
    """Speed of one pulse and its standard deviation; includes the uncertainty of both send times."""
    since_s, wn = pulse.time_s - servo[0], math.exp(servo[1])
    noise_rad = min(max(1.48 * float(np.median(np.abs(residual))), 1e-4), 2e-3)

    def residuals(values: FloatArray) -> FloatArray:
        first_rad, speed, on_s, off_s = values
        pulse_rad = speed * (_ramp(since_s - pulse.on_s - on_s, wn) - _ramp(since_s - pulse.off_s - off_s, wn))
        return np.append(
            (pulse.angle_rad - first_rad - pulse_rad) / noise_rad, (on_s / _SEND_JITTER_S, off_s / _SEND_JITTER_S)
        )

    own: Any = least_squares(residuals, (pulse.angle_rad[0], start_rad_s, 0.0, 0.0), x_scale=(0.1, 0.1, 0.01, 0.01))
    spread = max(2.0 * own.cost / max(since_s.size - 2, 1), 1.0)
    return float(own.x[1]), math.sqrt(spread * float(np.linalg.pinv(own.jac.T @ own.jac)[1, 1]))


def _ramp(time_s: FloatArray, wn: float) -> FloatArray:
    """Ramp response of q'' = wn^2 (u - q) - 2 wn q' to u = t, from rest at 0."""
    t = np.maximum(time_s, 0.0)
    return np.asarray(t - 2.0 / wn + np.exp(-wn * t) * (t + 2.0 / wn))
