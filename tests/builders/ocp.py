"""The quadratic program of one joint of the reference neck, and an oracle for it."""

from functools import lru_cache

import casadi as ca
import numpy as np

from gazempc.controllers.mpc.axis_model import AxisModel
from gazempc.controllers.mpc.ocp import AxisOcp
from gazempc.neck.spec import load_neck

NECK = load_neck("reference")
N = 20
T = 0.1
LIMITS = np.array([1.4, 2.5, 1.4, 2.5, 15.0])
ROUNDED = 1.0 - 1e-6  # the share of the limits that is used
ZETA = 0.8  # damping ratio, so that the velocity has a weight
DAMPING = 4 * ZETA**2 - 2
JERK_TIME_S = 0.025


def following(z, jerk):
    """State at the end of a control period: command integrated, servo's differential equation solved by Taylor."""
    h, wn, zeta = NECK.servo_period_s, NECK.pan.natural_frequency_rad_s, NECK.pan.damping_ratio
    q, v, u, du, ddu = (z[i] for i in range(5))
    for _ in range(NECK.servo_ticks_per_plan):
        u, du, ddu = (
            u + h * du + h**2 / 2 * ddu + h**3 / 6 * jerk,
            du + h * ddu + h**2 / 2 * jerk,
            ddu + h * jerk,
        )
        # Derivatives of the error e = q - u with the command held: e^(k+2) = -wn^2 e^(k) - 2 zeta wn e^(k+1).
        error = [q - u, v]
        for k in range(8):
            error.append(-(wn**2) * error[k] - 2 * zeta * wn * error[k + 1])
        factorial = np.cumprod([1.0, *range(1, 9)])
        q = u + sum(error[k] * h**k / factorial[k] for k in range(9))
        v = sum(error[k + 1] * h**k / factorial[k] for k in range(9))
    return ca.vertcat(q, v, u, du, ddu)


@lru_cache
def ipopt(steps, smoothing, soft):
    """The problem as it is written down: a state for each step, limits as such, slacks if soft."""
    limits, wn, zeta = NECK.command_limits, NECK.pan.natural_frequency_rad_s, NECK.pan.damping_ratio
    z0, state, x = ca.MX.sym("z0", 5), ca.MX.sym("z", 5, steps), ca.MX.sym("x", steps)
    reference, rate, slack = ca.MX.sym("r", steps), ca.MX.sym("r'", steps), ca.MX.sym("s", 3, steps)
    cost, defects, rows = 0, [], []
    for k in range(steps):
        jerk = ROUNDED * float(limits.jerk_max_rad_s3[0]) * x[k]
        defects.append(state[:, k] - following(state[:, k - 1] if k else z0, jerk))
        q, v, u, du, ddu = (state[i, k] for i in range(5))
        acceleration = wn**2 * (u - q) - 2 * zeta * wn * v
        cost += (q - reference[k]) ** 2 + smoothing**4 * acceleration**2 + (JERK_TIME_S**3 * jerk) ** 2
        cost += DAMPING * smoothing**2 * (v - rate[k]) ** 2
        low, high = limits.position_min_rad[0], limits.position_max_rad[0]
        middle, reach = (low + high) / 2, (high - low) / 2
        fast, hard = ROUNDED * limits.velocity_max_rad_s[0], ROUNDED * limits.acceleration_max_rad_s2[0]
        for i, share in enumerate(((u - middle) / reach, (du + H / 2 * ddu) / fast, ddu / hard)):
            rows += [share - slack[i, k], -share - slack[i, k]]
    cost += PENALTY * ca.sum(ca.sum(slack))
    unknowns = ca.veccat(state, x, slack)
    problem = {"x": unknowns, "p": ca.veccat(z0, reference, rate), "f": 1e4 * cost, "g": ca.vertcat(*defects, *rows)}
    quiet = {"print_time": 0, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-11, "error_on_fail": True}
    quiet["ipopt.bound_relax_factor"] = 0.0
    solver = ca.nlpsol("solver", "ipopt", problem, quiet)
    bound = np.concatenate([np.full(5 * steps, np.inf), np.ones(steps), np.full(3 * steps, np.inf if soft else 0.0)])
    lowest = np.concatenate([-bound[: 6 * steps], np.zeros(3 * steps)])
    least = np.concatenate([np.zeros(5 * steps), np.full(6 * steps, -np.inf)])
    most = np.concatenate([np.zeros(5 * steps), np.ones(6 * steps)])

    def solve(z0, reference):
        # Whatever the start: with a slack of ten everything is within its limits.
        start = np.concatenate([np.zeros(6 * steps), np.full(3 * steps, 10.0 if soft else 0.0)])
        found = solver(
            x0=start,
            p=np.concatenate([z0, reference, np.gradient(reference, H)]),
            lbx=lowest,
            ubx=bound,
            lbg=least,
            ubg=most,
        )["x"]
        found = np.asarray(found).ravel()
        return found[: 5 * steps].reshape(steps, 5).T, found[5 * steps : 6 * steps]

    return solve


def least_squares(state, reference, zeta=ZETA):
    """The problem without limits as |C x - d|^2: C and d; without a damping ratio velocities have no weight."""
    p, share = MODEL, np.sqrt(DAMPING) * T if zeta else 0.0
    velocity = reference[1:] - reference[:-1]
    rate = np.concatenate([velocity[:1], (velocity[1:] + velocity[:-1]) / 2, velocity[-1:]]) / H
    C = np.vstack(
        [
            p.joint[:, 6:],
            share * p.velocity[:, 6:],
            T**2 * p.acceleration[:, 6:],
            JERK_TIME_S**3 * MODEL.jerk_scale * np.eye(N),
        ]
    )
    d = [
        reference - p.joint[:, :5] @ state,
        share * (rate - p.velocity[:, :5] @ state),
        -(T**2) * p.acceleration[:, :5] @ state,
        np.zeros(N),
    ]
    return C, np.concatenate(d)


def even(steps, index=0):
    """A joint whose steps are all of one control period, with a knot at each."""
    return AxisModel(NECK, index, (1,) * steps, steps)


MODEL = even(N)
OCP = AxisOcp(MODEL, T, ZETA)


# As long as the one that ships.
LONG = AxisOcp(even(40), 0.085, ZETA)
PENALTY = 300.0
H = NECK.control_period_s


def joint(ocp, state, scaled_jerk):
    return ocp.model.joint @ np.concatenate([state, [1.0], scaled_jerk])


def parameters(state, reference):
    return np.concatenate([state, [1.0], reference])


def random_states(count, scale, steps, seed=0):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        state = scale * rng.uniform(-1, 1, 5) * LIMITS
        yield state, scale * rng.uniform(-2, 2) + rng.uniform(-3, 3) * np.linspace(0, 0.4, steps)


MOVING = np.array([0.02, 0.1, 0.05, 0.1, 0.5])
