"""The optimal control problem of one joint. The page *Controllers* derives it.

The state is z = [q, v, u, du, ddu]: joint angle and velocity; command, its velocity and acceleration. The input is the
command's jerk j, constant over each of n steps (move blocking). A command acts on the joint one dead time after it is
sent, so joint and reference are shifted by the dead time: q_k is the angle at t_k + dead time, r_k the look-at angle of
the head position forecast for that time. The initial state z_0 is the joint state at t_0 + dead time, predicted from
the commands already sent (`gazempc.neck.ahead`), and the last command before the plan.

    minimise    sum_k w_k ((q_k - r_k)^2 + d T^2 (v_k - dr_k)^2 + T^4 a_k^2) + T_j^6 sum_k h_k j_k^2 + rho sum(s)
    subject to  z_k+1 = servo(z_k, j_k),   |j_k| <= j_max,   |row| <= 1 + s for each row of `limits`,   s >= 0

With a zone in place of a point, e_k is the distance of q_k from it, and the joint comes to rest inside:

    minimise    sum_k w_k (e_k^2 + d T^2 v_k^2 + T^4 a_k^2) + T_j^6 sum_k h_k j_k^2 + rho sum(s)
    subject to  ...,   low_k - e_k <= q_k <= high_k + e_k
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from gazempc.neck.servo import servo_model, zero_order_hold
from gazempc.neck.spec import NeckSpec

STATE = ("q", "v", "u", "du", "ddu")
# T_j, seconds: weight of the command's jerk, which suppresses jerk above the bandwidth of the joint.
JERK_TIME_S = 0.025
# rho, rad^2 for a slack of one limit: an exact penalty, larger than any gaze error that a violation could save.
SLACK_PRICE_RAD2 = 300.0
# The unit of the bounds of acquisition: in so large a unit, each limit of the neck takes precedence over them.
PASSING_UNIT_RAD = 150.0
# Share of the limits that a plan uses, with room for rounding in the smoother.
SHARE_OF_LIMITS = 1.0 - 1e-6
# Natural frequency times servo period. Under the zero-order hold a joint above this value accelerates in pulses, so its
# cost is on the mean over a servo period. For slower joints both are nearly equal.
FAST = 0.15
# Damping ratio at which d is zero: the step response if only error and acceleration have a cost.
PLAIN_DAMPING = math.sqrt(0.5)


@dataclass(frozen=True)
class Tuning:
    """T, `smoothing_time_s`, seconds, and the damping ratio zeta of the step response.

    With `zone`, the bounds of `passing` are a zone in which the joint comes to rest, in place of the point r.
    """

    smoothing_time_s: float
    damping_ratio: float = PLAIN_DAMPING
    zone: bool = False

    @property
    def d(self) -> float:
        """Weight of the velocity error: 4 zeta^2 - 2."""
        return max(4.0 * self.damping_ratio**2 - 2.0, 0.0)

    @property
    def passing_unit_rad(self) -> float:
        """Unit of the bounds of `passing`."""
        return 1.0 if self.zone else PASSING_UNIT_RAD


class Trajectory:
    """The quantities of the problem, as CasADi symbols of shape (n, 1): values at the ends t_k of the n steps.

    Args:
        neck: The neck.
        index: Index of the joint in `NeckSpec.joint_names`.
        lengths: Length of each step, control periods.

    Attributes:
        joint: Name of the joint, such as ``pan``.
        q, v, a: Joint angle, velocity and acceleration one dead time after t_k: rad, rad/s, rad/s^2. The angle is
            without the joint's steady-state error. The acceleration of a fast joint is the mean over a servo period.
        u, du, ddu: Command, its velocity and its acceleration at t_k: rad, rad/s, rad/s^2.
        j: Jerk of the command during step k, rad/s^3.
        r, dr: Reference angle one dead time after t_k, rad, and its central differences, rad/s.
        t: t_k from the last command before the plan (`Situation.start_s` minus a servo period), seconds; a number
            (`casadi.DM`), as are h and w.
        h: Length of step k, control periods.
        w: Half of the steps before and after t_k, control periods.
    """

    def __init__(self, neck: NeckSpec, index: int, lengths: tuple[int, ...]) -> None:
        n = len(lengths)
        self.joint = neck.joint_names[index]
        self.q, self.v, self.a, self.u, self.du, self.ddu, self.j, self.r = (
            ca.SX.sym(name, n) for name in ("q", "v", "a", "u", "du", "ddu", "j", "r")
        )
        each = np.array(lengths, dtype=np.float64)
        ends_s, following = np.cumsum(neck.control_period_s * each), np.append(each[1:], each[-1])
        self.t, self.h, self.w = ca.DM(ends_s), ca.DM(each), ca.DM(0.5 * (each + following))
        self.dr = ca.mtimes(ca.DM(np.gradient(np.eye(n), ends_s, axis=0)), self.r)


def servo(neck: NeckSpec, index: int, z: Any, j: Any) -> tuple[Any, Any]:
    """The dynamics over one servo period with zero-order hold: z+ and the joint's acceleration a."""
    h, axis = neck.servo_period_s, neck.axes[index]
    q, v, u, du, ddu = ca.vertsplit(z)
    u, du, ddu = u + h * du + h**2 / 2 * ddu + h**3 / 6 * j, du + h * ddu + h**2 / 2 * j, ddu + h * j
    before = v
    q, v = ca.vertsplit(ca.mtimes(ca.DM(zero_order_hold(axis, h)), ca.vertcat(q, v, u)))
    a = acceleration(neck, index, q, v, u)
    if axis.natural_frequency_rad_s * h > FAST:
        a = (v - before) / h
    return ca.vertcat(q, v, u, du, ddu), a


