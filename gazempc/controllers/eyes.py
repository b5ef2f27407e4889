"""Eyes: they look at the person from where the head will be when they answer. The head does without held ones."""

from __future__ import annotations

import numpy as np

from gazempc.controllers.controller import Situation
from gazempc.neck.ahead import JointAhead
from gazempc.neck.kinematics import eye_angles_rad, head_angles_rad
from gazempc.neck.spec import EYE_AXES, NeckSpec
from gazempc.types import BoolArray, FloatArray

# Pan and tilt of the head hardly depend on each other: three turns leave less than a hundredth of a degree.
_TURNS = 3


# Eyes stay for long within this share of their range; the rest is for what comes unforeseen.
_COMFORTABLE_SHARE = 0.8


class EyeAim:
    """Commands of the eyes for a person's forecast and a plan of the other joints.

    An eye answers long before the head. What the head does until then is known: it follows commands already sent, and
    then its plan. The eyes are turned by what is left. So they cancel the head's own motion as well.

    Args:
        neck: A neck with eyes.
        knots_s: Times of the plan's knots from its start, shape (K,), seconds.
    """

    def __init__(self, neck: NeckSpec, knots_s: FloatArray) -> None:
        if neck.eyes is None:
            raise ValueError(f"neck {neck.name!r} has no eyes")
        self._neck, self._knots_s = neck, knots_s
        self._eyes = [neck.joint_names.index(name) for name in EYE_AXES]
        self._others = [i for i in range(neck.joints) if i not in self._eyes]
        # A command is held for a servo period, so on average it is half of that late.
        ahead_s = (neck.dead_time_s + neck.servo_lag_s)[self._eyes] + 0.5 * neck.servo_period_s
        # One set of times where both joints of the eyes are as fast.
        self._ahead_s: FloatArray = np.unique(ahead_s)
        self._at = [int(np.flatnonzero(self._ahead_s == each)[0]) for each in ahead_s]
        eyes = neck.eyes
        # What is left to the eyes of a pan and a tilt below and above where the head rests.
        left_over = 1.0 - np.array(
            [[eyes.head_share_pan, eyes.head_share_down], [eyes.head_share_pan, eyes.head_share_up]]
        )
        self._left_over = left_over if left_over.any() else None
        limits = neck.command_limits
        range_rad = np.minimum(-limits.position_min_rad[self._eyes], limits.position_max_rad[self._eyes])
        self._rest_rad, self._reach_rad = neck.rest_rad[:2], _COMFORTABLE_SHARE * range_rad
        self._motions: dict[int, list[JointAhead]] = {}

    def forecast_times_s(self, start_s: float) -> FloatArray:
        """Times for which the eyes need the forecast, shape (H,), seconds: H is K, or 2 K."""
        return (start_s + self._knots_s + self._ahead_s[:, None]).ravel()

    def commands_rad(self, situation: Situation, means_base_m: FloatArray, planned_rad: FloatArray) -> FloatArray:
        """Commands of the eyes at the knots.

        Args:
            situation: What is known.
            means_base_m: The forecast for `forecast_times_s`, shape (H, 3), metres.
            planned_rad: Commands of the other joints at the knots, in their order, shape (K, N - 2), radians.

        Returns:
            Commands of the eyes, within their limits, shape (K, 2), radians.
        """
        period_s, knots = self._neck.servo_period_s, self._knots_s.size
        committed = situation.committed_rad
        delay = len(committed)
        others_rad = np.empty((len(self._ahead_s), knots, len(self._others)))
        for column, joint in enumerate(self._others):
            if joint in situation.held:
                others_rad[:, :, column] = situation.joint_position_rad[joint]
                continue
            offset_rad = float(situation.joint_offset_rad[joint])
            motions = self._joint_ahead(joint, delay)
            # Eyes that answer no faster than the head need to know it beyond the plan: the last command is held.
            ticks = period_s * np.arange(max(motion.future_needed for motion in motions))
            future = np.concatenate((committed[:, joint], np.interp(ticks, self._knots_s, planned_rad[:, column])))
            for at, motion in enumerate(motions):
                others_rad[at, :, column] = offset_rad + motion(
                    float(situation.joint_position_rad[joint]) - offset_rad,
                    float(situation.joint_velocity_rad_s[joint]),
                    situation.sent_rad[:, joint],
                    future,
                )
        heads_rad = head_angles_rad(others_rad)
        angles = eye_angles_rad(self._neck.geometry, heads_rad, means_base_m.reshape(-1, knots, 3))
        limits = self._neck.command_limits
        wanted = np.stack([angles[self._at[0], :, 0], angles[self._at[1], :, 1]], axis=-1)
        zero_rad = situation.joint_offset_rad[self._eyes]
        if situation.held:
            # An eye that is held is sent what it would have to do from its middle. So it is seen to move once it can.
            zero_rad = np.where(self.held(situation), self._held_rad(situation), zero_rad)
        wanted -= zero_rad
        return np.clip(wanted, limits.position_min_rad[self._eyes], limits.position_max_rad[self._eyes])

    def head_share_rad(self, head_rad: FloatArray) -> FloatArray:
        """Angles of a head that leaves the neck's share of a direction to the eyes.

        Args:
            head_rad: Pan and tilt of a head whose eyes look straight ahead, in the base frame, shape (H, 2), radians.

        Returns:
            Shape (H, 2), radians; `head_rad` itself where the head does all.
        """
        if self._left_over is None:
            return head_rad
        away_rad = head_rad - self._rest_rad
        eyes_rad = np.where(away_rad < 0.0, self._left_over[0], self._left_over[1]) * away_rad
        shared_rad: FloatArray = head_rad - np.clip(eyes_rad, -self._reach_rad, self._reach_rad)
        return shared_rad

    def head_without_rad(self, situation: Situation, means_base_m: FloatArray, head_rad: FloatArray) -> FloatArray:
        """Angles of the head that look at the person past eyes that are held.

        Args:
            situation: What is known.
            means_base_m: Where the person is, shape (H, 3), metres.
            head_rad: Pan and tilt of a head whose eyes look straight ahead, in the base frame, shape (H, 2), radians.

        Returns:
            Shape (H, 2), radians; `head_rad` itself if no eye is held.
        """
        held_rad = self._held_rad(situation)
        if not held_rad.any():
            return head_rad
        for _ in range(_TURNS):
            head_rad = head_rad + eye_angles_rad(self._neck.geometry, head_rad, means_base_m) - held_rad
        return head_rad

    def held(self, situation: Situation) -> BoolArray:
        """Which of the eyes' pan and tilt are held, shape (2,)."""
        return np.isin(self._eyes, situation.held)

    def at_limit(self, commands_rad: FloatArray) -> bool:
        """Whether commands of all joints, shape (N,), radians, have an eye at its limit."""
        limits, eyes = self._neck.command_limits, commands_rad[self._eyes]
        low, high = limits.position_min_rad[self._eyes], limits.position_max_rad[self._eyes]
        return bool((eyes <= low).any() or (eyes >= high).any())

    def _held_rad(self, situation: Situation) -> FloatArray:
        # Where eyes are held; 0 of those that answer.
        if not situation.held:
            return np.zeros(2)
        return np.where(self.held(situation), situation.joint_position_rad[self._eyes], 0.0)

    def _joint_ahead(self, joint: int, delay: int) -> list[JointAhead]:
        # The delay of a loop never changes.
        motions = self._motions.get(joint)
        if motions is None:
            period_s, axis = self._neck.servo_period_s, self._neck.axes[joint]
            ahead = [delay * period_s + each_s + self._knots_s for each_s in self._ahead_s]
            self._motions[joint] = motions = [JointAhead(axis, period_s, each) for each in ahead]
        return motions
