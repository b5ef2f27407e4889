"""Smith predictor for a position-controlled neck, and a variant with velocity feedforward.

The delay-free model of the neck closes the loop; the delayed model gives the head's angle at the capture of the frame.
The law uses models of dead time, servo and latency, with possible mismatch, but neither encoders nor time stamps.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from experiments.rivals.rival import HeadCamera, Rival, View, bearing_rad
from gazempc.neck.servo import zero_order_hold
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# Length of the model's history, above the sum of all delays.
_PAST_S = 8.0
# Age of the last bearing from which the person is assumed to stand.
_BEARING_TIMEOUT_S = 0.5


class Smith(Rival):
    """Smith predictor: command = delay-free model angle + gain * (bearing - delay-free model angle).

    Args:
        neck: Model of the neck: dead time, servo, top speed and range.
        camera: Model of the camera, with its latency.
        gain: Proportional gain, in (0, 1].
    """

    name = "smith"
    free = tuple({"gain": gain} for gain in (0.5, 1.0))

    def __init__(self, neck: NeckSpec, camera: HeadCamera, *, gain: float = 1.0) -> None:
        super().__init__(neck, camera)
        self._gain = gain
        # Discrete model of each axis, shape (2, 2, 3): from angle, velocity and command to angle and velocity.
        self._servos = np.stack([zero_order_hold(axis, self.period_s) for axis in neck.axes])
        self._largest_rad = neck.velocity_max_rad_s * self.period_s
        self._past: deque[tuple[float, FloatArray]] = deque(maxlen=math.ceil(_PAST_S / self.period_s))

    def start(self, view: View) -> None:
        """See `Rival.start`."""
        self._model_rad = self._wanted_rad = self._sent_rad = view.joints.position_rad
        self._model_rad_s = np.zeros(2)
        self._past.clear()
        self._past.append((view.time_s, self._model_rad))
        self._capture_s = view.time_s
        self._bearing_rad: FloatArray | None = None

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`."""
        self._advance(view.time_s)
        for detection in view.detections:
            self._capture_s = detection.arrival_time_s - self._camera.latency_s
            head_rad = self._head_rad(self._capture_s)
            self._bearing_rad = bearing_rad(self._camera, detection.offset, head_rad)
            self._estimate_velocity(self._capture_s, self._bearing_rad)
        if self._bearing_rad is not None:
            command_rad = self._model_rad + self._gain * (self._bearing_rad - self._model_rad)
            self._wanted_rad = self._within_range(command_rad + self._ahead_rad(view.time_s - self._capture_s))
        # Rate limit at the motors' top speed keeps the linear model valid.
        step_rad = self._wanted_rad - self._sent_rad
        self._sent_rad = self._sent_rad + np.clip(step_rad, -self._largest_rad, self._largest_rad)
        return self._sent_rad

    def _estimate_velocity(self, capture_s: float, bearing: FloatArray) -> None:
        """Estimate the person's angular velocity; none without feedforward."""

    def _ahead_rad(self, age_s: float) -> FloatArray:
        """Feedforward for a bearing of an age in seconds, shape (2,), radians."""
        return np.zeros(2)

    def _advance(self, now_s: float) -> None:
        if now_s > self._past[-1][0]:
            state = np.stack([self._model_rad, self._model_rad_s, self._sent_rad], axis=-1)
            self._model_rad, self._model_rad_s = np.einsum("aij,aj->ia", self._servos, state)
            self._past.append((now_s, self._model_rad))

    def _head_rad(self, time_s: float) -> FloatArray:
        """Head angles of the delayed model, shape (2,), radians."""
        times_s = np.array([time for time, _ in self._past])
        model_rad = np.array([model for _, model in self._past])
        delayed_s = time_s - self._neck.dead_time_s
        return np.array([np.interp(delayed_s[axis], times_s, model_rad[:, axis]) for axis in (0, 1)])


class SmithFeedForward(Smith):
    """Smith predictor with feedforward: angular velocity of the person times the total delay.

    An alpha-beta filter of the bearings estimates the velocity, with beta of Benedict and Bordner.

    Args:
        neck: Model of the neck.
        camera: Model of the camera.
        gain: Proportional gain, in (0, 1].
        alpha: Gain of the filter for the angle.
    """

    name = "smith_feedforward"
    free = tuple({"gain": gain, "alpha": alpha} for gain in (0.5, 1.0) for alpha in (0.1, 0.2, 0.3, 0.5, 0.8))

    def __init__(self, neck: NeckSpec, camera: HeadCamera, *, gain: float = 1.0, alpha: float = 0.3) -> None:
        super().__init__(neck, camera, gain=gain)
        self._alpha, self._beta = alpha, alpha**2 / (2.0 - alpha)

    def start(self, view: View) -> None:
        """See `Rival.start`."""
        super().start(view)
        self._velocity_rad_s = np.zeros(2)
        self._place: tuple[float, FloatArray] | None = None

    def _estimate_velocity(self, capture_s: float, bearing: FloatArray) -> None:
        dt_s = math.inf if self._place is None else capture_s - self._place[0]
        if self._place is None or dt_s > _BEARING_TIMEOUT_S:
            self._place, self._velocity_rad_s = (capture_s, bearing), np.zeros(2)
        elif dt_s > 0.0:
            expected_rad = self._place[1] + dt_s * self._velocity_rad_s
            innovation_rad = bearing - expected_rad
            self._place = capture_s, expected_rad + self._alpha * innovation_rad
            self._velocity_rad_s = self._velocity_rad_s + self._beta / dt_s * innovation_rad

    def _ahead_rad(self, age_s: float) -> FloatArray:
        if age_s > _BEARING_TIMEOUT_S + self._camera.latency_s:
            return np.zeros(2)
        delay_s = self._gain * (age_s + self._neck.dead_time_s)
        return self._velocity_rad_s * (self._neck.servo_lag_s + delay_s)
