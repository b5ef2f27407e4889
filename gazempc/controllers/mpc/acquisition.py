"""Acquisition of a person far off the gaze: when a joint acquires, and the bounds that prevent overshoot."""

from __future__ import annotations

import math

import numpy as np

from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# Larger than any tracking error: the acquisition's program takes over.
ACQUIRED_FROM_RAD = math.radians(15.0)
# Acquisition ends within this, at a speed that keeps it: eye contact (Horstmann & Linke 2021, see docs/metrics.md).
CONTACT_RAD = math.radians(2.6)
# Larger than the tracking error of a walker within the response time (23 deg at 1.7 m/s, 2.5 m away, in 0.6 s): a new
# target.
FAR_RAD = math.radians(25.0)
# Damping ratio of acquisition: step overshoot 0.6 % (4.3 % with the ratio of following).
ACQUISITION_DAMPING = 0.85
_ANYWHERE_RAD = 100.0


class Acquisition:
    """Acquisition of one joint.

    Under an acceleration limit a quadratic cost overshoots: early arrival outweighs the overshoot. So the reference
    bounds the angles of a joint that acquires a distant target.

    Args:
        neck: The neck.
        index: 0 for pan, 1 for tilt.
        smoothing_time_s: T of the acquisition's program, seconds: a joint overshoots by about T times its speed.
    """

    def __init__(self, neck: NeckSpec, index: int, smoothing_time_s: float) -> None:
        limits, eyes = neck.command_limits, neck.eyes
        self._low_rad, self._high_rad = float(limits.position_min_rad[index]), float(limits.position_max_rad[index])
        self._from_rad = ACQUIRED_FROM_RAD
        if eyes is not None:  # acquisition starts beyond the range of the eyes
            eye = (eyes.pan, eyes.tilt)[index]
            self._from_rad = max(self._from_rad, math.radians(min(-eye.position_min_deg, eye.position_max_deg)))
        self._period_s, self._smoothing_time_s = neck.control_period_s, smoothing_time_s
        self.reset()

    def reset(self) -> None:
        """Leave acquisition."""
        self._on = self._far = False

    def bounds_rad(
        self, joint_rad: float, joint_rad_s: float, reference_rad: FloatArray, turning_rad_s: float
    ) -> tuple[FloatArray, FloatArray] | None:
        """Update the state of acquisition; joint and person one dead time from now.

        Args:
            joint_rad: Joint angle, radians.
            joint_rad_s: Its velocity, rad/s.
            reference_rad: Angles that look at the person from then on, shape (n,), radians.
            turning_rad_s: Initial rate of these angles, rad/s.

        Returns:
            Least and greatest angles of the joint, shape (n,) each; None outside of acquisition.
        """
        aim_rad = float(reference_rad[0])
        gap_rad = aim_rad - joint_rad
        # Rate of the tracking error.
        speed_rad_s = turning_rad_s - joint_rad_s
        # A joint at its limit has reached a target beyond it.
        off_rad = abs(min(max(aim_rad, self._low_rad), self._high_rad) - joint_rad)
        to_go_rad = max(off_rad, self._smoothing_time_s * abs(speed_rad_s))
        self._on = off_rad > self._from_rad or (self._on and to_go_rad > CONTACT_RAD)
        self._far = off_rad > (CONTACT_RAD if self._far else FAR_RAD)
        if not self._on:
            return None
        low_rad = np.full(reference_rad.size, -_ANYWHERE_RAD)
        high_rad = np.full(reference_rad.size, _ANYWHERE_RAD)
        if self._far:
            # Half a control period early: a change of the forecast before the next tick must not cause overshoot.
            before_rad = 0.5 * self._period_s * abs(speed_rad_s)
            if gap_rad > 0.0:
                high_rad = reference_rad - before_rad
            else:
                low_rad = reference_rad + before_rad
        return low_rad, high_rad
