"""Feedforward with preview: command the angle that is forecast for the end of the joint's delay."""

from __future__ import annotations

import math

import numpy as np

from gazempc.controllers.chain import Chain, head_time_s, low_pass, slopes
from gazempc.controllers.controller import Plan, Situation
from gazempc.neck.spec import NeckSpec
from gazempc.settings import LookAheadSettings
from gazempc.types import FloatArray

# Length of a plan, seconds: more than a control period, to bridge a late successor.
_PLAN_S = 0.4
# Acquisition: no smoothing while the command is farther from the demanded angle. Twice the tolerance of eye contact
# (2.6 deg), below which the difference is forecast noise.
_ACQUISITION_RAD = math.radians(5.0)
# Bound on the eye angle, as a share of the eyes' range.
_EYES_SHARE = 0.4
# Time constant of a head with eyes, which compensate its lag.
_HEAD_TIME_S = 0.6
_DEFAULTS = LookAheadSettings()


class LookAhead:
    """Commands the low-passed look-at angles of the forecast for the end of the joint's delay.

    The preview includes the delay of the low-pass, so a reference of constant rate is tracked without lag at any time
    constant. In acquisition (command far from the demanded angle) an axis bypasses the low-pass, which would cause
    overshoot of a rate-limited command. After acquisition, the low-pass restarts from the present command.

    With eyes this is a cascade: the head is smoothed more, and the eyes take the residual angle
    (`gazempc.controllers.chain`).

    Args:
        neck: The neck; its dead time, servo lag (2 zeta / wn) and servo period are the preview on each axis.
        smoothing_time_s: Time constant of a first-order low-pass on the commanded angles: larger is smoother and slower
            after unforeseen motion. 0 for none.
        head_smoothing_time_s: The same for the head of a neck with eyes. None: 0.6, or 0.1 if the eyes have a share of
            the angle, as people turn such a head at top speed.

    Attributes:
        neck: The neck.
    """

    def __init__(
        self,
        neck: NeckSpec,
        smoothing_time_s: float = _DEFAULTS.smoothing_time_s,
        head_smoothing_time_s: float | None = _DEFAULTS.head_smoothing_time_s,
    ) -> None:
        self.neck = neck
        knots = round(_PLAN_S / neck.control_period_s) + 1
        self._knots_s: FloatArray = neck.control_period_s * np.arange(knots, dtype=np.float64)
        if neck.eyes is not None:
            smoothing_time_s = head_time_s(neck, head_smoothing_time_s, _HEAD_TIME_S)
        self._keep = math.exp(-neck.control_period_s / smoothing_time_s) if smoothing_time_s > 0 else 0.0
        # The zero-order hold adds a mean delay of half a servo period.
        ahead_s = (neck.dead_time_s + neck.servo_lag_s)[:2] + 0.5 * neck.servo_period_s
        # Ramp-tracking lag of the discrete low-pass: slightly less than its time constant.
        lag_s = neck.control_period_s * self._keep / (1.0 - self._keep)
        # Preview of each axis: of the demanded angle, and of the input of the low-pass.
        self._ahead_s = np.concatenate([ahead_s, ahead_s + lag_s])
        self._weights, self._kept = low_pass(self._keep, self._knots_s.size)
        self._chain = Chain(neck, self._knots_s)
        self._eyes_reach_rad: FloatArray | None = None
        if neck.eyes is not None:
            ranges = [min(-axis.position_min_deg, axis.position_max_deg) for axis in (neck.eyes.pan, neck.eyes.tilt)]
            self._eyes_reach_rad = _EYES_SHARE * np.maximum(np.deg2rad(ranges), 0.0)
        self.reset()

    def reset(self) -> None:
        """Reset the state of the low-pass to NaN: not started."""
        self._smoothed_rad: FloatArray = np.full(2, np.nan)

    def forecast_times_s(self, start_s: float, newest_capture_s: float) -> FloatArray:
        """Knot times plus the delays of pan and of tilt; then the same plus the low-pass's lag; shape (4 K,).

        The eyes' times follow, see `Chain.eye_times_s`.
        """
        times_s = [start_s + ahead_s + self._knots_s for ahead_s in self._ahead_s]
        return np.concatenate([*times_s, self._chain.eye_times_s(start_s)])

    def plan(self, situation: Situation) -> Plan:
        """See `gazempc.controllers.controller.Controller.plan`."""
        means_base_m, limits = situation.forecast.means_base_m, self.neck.command_limits
        count = 4 * self._knots_s.size
        angles = self._chain.head_rad(situation, means_base_m[:count]).reshape(2, 2, -1, 2)
        body = None
        if self._chain.body is not None:
            body = self._chain.body.commands_rad(situation, angles[0, 0, :, 0])
            for each, ahead_s in zip(angles[:, 0], self._ahead_s[::2], strict=True):
                each[:, 0] -= self._chain.body.angles_rad(situation, body, ahead_s + self._knots_s)
        angles = np.clip(angles, limits.position_min_rad[:2], limits.position_max_rad[:2])
        demanded, later = (np.stack([each[0, :, 0], each[1, :, 1]], axis=-1) for each in angles)
        head = self._low_pass(demanded, later, situation.command.position_rad[:2])
        if situation.held:  # a held eye does not compensate the low-pass
            head = np.where(self._chain.eyes_held(situation), demanded, head)
        position = self._chain.with_eyes(situation, means_base_m[count:], head, body)
        velocity = slopes(position, self.neck.control_period_s)
        rest, events = np.zeros_like(position), self._chain.events(position[0])
        return Plan(situation.start_s, self.neck.control_period_s, position, velocity, rest, events)

    def _low_pass(self, demanded_rad: FloatArray, later_rad: FloatArray, command_rad: FloatArray) -> FloatArray:
        if self._keep == 0.0:
            return demanded_rad
        # Initial state: the command; later: the first knot of the last plan.
        now = np.where(np.isnan(self._smoothed_rad), command_rad, self._smoothed_rad)
        smoothed = self._weights @ later_rad + np.outer(self._kept, now)
        if self._eyes_reach_rad is not None:
            near = np.clip(smoothed, demanded_rad - self._eyes_reach_rad, demanded_rad + self._eyes_reach_rad)
            self._smoothed_rad = near[0]
            return near
        acquires = np.abs(demanded_rad[0] - command_rad) > _ACQUISITION_RAD
        self._smoothed_rad = np.where(acquires, np.nan, smoothed[0])
        return np.where(acquires, demanded_rad, smoothed)
