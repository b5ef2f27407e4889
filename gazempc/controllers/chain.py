"""Redundancy resolution: distributes one gaze direction over body, head and eyes."""

from __future__ import annotations

import math

import numpy as np

from gazempc.controllers.controller import Situation
from gazempc.neck.ahead import JointAhead
from gazempc.neck.kinematics import eye_angles_rad, head_angles_rad, look_at_rad, unwrap_pan
from gazempc.neck.spec import BODY_AXIS, EYE_AXES, NeckSpec
from gazempc.types import BoolArray, FloatArray

# Best match with human gaze shifts of 20 deg (docs/eyes.md); smaller values have no further effect.
_SHARED_HEAD_TIME_S = 0.1
# Time constant of the body. A body is heavy, and people interpret a turning body as an intention.
_BODY_TIME_S = 0.5
# Bound on the head angle relative to the body, as a share of the head's range.
_HEAD_SHARE = 0.4
# Fixed-point iterations; pan and tilt are weakly coupled: the residual is below 0.01 deg.
_ITERATIONS = 3
# Share of the eyes' range that is used at steady state; the rest is a reserve for unforeseen motion.
_COMFORTABLE_SHARE = 0.8


class _PlannedJoint:
    """Prediction of one joint's angle under the commands sent, the commands committed and its plan.

    Args:
        neck: The neck.
        joint: Index of the joint in `NeckSpec.joint_names`.
        knots_s: Times of the plan's knots from its start, shape (K,), seconds.
    """

    def __init__(self, neck: NeckSpec, joint: int, knots_s: FloatArray) -> None:
        self._joint, self._axis = joint, neck.axes[joint]
        self._knots_s, self._period_s = knots_s, neck.servo_period_s
        self._motions: dict[tuple[int, bytes], JointAhead] = {}

    def angles_rad(self, situation: Situation, planned_rad: FloatArray, ahead_s: FloatArray) -> FloatArray:
        """Predicted angles of the joint; constant for a held joint.

        Args:
            situation: State of joints and commands.
            planned_rad: Commands at the knots, shape (K,), radians; the last one is held.
            ahead_s: Times from the plan's start, ascending, shape (H,), seconds; few different ones over a run.

        Returns:
            Shape (H,), radians.
        """
        joint_rad = float(situation.joint_position_rad[self._joint])
        if self._joint in situation.held:
            return np.full(ahead_s.shape, joint_rad)
        delay = len(situation.committed_rad)
        key = delay, ahead_s.tobytes()
        motion = self._motions.get(key)
        if motion is None:
            motion = JointAhead(self._axis, self._period_s, delay * self._period_s + ahead_s)
            self._motions[key] = motion
        ticks_s = self._period_s * np.arange(motion.future_needed)
        planned = np.interp(ticks_s, self._knots_s, planned_rad)
        offset_rad = float(situation.joint_offset_rad[self._joint])
        return offset_rad + motion(
            joint_rad - offset_rad,
            float(situation.joint_velocity_rad_s[self._joint]),
            situation.sent_rad[:, self._joint],
            np.concatenate((situation.committed_rad[:, self._joint], planned)),
        )


class BodyAim(_PlannedJoint):
    """Commands of the body: low-passed direction of the person, which returns the head to the middle of its range.

    Args:
        neck: A neck with a body.
        knots_s: Times of the plan's knots from its start, shape (K,), seconds.
    """

    def __init__(self, neck: NeckSpec, knots_s: FloatArray) -> None:
        super().__init__(neck, neck.joint_names.index(BODY_AXIS), knots_s)
        limits = neck.command_limits
        self._range_rad = limits.position_min_rad[self._joint], limits.position_max_rad[self._joint]
        self._head_rad = _HEAD_SHARE * max(min(-limits.position_min_rad[0], limits.position_max_rad[0]), 0.0)
        self._weights, self._kept = low_pass(math.exp(-neck.control_period_s / _BODY_TIME_S), knots_s.size)

    def commands_rad(self, situation: Situation, pan_rad: FloatArray) -> FloatArray:
        """Commands of the body at the knots, within its limits, for directions of the person: both (K,), radians."""
        smoothed = self._weights @ pan_rad + self._kept * situation.command.position_rad[self._joint]
        near = np.clip(smoothed, pan_rad - self._head_rad, pan_rad + self._head_rad)
        return np.asarray(np.clip(near, *self._range_rad))


