"""Smith predictor for a neck that takes positions, and the same with a feed-forward of the person's velocity.

A model of the neck without its dead time answers at once; the same model behind the delays says where the head was when
the frame was captured. So the law needs neither encoders nor stamps, but delays and a servo that are known: those of
its neck and camera, which may differ from the true ones.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from experiments.rivals.rival import HeadCamera, Rival, View, bearing_rad
from gazempc.neck.servo import zero_order_hold
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# The model's past: more than all delays together.
_PAST_S = 8.0


class Smith(Rival):
    """Commands the model's angle plus a share of the error that the model sees.

    Args:
        neck: The neck as the law takes it to be: dead time, servo, top speed and range.
        camera: The camera as the law takes it to be, with its latency.
        gain: Share of the error, above 0 and at most 1.
        period_s: Time between two steps, seconds.
    """

    name = "smith"
    free = tuple({"gain": gain} for gain in (0.5, 1.0))

    def __init__(self, neck: NeckSpec, camera: HeadCamera, *, gain: float = 1.0, period_s: float = 0.02) -> None:
        self.period_s = period_s
        self._neck, self._camera, self._gain = neck, camera, gain
        # One step of each axis, shape (2, 2, 3): from angle, velocity and command to angle and velocity.
        self._servos = np.stack([zero_order_hold(axis, period_s) for axis in neck.axes])
        self._largest_rad = neck.velocity_max_rad_s * period_s
        self._past: deque[tuple[float, FloatArray]] = deque(maxlen=math.ceil(_PAST_S / period_s))

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
            self._see(self._capture_s, self._bearing_rad)
        if self._bearing_rad is not None:
            command_rad = self._model_rad + self._gain * (self._bearing_rad - self._model_rad)
            command_rad = command_rad + self._ahead_rad(view.time_s - self._capture_s)
            self._wanted_rad = np.clip(command_rad, self._neck.position_min_rad, self._neck.position_max_rad)
        # No faster than the motors turn: so the model knows what they do.
        way_rad = self._wanted_rad - self._sent_rad
        self._sent_rad = self._sent_rad + np.clip(way_rad, -self._largest_rad, self._largest_rad)
        return self._sent_rad

    def _see(self, capture_s: float, bearing: FloatArray) -> None:
        """For laws that measure the person's velocity."""

    def _ahead_rad(self, age_s: float) -> FloatArray:
        """What is added to the command, with a bearing of that age, shape (2,), radians."""
        return np.zeros(2)

    def _advance(self, now_s: float) -> None:
        if now_s > self._past[-1][0]:
            state = np.stack([self._model_rad, self._model_rad_s, self._sent_rad], axis=-1)
            self._model_rad, self._model_rad_s = np.einsum("aij,aj->ia", self._servos, state)
            self._past.append((now_s, self._model_rad))

    def _head_rad(self, time_s: float) -> FloatArray:
        """Where the head was by the model behind the dead time."""
        times_s = np.array([time for time, _ in self._past])
        model_rad = np.array([model for _, model in self._past])
        asked_s = time_s - self._neck.dead_time_s
        return np.array([np.interp(asked_s[axis], times_s, model_rad[:, axis]) for axis in (0, 1)])


class SmithFeedForward(Smith):
    """The same, and the command goes ahead by the person's angular velocity times all delays.

    An alpha-beta filter on the bearings gives the velocity, with beta of Benedict and Bordner.

    Args:
        neck: The neck as the law takes it to be.
        camera: The camera as the law takes it to be.
        gain: Share of the error, above 0 and at most 1.
        period_s: Time between two steps, seconds.
        alpha: Share of a new bearing's surprise that is taken for a change of place.
        patience_s: After so long without a bearing the person is taken to stand, seconds.
    """

    name = "smith_feedforward"
    free = tuple({"gain": gain, "alpha": alpha} for gain in (0.5, 1.0) for alpha in (0.1, 0.2, 0.3, 0.5, 0.8))

    def __init__(
        self,
        neck: NeckSpec,
        camera: HeadCamera,
        *,
        gain: float = 1.0,
        period_s: float = 0.02,
        alpha: float = 0.3,
        patience_s: float = 0.5,
    ) -> None:
        super().__init__(neck, camera, gain=gain, period_s=period_s)
        self._alpha, self._beta = alpha, alpha**2 / (2.0 - alpha)
        self._patience_s = patience_s

    def start(self, view: View) -> None:
        """See `Rival.start`."""
        super().start(view)
        self._velocity_rad_s = np.zeros(2)
        self._place: tuple[float, FloatArray] | None = None

    def _see(self, capture_s: float, bearing: FloatArray) -> None:
        dt_s = math.inf if self._place is None else capture_s - self._place[0]
        if self._place is None or dt_s > self._patience_s:
            self._place, self._velocity_rad_s = (capture_s, bearing), np.zeros(2)
        elif dt_s > 0.0:
            expected_rad = self._place[1] + dt_s * self._velocity_rad_s
            surprise_rad = bearing - expected_rad
            self._place = capture_s, expected_rad + self._alpha * surprise_rad
            self._velocity_rad_s = self._velocity_rad_s + self._beta / dt_s * surprise_rad

    def _ahead_rad(self, age_s: float) -> FloatArray:
        if age_s > self._patience_s + self._camera.latency_s:
            return np.zeros(2)
        delay_s = self._gain * (age_s + self._neck.dead_time_s)
        return self._velocity_rad_s * (self._neck.servo_lag_s + delay_s)
