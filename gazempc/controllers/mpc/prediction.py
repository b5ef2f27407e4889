"""The command and the joint over the horizon, rolled out once into linear maps of the initial state and the jerks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gazempc.neck.servo import servo_model, zero_order_hold
from gazempc.neck.spec import Axis, NeckSpec
from gazempc.types import FloatArray

# Joint angle and velocity; command, its velocity and acceleration.
STATE = ("q", "v", "u", "du", "ddu")
# The command is held between servo ticks. A joint with more than this, natural frequency times servo period, answers
# each of its steps with an acceleration that says nothing of the motion: the mean over a servo period counts. Slower
# ones hardly tell the two apart.
_FAST = 0.15


@dataclass(frozen=True)
class Prediction:
    """Linear maps from [initial state; scaled jerks] to the ends of the n steps, and to the plan's K knots.

    Attributes:
        joint: Joint angles, shape (n, 5 + n).
        velocity: Joint velocities, shape (n, 5 + n).
        acceleration: Joint accelerations, shape (n, 5 + n); of a fast joint the means over the last servo period.
        command: Command position, velocity and acceleration, stacked, shape (3 n, 5 + n).
        knots: The same at the end of each of the first K control periods, shape (3 K, 5 + n).
    """

    joint: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    command: FloatArray
    knots: FloatArray


def servo_step(axis: Axis, period_s: float) -> tuple[FloatArray, FloatArray]:
    """M, shape (5, 5), and m, shape (5,), of a servo period, seconds, of command and joint: ``z+ = M z + m j``."""
    h = period_s
    chain = np.array([[1.0, h, h**2 / 2.0], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
    jerk_in = np.array([h**3 / 6.0, h**2 / 2.0, h])
    servo = zero_order_hold(axis, h)
    M = np.zeros((5, 5))
    M[2:, 2:] = chain
    M[:2, :2] = servo[:, :2]
    M[:2, 2:] = np.outer(servo[:, 2], chain[0])
    m = np.concatenate([servo[:, 2] * jerk_in[0], jerk_in])
    return M, m


def predict(axis: Axis, neck: NeckSpec, lengths: Sequence[int], jerk_scale: float, knots: int) -> Prediction:
    """Roll the model over the horizon, for every start and all jerks at once.

    Args:
        axis: The joint.
        neck: The neck, for its rates.
        lengths: Length of each step, in which the jerk is constant, control periods; shape (n,).
        jerk_scale: Jerk that a scaled jerk of 1 stands for, rad/s^3.
        knots: K, not more than the sum of the lengths.

    Returns:
        The maps.
    """
    M, m = servo_step(axis, neck.servo_period_s)
    over_period, by_jerk = np.eye(5), np.zeros(5)
    for _ in range(neck.servo_ticks_per_plan):
        before_last, before_by_jerk = over_period[1], by_jerk[1]
        over_period, by_jerk = M @ over_period, M @ by_jerk + m * jerk_scale
    faster, faster_by_jerk = over_period[1] - before_last, by_jerk[1] - before_by_jerk
    z = np.eye(5, 5 + len(lengths))
    at_knots: list[FloatArray] = []
    at_ends: list[FloatArray] = []
    gains: list[FloatArray] = []
    for k, length in enumerate(lengths):
        for _ in range(length):
            gained = faster @ z
            gained[5 + k] += faster_by_jerk
            z = over_period @ z
            z[:, 5 + k] += by_jerk
            if len(at_knots) < knots:
                at_knots.append(z[2:])
        at_ends.append(z)
        gains.append(gained)
    ends = np.array(at_ends)
    acceleration = np.einsum("i,kij->kj", servo_model(axis)[1], ends[:, :3])
    if axis.natural_frequency_rad_s * neck.servo_period_s > _FAST:
        acceleration = np.array(gains) / neck.servo_period_s
    return Prediction(
        joint=ends[:, 0],
        velocity=ends[:, 1],
        acceleration=acceleration,
        command=np.concatenate(ends[:, 2:].transpose(1, 0, 2)),
        knots=np.concatenate(np.array(at_knots).transpose(1, 0, 2)),
    )
