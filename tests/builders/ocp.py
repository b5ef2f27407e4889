"""The quadratic program of one joint of the reference neck, and an oracle for it."""

from functools import lru_cache

import casadi as ca
import numpy as np

from gazempc.controllers.mpc import problem
from gazempc.controllers.mpc.condense import AxisModel
from gazempc.controllers.mpc.ocp import AxisOcp
from gazempc.neck.spec import load_neck

NECK = load_neck("reference")
N = 20
T = 0.1
LIMITS = np.array([1.4, 2.5, 1.4, 2.5, 15.0])
ZETA = 0.8  # damping ratio, so that the velocity has a weight
DAMPING = 4 * ZETA**2 - 2
JERK_TIME_S = 0.025
QUIET = {"print_time": 0, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-11, "error_on_fail": True}
QUIET["ipopt.bound_relax_factor"] = 0.0


def shot(o, neck, index, state, jerks):
    """Multiple shooting: defects of the states at the ends of the steps, and the value of each symbol.

    `state` has shape (5, 1 + n), the first column is z0; the dynamics are applied tick by tick.
    """
    defects, accelerations = [], []
    for k, length in enumerate(np.array(o.h).ravel().astype(int)):
        z = state[:, k]
        for _ in range(length * neck.servo_ticks_per_plan):
            z, acceleration = problem.servo(neck, index, z, jerks[k])
        defects.append(state[:, k + 1] - z)
        accelerations.append(acceleration)
    ends = {name: state[i, 1:].T for i, name in enumerate(problem.STATE)}
    return ca.vertcat(*defects), ends | {"a": ca.vertcat(*accelerations), "j": jerks}


@lru_cache
def ipopt_of(neck, index, lengths, tuning, soft, terms=(), rows=()):
    """IPOPT on the uncondensed statement: a state for each step, limits as rows, slacks if soft."""
    o, n = problem.Trajectory(neck, index, lengths), len(lengths)
    z, j, slack = ca.SX.sym("Z", 5, 1 + n), ca.SX.sym("J", n), None
    most = problem.jerk_max_rad_s3(neck, index)
    defects, values = shot(o, neck, index, z, most * j)
    kept = ca.vertcat(problem.limits(o, neck, index), *(row(o) for row in rows))
    cost = problem.cost(o, tuning) + sum(term(o) for term in terms)
    names = list(values)
    cost, kept = ca.substitute([cost, kept], [getattr(o, name) for name in names], [values[name] for name in names])
    m = kept.shape[0]
    slack = ca.SX.sym("s", m)
    cost += problem.SLACK_PRICE_RAD2 * ca.sum1(slack)
    unknowns, free = ca.veccat(z[:, 1:], j, slack), (5 * n, n, m)
    program = {"x": unknowns, "p": ca.veccat(z[:, 0], o.r), "f": 1e4 * cost}
    program["g"] = ca.vertcat(defects, kept - slack, kept + slack)
    solver = ca.nlpsol("solver", "ipopt", program, QUIET)
    upper = np.repeat([np.inf, 1.0, np.inf if soft else 0.0], free)
    lower = np.repeat([-np.inf, -1.0, 0.0], free)
    bounds = {"lbx": lower, "ubx": upper}
    bounds |= {
        "lbg": np.repeat([0.0, -np.inf, -1.0], (5 * n, m, m)),
        "ubg": np.repeat([0.0, 1.0, np.inf], (5 * n, m, m)),
    }

    def solve(z0, reference):
        # Feasible from any start: a slack of ten satisfies every limit.
        start = np.repeat([0.0, 0.0, 10.0 if soft else 0.0], free)
        found = np.asarray(solver(x0=start, p=np.concatenate([z0, reference]), **bounds)["x"]).ravel()
        return found[: 5 * n].reshape(n, 5).T, found[5 * n : 6 * n]

    return solve


def ipopt(steps, smoothing, soft):
    """The pan of the reference neck over equal steps."""
    return ipopt_of(NECK, 0, (1,) * steps, problem.Tuning(smoothing, ZETA), soft)


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
    """A joint with equal steps of one control period, a knot at each."""
    return AxisModel(NECK, index, (1,) * steps, steps)


MODEL = even(N)
OCP = AxisOcp(MODEL, problem.Tuning(T, ZETA))


# The shipped horizon.
LONG = AxisOcp(even(40), problem.Tuning(0.085, ZETA))
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
