"""A body that turns under the neck: it brings the head back to the middle of its range, slowly."""

from __future__ import annotations

import math

import numpy as np

from gazempc.controllers.controller import Situation
from gazempc.neck.ahead import JointAhead
from gazempc.neck.spec import BODY_AXIS, NeckSpec
from gazempc.types import FloatArray

# Time constant with which the body follows the gaze. A body is heavy, and people read a turning body as an intention.
_BODY_TIME_S = 0.5
# The body stays so near the gaze that the head needs no more than this share of its range.
_HEAD_SHARE = 0.4


class BodyAim:
    """Commands of the body for a person's direction.

    Args:
        neck: A neck with a body.
        knots_s: Times of the plan's knots from its start, shape (K,), seconds.
    """

    def __init__(self, neck: NeckSpec, knots_s: FloatArray) -> None:
        self._knots_s, self._period_s = knots_s, neck.servo_period_s
        self._joint = neck.joint_names.index(BODY_AXIS)
        self._axis = neck.axes[self._joint]
        limits = neck.command_limits
        self._range_rad = limits.position_min_rad[self._joint], limits.position_max_rad[self._joint]
        self._head_rad = _HEAD_SHARE * min(-limits.position_min_rad[0], limits.position_max_rad[0])
        #: Least and greatest pan of head and body together, radians.
        self.reach_rad = (
            float(limits.position_min_rad[0] + self._range_rad[0]),
            float(limits.position_max_rad[0] + self._range_rad[1]),
        )
        keep = math.exp(-neck.control_period_s / _BODY_TIME_S)
        age = np.subtract.outer(np.arange(knots_s.size), np.arange(knots_s.size))
        self._weights: FloatArray = (1.0 - keep) * np.tril(keep ** np.maximum(age, 0))
        self._kept: FloatArray = keep ** np.arange(1.0, knots_s.size + 1.0)
        self._motions: dict[tuple[int, bytes], JointAhead] = {}

    def gaze_command_rad(self, command_rad: FloatArray) -> float:
        """Pan of head and body together that joints' commands, shape (N,), radians, stand for."""
        return float(command_rad[0] + command_rad[self._joint])

    def commands_rad(self, situation: Situation, pan_rad: FloatArray) -> FloatArray:
        """Commands of the body at the knots.

        Args:
            situation: What is known.
            pan_rad: Directions of the person at the knots, shape (K,), radians.

        Returns:
            Commands within the limits, shape (K,), radians.
        """
        smoothed = self._weights @ pan_rad + self._kept * situation.command.position_rad[self._joint]
        near = np.clip(smoothed, pan_rad - self._head_rad, pan_rad + self._head_rad)
        commands_rad: FloatArray = np.clip(near, *self._range_rad)
        return commands_rad

    def angles_rad(self, situation: Situation, planned_rad: FloatArray, ahead_s: FloatArray) -> FloatArray:
        """Where the body will be.

        Args:
            situation: What is known.
            planned_rad: Commands at the knots, shape (K,), radians; the last one is held.
            ahead_s: Times from the plan's start, ascending, shape (H,), seconds; the same ones at every call.

        Returns:
            Angles, shape (H,), radians.
        """
        if self._joint in situation.held:
            return np.full(ahead_s.shape, situation.joint_position_rad[self._joint])
        delay = len(situation.committed_rad)
        key = delay, ahead_s.tobytes()
        motion = self._motions.get(key)
        if motion is None:
            motion = JointAhead(self._axis, self._period_s, delay * self._period_s + ahead_s)
            self._motions[key] = motion
        ticks = self._period_s * np.arange(motion.future_needed)
        future = np.concatenate((situation.committed_rad[:, self._joint], np.interp(ticks, self._knots_s, planned_rad)))
        offset_rad = float(situation.joint_offset_rad[self._joint])
        return offset_rad + motion(
            float(situation.joint_position_rad[self._joint]) - offset_rad,
            float(situation.joint_velocity_rad_s[self._joint]),
            situation.sent_rad[:, self._joint],
            future,
        )
