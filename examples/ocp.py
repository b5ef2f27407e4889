"""The MPC in forty lines of CasADi: its optimal control problem in Opti, solved by IPOPT, compared with `gz.Mpc`.

A joint at rest has a step reference of 12 deg after one dead time. Compare `gazempc/controllers/mpc/problem.py`.
"""

import casadi as ca
import numpy as np
from scipy.linalg import expm

import gazempc as gz

neck = gz.load_neck("reference")
wn, zeta, period_s, h = 12.0, 0.9, 0.02, 0.005  # servo; control and servo period
T, T_j, rho = 0.12, 0.025, 300.0  # smoothing time, time constant of the jerk weight, slack penalty
steps = [1, 1, 1, 1, 1, 1, 1, 1, 2, 2, 3, 3, 4, 5, 6, 7]  # step lengths in control periods (move blocking)
limits = neck.command_limits  # limits of the command; the servo overshoots by 0.15 %


def follow(z, j, seconds):
    """State z = [q, v, u, du, ddu] of joint and command after constant jerk j of the command; zero-order hold over h."""
    servo = ca.DM(expm(h * np.array([[0.0, 1.0, 0.0], [-(wn**2), -2.0 * zeta * wn, wn**2], [0.0, 0.0, 0.0]])))
    for _ in range(round(seconds / h)):
        u, du, ddu = z[2] + h * z[3] + h**2 / 2 * z[4] + h**3 / 6 * j, z[3] + h * z[4] + h**2 / 2 * j, z[4] + h * j
        z = ca.vertcat((servo @ ca.vertcat(z[:2], u))[:2], u, du, ddu)
    return z


def solve(z0, r):
    """Optimal jerks, and z at the ends of the steps, from z0 for the reference r, shape (16,), radians."""
    opti, cost = ca.Opti(), 0.0
    j, slack, z = opti.variable(len(steps)), opti.variable(3, len(steps)), [ca.DM(z0)]
    for k, length in enumerate(steps):
        after = steps[min(k + 1, len(steps) - 1)]
        z.append(follow(z[-1], j[k], length * period_s))
        q, v, u, du, ddu = (z[-1][i] for i in range(5))
        a = wn**2 * (u - q) - 2 * zeta * wn * v
        cost += (length + after) / 2 * ((q - r[k]) ** 2 + T**4 * a**2) + T_j**6 * length * j[k] ** 2
        middle = du + after * period_s / 2 * ddu
        ratios = (
            u / limits.position_max_rad[0],
            middle / limits.velocity_max_rad_s[0],
            ddu / limits.acceleration_max_rad_s2[0],
        )
        opti.subject_to(opti.bounded(-1 - slack[:, k], ca.vertcat(*ratios), 1 + slack[:, k]))
    opti.subject_to(opti.bounded(-limits.jerk_max_rad_s3[0], j, limits.jerk_max_rad_s3[0]))
    opti.subject_to(ca.vec(slack) >= 0)
    opti.minimize(1e4 * (cost + rho * ca.sum1(ca.vec(slack))))
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "tol": 1e-10})
    found = opti.solve()
    return found.value(j), found.value(ca.horzcat(*z))


if __name__ == "__main__":
    reference = np.full(len(steps), np.radians(12.0))
    jerks, motion = solve(np.zeros(5), reference)
    plan = gz.Mpc(neck).ocps[0].solve(np.zeros(5), reference)
    print("command after 0.1 s, 0.16 s and 0.2 s [deg]")
    print("IPOPT ", *(f"{np.degrees(motion[2, k]):.3f}" for k in (5, 8, 9)))
    print("gz.Mpc", *(f"{np.degrees(plan.command[0, k - 1]):.3f}" for k in (5, 8, 10)))

# It prints:
# command after 0.1 s, 0.16 s and 0.2 s [deg]
# IPOPT  2.451 6.988 9.761
# gz.Mpc 2.451 6.988 9.761