class EyeAim:
    """Commands of the eyes for a person's forecast and a plan of the other joints.

    The delay of the eyes is shorter than that of the head. The head angle at the end of the eyes' delay is predicted
    from the commands already sent and the plan; the eyes take the residual angle, and so compensate the head's motion.

    Args:
        neck: A neck with eyes.
        knots_s: Times of the plan's knots from its start, shape (K,), seconds.
    """

    def __init__(self, neck: NeckSpec, knots_s: FloatArray) -> None:
        eyes = neck.eyes
        assert eyes is not None
        self._geometry, self._knots_s = neck.geometry, knots_s
        self._eyes = [neck.joint_names.index(name) for name in EYE_AXES]
        self._others = [_PlannedJoint(neck, i, knots_s) for i in range(neck.joints) if i not in self._eyes]
        # The zero-order hold adds a mean delay of half a servo period.
        ahead_s = (neck.dead_time_s + neck.servo_lag_s)[self._eyes] + 0.5 * neck.servo_period_s
        # A single set of times if both joints of the eyes have the same delay.
        self._ahead_s: FloatArray = np.unique(ahead_s)
        self._at = [int(np.flatnonzero(self._ahead_s == each)[0]) for each in ahead_s]
        # The eyes' share of pan and tilt, for angles below and above the head's rest position.
        eye_share = 1.0 - np.array(
            [[eyes.head_share_pan, eyes.head_share_down], [eyes.head_share_pan, eyes.head_share_up]]
        )
        self._eye_share = eye_share if eye_share.any() else None
        limits = neck.command_limits
        self._low_rad, self._high_rad = limits.position_min_rad[self._eyes], limits.position_max_rad[self._eyes]
        self._rest_rad = neck.rest_rad[:2]
        self._reach_rad = _COMFORTABLE_SHARE * np.maximum(np.minimum(-self._low_rad, self._high_rad), 0.0)

    def forecast_times_s(self, start_s: float) -> FloatArray:
        """Times for which the eyes need the forecast, shape (H,), seconds: H is K, or 2 K."""
        return (start_s + self._knots_s + self._ahead_s[:, None]).ravel()

    def commands_rad(self, situation: Situation, means_base_m: FloatArray, planned_rad: FloatArray) -> FloatArray:
        """Commands of the eyes at the knots.

        Args:
            situation: State of joints and commands.
            means_base_m: The forecast for `forecast_times_s`, shape (H, 3), metres.
            planned_rad: Commands of the other joints at the knots, in their order, shape (K, N - 2), radians.

        Returns:
            Commands of the eyes, within their limits, shape (K, 2), radians.
        """
        # Eyes with a delay not shorter than the head's need angles beyond the plan: its last command is held there.
        others_rad = np.array(
            [
                [
                    joint.angles_rad(situation, commands, ahead_s + self._knots_s)
                    for joint, commands in zip(self._others, planned_rad.T, strict=True)
                ]
                for ahead_s in self._ahead_s
            ]
        ).transpose(0, 2, 1)
        heads_rad = head_angles_rad(others_rad)
        angles = eye_angles_rad(self._geometry, heads_rad, means_base_m.reshape(-1, self._knots_s.size, 3))
        wanted = np.stack([angles[self._at[0], :, 0], angles[self._at[1], :, 1]], axis=-1)
        # A held eye is commanded the full angle: its motion is detected as soon as it is released.
        zero_rad = np.where(self.held(situation), self._held_rad(situation), situation.joint_offset_rad[self._eyes])
        return np.clip(wanted - zero_rad, self._low_rad, self._high_rad)

    def head_share_rad(self, head_rad: FloatArray) -> FloatArray:
        """Head angles after subtraction of the eyes' share of the direction.

        Args:
            head_rad: Pan and tilt of a head whose eyes look straight ahead, in the base frame, shape (H, 2), radians.

        Returns:
            Shape (H, 2), radians; `head_rad` itself if the eyes have no share.
        """
        if self._eye_share is None:
            return head_rad
        away_rad = head_rad - self._rest_rad
        eyes_rad = np.where(away_rad < 0.0, self._eye_share[0], self._eye_share[1]) * away_rad
        return np.asarray(head_rad - np.clip(eyes_rad, -self._reach_rad, self._reach_rad))

    def head_without_rad(self, situation: Situation, means_base_m: FloatArray, head_rad: FloatArray) -> FloatArray:
        """Head angles that aim held eyes at the person, by fixed-point iteration; arguments as in `head_share_rad`."""
        held_rad = self._held_rad(situation)
        if not held_rad.any():
            return head_rad
        for _ in range(_ITERATIONS):
            head_rad = head_rad + eye_angles_rad(self._geometry, head_rad, means_base_m) - held_rad
        return head_rad

    def held(self, situation: Situation) -> BoolArray:
        """Whether the eyes' pan and tilt are held, shape (2,)."""
        return np.isin(self._eyes, situation.held)

    def at_limit(self, commands_rad: FloatArray) -> bool:
        """Whether an eye is at its position limit in the commands of all joints, shape (N,), radians."""
        eyes_rad = commands_rad[self._eyes]
        return bool((eyes_rad <= self._low_rad).any() or (eyes_rad >= self._high_rad).any())

    def _held_rad(self, situation: Situation) -> FloatArray:
        # Angles of held eyes; 0 for the others.
        return np.where(self.held(situation), situation.joint_position_rad[self._eyes], 0.0)