def acceleration(neck: NeckSpec, index: int, q: Any, v: Any, u: Any) -> Any:
    """The joint's acceleration after its dead time: wn^2 (u - q) - 2 zeta wn v."""
    return ca.mtimes(ca.DM(servo_model(neck.axes[index])[1:]), ca.vertcat(q, v, u))


def cost(o: Trajectory, tuning: Tuning) -> Any:
    """The cost without the slacks, rad^2 times control periods."""
    T, d = tuning.smoothing_time_s, tuning.d
    if tuning.zone:  # the squared distance from the zone is the penalty of the rows of `passing`
        error = d * T**2 * o.v**2 + T**4 * o.a**2
    else:
        error = (o.q - o.r) ** 2 + d * T**2 * (o.v - o.dr) ** 2 + T**4 * o.a**2
    return ca.dot(o.w, error) + JERK_TIME_S**6 * ca.dot(o.h, o.j**2)


def jerk_max_rad_s3(neck: NeckSpec, index: int) -> float:
    """Bound of the input, j_max."""
    return SHARE_OF_LIMITS * float(neck.command_limits.jerk_max_rad_s3[index])


def limits(o: Trajectory, neck: NeckSpec, index: int) -> Any:
    """Normalised limits of the command, shape (3 n, 1), soft within +-1: position, velocity, acceleration.

    Over a step the velocity is a parabola in the convex hull of its three Bezier control points. du_k + ddu_k h_k+1 / 2
    is the middle one of step k + 1, and du_k lies between two middle ones: the limit holds between the ends of steps.
    """
    most, next_s = neck.command_limits, neck.control_period_s * ca.vertcat(o.h[1:], o.h[-1])
    low, high = most.position_min_rad[index], most.position_max_rad[index]
    return ca.vertcat(
        (o.u - 0.5 * (low + high)) / (0.5 * (high - low)),
        (o.du + 0.5 * next_s * o.ddu) / (SHARE_OF_LIMITS * most.velocity_max_rad_s[index]),
        o.ddu / (SHARE_OF_LIMITS * most.acceleration_max_rad_s2[index]),
    )


def passing(o: Trajectory, tuning: Tuning) -> Any:
    """Normalised joint angles, shape (n, 1), softly bounded: `gazempc.controllers.mpc.acquisition`, or the zone."""
    return o.q / tuning.passing_unit_rad
