"""The command and the joint over the horizon, rolled out once into linear maps of the initial state and the jerks."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from gazempc.neck.servo import servo_model, zero_order_hold
from gazempc.neck.spec import Axis, NeckSpec
from gazempc.types import FloatArray

# Joint angle and velocity; command, its velocity and acceleration.
STATE = ("q", "v", "u", "du", "ddu")


@dataclass(frozen=True)
class Prediction:
    """Linear maps from [initial state; scaled jerks] to the ends of steps.

    There are n jerks, one for each step of the command; the joint is looked at after N control periods.

    Attributes:
        joint_from_state: Joint angles, shape (N, 5).
        joint_from_jerk: Shape (N, n).
        velocity_from_state: Joint velocities, shape (N, 5).
        velocity_from_jerk: Shape (N, n).
        acceleration_from_state: Joint accelerations, shape (N, 5).
        acceleration_from_jerk: Shape (N, n).
        command_from_state: Command position, velocity, acceleration, stacked, shape (3 n, 5).
        command_from_jerk: Shape (3 n, n).
    """

    joint_from_state: FloatArray
    joint_from_jerk: FloatArray
    velocity_from_state: FloatArray
    velocity_from_jerk: FloatArray
    acceleration_from_state: FloatArray
    acceleration_from_jerk: FloatArray
    command_from_state: FloatArray
    command_from_jerk: FloatArray


def servo_step(axis: Axis, period_s: float) -> tuple[FloatArray, FloatArray]:
    """One servo period of command and joint: ``z+ = M z + m j``.

    Args:
        axis: The joint.
        period_s: Servo period, seconds.

    Returns:
        M, shape (5, 5), and m, shape (5,).
    """
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


def predict(axis: Axis, neck: NeckSpec, steps: int, jerk_scale: float, first_parts: int = 1) -> Prediction:
    """Build the condensed prediction: roll the model symbolically, then ask it for unit vectors.

    Args:
        axis: The joint.
        neck: The neck, for its rates.
        steps: Length of the horizon N, control periods.
        jerk_scale: Jerk that a scaled jerk of 1 stands for, rad/s^3.
        first_parts: The first control period is cut into so many steps of the command, all others are one each;
            divides the servo ticks of a control period.

    Returns:
        The maps.
    """
    M, m = servo_step(axis, neck.servo_period_s)
    per_plan = neck.servo_ticks_per_plan
    ticks = [per_plan // first_parts] * first_parts + [per_plan] * (steps - 1)
    over = {}
    for count in set(ticks):
        powers = [np.linalg.matrix_power(M, i) for i in range(count + 1)]
        over[count] = ca.DM(powers[count]), ca.DM(np.sum(powers[:count], axis=0) @ m)
    rates = servo_model(axis)[1]
    z0 = ca.SX.sym("z0", len(STATE))
    jerk = ca.SX.sym("jerk", len(ticks))
    z = z0
    joint, velocity, acceleration, commands = [], [], [], []
    for k, count in enumerate(ticks):
        by_state, by_jerk = over[count]
        z = ca.mtimes(by_state, z) + by_jerk * (jerk_scale * jerk[k])
        commands.append(z[2:])
        if k >= first_parts - 1:
            joint.append(z[0])
            velocity.append(z[1])
            acceleration.append(rates[0] * z[0] + rates[1] * z[1] + rates[2] * z[2])
    stacked = ca.vertcat(*[c[i] for i in range(3) for c in commands])
    whole = [ca.vertcat(*joint), ca.vertcat(*velocity), ca.vertcat(*acceleration), stacked]
    roll = ca.Function("roll", [z0, jerk], whole)
    # It is linear: the columns of the maps are the answers to unit vectors. This takes a fifth of a Jacobian's time.
    by_state = roll.map(len(STATE))(np.eye(len(STATE)), np.zeros((len(ticks), 1)))
    by_jerk = roll.map(len(ticks))(np.zeros((len(STATE), 1)), np.eye(len(ticks)))
    return Prediction(*(np.array(part) for pair in zip(by_state, by_jerk, strict=True) for part in pair))