class Chain:
    """Cascade that distributes the gaze over the joints of a neck, slowest first: body, head, eyes.

    Each joint takes the residual of the slower joints, predicted for the end of its own delay. The identity for a neck
    without body and eyes.

    Args:
        neck: The neck.
        knots_s: Times of the plan's knots from its start, shape (K,), seconds.
    """

    def __init__(self, neck: NeckSpec, knots_s: FloatArray) -> None:
        self.body = None if neck.body is None else BodyAim(neck, knots_s)
        self.eyes = None if neck.eyes is None else EyeAim(neck, knots_s)
        limits = neck.command_limits
        # Joints that turn the gaze sideways, without the eyes; with a body (the last joint) the sum of head and body.
        turning = [0] if self.body is None else [0, -1]
        low_rad, high_rad = limits.position_min_rad[turning], limits.position_max_rad[turning]
        self._reach_rad = float(low_rad.sum()), float(high_rad.sum())
        self._geometry = neck.geometry

    def eye_times_s(self, start_s: float) -> FloatArray:
        """Times for which the eyes need the forecast, shape (H,), seconds; empty without eyes."""
        return np.empty(0) if self.eyes is None else self.eyes.forecast_times_s(start_s)

    def head_rad(self, situation: Situation, means_base_m: FloatArray) -> FloatArray:
        """Reference pan and tilt of the head in the base frame.

        The pan is unwrapped to the turn of the present command, if that is within reach. With eyes, the head takes its
        share of the angle to the person; with held eyes, the whole angle.

        Args:
            situation: State of joints and commands.
            means_base_m: Positions of the person, shape (H, 3), metres.

        Returns:
            Shape (H, 2), radians.
        """
        command_rad = situation.command.position_rad
        # With a body (the last joint): the sum of head and body.
        pan_rad = float(command_rad[0] if self.body is None else command_rad[0] + command_rad[-1])
        head_rad = unwrap_pan(look_at_rad(self._geometry, means_base_m), pan_rad, *self._reach_rad)
        if self.eyes is None:
            return head_rad
        if not situation.held:
            return self.eyes.head_share_rad(head_rad)
        return self.eyes.head_without_rad(situation, means_base_m, head_rad)

    def eyes_held(self, situation: Situation) -> BoolArray:
        """Whether the eye of pan and of tilt is held, so that the head takes its share, shape (2,)."""
        return np.zeros(2, dtype=np.bool_) if self.eyes is None else self.eyes.held(situation)

    def events(self, commands_rad: FloatArray) -> tuple[str, ...]:
        """Events of a plan, from its first commands, shape (N,), radians."""
        return ("eyes_at_limit",) if self.eyes is not None and self.eyes.at_limit(commands_rad) else ()

    def with_eyes(
        self, situation: Situation, means_base_m: FloatArray, head_rad: FloatArray, body_rad: FloatArray | None
    ) -> FloatArray:
        """Commands of all joints at the knots.

        Args:
            situation: State of joints and commands.
            means_base_m: The forecast for `eye_times_s`, shape (H, 3), metres.
            head_rad: Commands of pan and tilt, shape (K, 2), radians.
            body_rad: Commands of the body, shape (K,), radians; None without one.

        Returns:
            Shape (K, N), radians.
        """
        body = [] if body_rad is None else [body_rad[:, None]]
        others = np.concatenate([head_rad, *body], axis=1)
        if self.eyes is None:
            return others
        return np.concatenate([head_rad, self.eyes.commands_rad(situation, means_base_m, others), *body], axis=1)


def head_time_s(neck: NeckSpec, given_s: float | None, usual_s: float) -> float:
    """Smoothing time of the head of a neck with eyes.

    Args:
        neck: The neck.
        given_s: Setting of the user, seconds; None for the default of the neck.
        usual_s: Default for a head without a share for the eyes, seconds.

    Returns:
        Seconds.
    """
    if given_s is not None:
        return given_s
    shares = neck.eyes is not None and min(neck.eyes.head_share_pan, neck.eyes.head_share_up) < 1.0
    return _SHARED_HEAD_TIME_S if shares else usual_s


def low_pass(keep: float, knots: int) -> tuple[FloatArray, FloatArray]:
    """First-order low-pass over the knots: forced response, shape (K, K), and free response, shape (K,).

    Args:
        keep: Discrete pole, 0 to 1.
        knots: K.
    """
    age = np.subtract.outer(np.arange(knots), np.arange(knots))
    return (1.0 - keep) * np.tril(keep ** np.maximum(age, 0)), keep ** np.arange(1.0, knots + 1.0)


def slopes(position: FloatArray, step_s: float) -> FloatArray:
    """Derivative by central differences, as numpy.gradient, which takes several times as long.

    Args:
        position: Rows at equal steps, shape (K, N), K at least 2.
        step_s: Time between rows, seconds.

    Returns:
        Shape (K, N), per second.
    """
    slope = np.empty_like(position)
    slope[1:-1] = (position[2:] - position[:-2]) / (2.0 * step_s)
    slope[0] = (position[1] - position[0]) / step_s
    slope[-1] = (position[-1] - position[-2]) / step_s
    return slope
