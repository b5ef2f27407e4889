"""The quadratic program of one joint against independent solvers and transcriptions."""

from functools import lru_cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import lsq_linear

from gazempc.controllers.mpc.axis_model import AxisModel
from gazempc.controllers.mpc.kkt import kkt_residual
from gazempc.controllers.mpc.ocp import AxisOcp, SolverFailedError
from gazempc.controllers.mpc.prediction import predict
from gazempc.controllers.mpc.qp import Daqp, Piqp, QpData, QpResult
from gazempc.neck.spec import load_neck

NECK = load_neck("reference")
N = 20
T = 0.1
LIMITS = np.array([1.4, 2.5, 1.4, 2.5, 15.0])
MODEL = AxisModel(NECK, 0, N)
OCP = AxisOcp(MODEL, T)
# As long as the one that ships.
LONG = AxisOcp(AxisModel(NECK, 0, 40), 0.085)
ROUNDED = 1.0 - 1e-6  # the share of the limits that is used
PENALTY = 300.0
DAMPING = 4 * 0.8**2 - 2  # weight of the velocity: damping ratio 0.8
JERK_TIME_S = 0.025
H = NECK.control_period_s


# ---------------------------------------------------------------- oracle: IPOPT on the definition


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


def least_squares(state, reference):
    """The problem without limits as |C x - d|^2: C and d."""
    p, share = MODEL.prediction, np.sqrt(DAMPING) * T
    velocity = reference[1:] - reference[:-1]
    rate = np.concatenate([velocity[:1], (velocity[1:] + velocity[:-1]) / 2, velocity[-1:]]) / H
    C = np.vstack(
        [
            p.joint_from_jerk,
            share * p.velocity_from_jerk,
            T**2 * p.acceleration_from_jerk,
            JERK_TIME_S**3 * MODEL.jerk_scale * np.eye(N),
        ]
    )
    d = [
        reference - p.joint_from_state @ state,
        share * (rate - p.velocity_from_state @ state),
        -(T**2) * p.acceleration_from_state @ state,
        np.zeros(N),
    ]
    return C, np.concatenate(d)


def joint(ocp, state, scaled_jerk):
    return ocp.model.prediction.joint_from_state @ state + ocp.model.prediction.joint_from_jerk @ scaled_jerk


def random_states(count, scale, steps, seed=0):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        state = scale * rng.uniform(-1, 1, 5) * LIMITS
        yield state, scale * rng.uniform(-2, 2) + rng.uniform(-3, 3) * np.linspace(0, 0.4, steps)


MOVING = np.array([0.02, 0.1, 0.05, 0.1, 0.5])
SLOW = np.array([0.02, 0.05, 0.0275, 0.05, 0.0])


@pytest.mark.parametrize(
    ("state", "from_rad", "to_rad", "binding"),
    [
        (SLOW, 0.021, 0.06, ""),
        (MOVING, 0.1, 0.2, "jerk acceleration"),
        (MOVING, 0.3, 0.9, "jerk acceleration velocity"),
        (np.array([1.2, 0.5, 1.25, 0.3, 0.0]), 1.3, 1.4, "jerk acceleration position"),
    ],
)
def test_solution_is_that_of_ipopt(state, from_rad, to_rad, binding):
    """The farther the target the more limits bind."""
    steps = LONG.model.steps
    reference = np.linspace(from_rad, to_rad, steps)
    ours = LONG.solve(state, reference)
    z, x = ipopt(steps, 0.085, soft=False)(state, reference)
    limits = NECK.command_limits
    reached = {
        "jerk": np.abs(x).max(),
        "position": np.abs(z[2]).max() / limits.position_max_rad[0],
        "velocity": np.abs(z[3] + H / 2 * z[4]).max() / limits.velocity_max_rad_s[0],
        "acceleration": np.abs(z[4]).max() / limits.acceleration_max_rad_s2[0],
    }
    assert {name for name, share in reached.items() if share > 0.9999} == set(binding.split())
    assert ours.solver == ("daqp" if binding else "gain")
    assert ours.softened == 0.0
    assert joint(LONG, state, ours.scaled_jerk) == pytest.approx(z[0], abs=1e-5)
    assert ours.command[0] == pytest.approx(z[2], abs=1e-5)
    assert ours.command[1] == pytest.approx(z[3], abs=1e-4)
    # The first jerk is the one that is executed.
    assert ours.scaled_jerk[0] == pytest.approx(x[0], abs=1e-4)


def test_unconstrained_solution_is_least_squares():
    """Where no limit binds; solved here by scipy from the definition."""
    state, reference = np.zeros(5), 0.001 * np.sin(np.linspace(0, 1, N))
    best = lsq_linear(*least_squares(state, reference))
    ours = OCP.solve(state, reference)
    assert ours.solver == "gain"
    assert ours.softened == 0.0
    assert joint(OCP, state, ours.scaled_jerk) == pytest.approx(joint(OCP, state, best.x), abs=1e-10)
    assert ours.scaled_jerk == pytest.approx(best.x, abs=1e-8)


@pytest.mark.parametrize("first_parts", [1, 2, 4])
def test_prediction_is_the_continuous_time_model(first_parts):
    """The rolled maps against scipy's ODE solver with the command held between servo ticks."""
    p = predict(NECK.pan, NECK, 5, 300.0, first_parts)
    rng = np.random.default_rng(3)
    state, jerk = rng.uniform(-1, 1, 5) * [0.5, 1, 0.5, 1, 5], rng.uniform(-1, 1, 4 + first_parts)
    h, wn, zeta = NECK.servo_period_s, 12.0, 0.9
    q, v, u, du, ddu = state
    angles, velocities, accelerations, commands = [], [], [], []
    for step, j in enumerate(300.0 * jerk):
        for _ in range(4 // first_parts if step < first_parts else 4):
            u, du, ddu = u + h * du + h**2 / 2 * ddu + h**3 / 6 * j, du + h * ddu + h**2 / 2 * j, ddu + h * j
            held = u
            tick = solve_ivp(
                lambda _, y, held=held: [y[1], wn**2 * (held - y[0]) - 2 * zeta * wn * y[1]],
                (0, h),
                [q, v],
                rtol=1e-11,
                atol=1e-13,
            )
            q, v = tick.y[:, -1]
        commands.append((u, du, ddu))
        if step >= first_parts - 1:
            angles.append(q)
            velocities.append(v)
            accelerations.append(wn**2 * (u - q) - 2 * zeta * wn * v)
    assert p.joint_from_state @ state + p.joint_from_jerk @ jerk == pytest.approx(angles, abs=1e-9)
    assert p.velocity_from_state @ state + p.velocity_from_jerk @ jerk == pytest.approx(velocities, abs=1e-8)
    got = p.acceleration_from_state @ state + p.acceleration_from_jerk @ jerk
    assert got == pytest.approx(accelerations, abs=1e-6)
    got = p.command_from_state @ state + p.command_from_jerk @ jerk
    assert got == pytest.approx(np.transpose(commands).ravel(), abs=1e-9)


def test_the_command_is_that_of_the_jerks():
    """What is returned is the motion that the returned jerks make; also where the position limits are lopsided."""
    tilt, fine = AxisOcp(AxisModel(NECK, 1, N), T), AxisModel(NECK, 0, N, first_parts=4)
    for ocp in (OCP, tilt, AxisOcp(fine, T), AxisOcp(fine, T, catching_up=True)):
        for scale in (0.02, 1.0, 2.0):
            for state, reference in random_states(10, scale, N):
                solution, (u, du, ddu) = ocp.solve(state, reference), state[2:]
                assert np.abs(solution.scaled_jerk).max() <= 1.0
                jerks = ocp.model.jerk_scale * solution.scaled_jerk
                for k, (j, h) in enumerate(zip(jerks, H * ocp.model.shares, strict=True)):
                    u, du, ddu = u + h * du + h**2 / 2 * ddu + h**3 / 6 * j, du + h * ddu + h**2 / 2 * j, ddu + h * j
                    assert solution.command[:, k] == pytest.approx([u, du, ddu], abs=1e-8)


def test_the_velocity_keeps_its_limit_between_steps_of_different_length():
    """From just below the limit and still speeding up, a jerk at the wrong step's end would carry it past."""
    ocp = AxisOcp(AxisModel(NECK, 0, N, first_parts=4), T)
    lengths_s, limit = H * ocp.model.shares, NECK.command_limits.velocity_max_rad_s[0]
    bound, reached = 0, 0.0
    for acceleration in np.linspace(0.0, 9.0, 37):
        for speed in np.linspace(0.92, 1.0, 9) * limit:
            state = np.array([0.0, speed, 0.0, speed, acceleration])
            solution = ocp.solve(state, np.linspace(0.5, 1.2, N))
            # What the state itself says of the first step cannot be helped.
            if solution.softened or speed + acceleration * lengths_s[0] / 2 > limit:
                continue
            _, v, a = np.column_stack([state[2:], solution.command])
            shares = np.linspace(0.0, 1.0, 21)[:, None]
            slope = np.diff(a) / lengths_s
            between = v[:-1] + shares * lengths_s * a[:-1] + 0.5 * (shares * lengths_s) ** 2 * slope
            assert between[:, 1:].max() <= limit * (1 + 1e-5)
            bound += 1
            reached = max(reached, between[:, 1:].max())
    assert bound > 50
    assert reached > limit * (1 - 1e-3)


def test_finer_first_steps_reach_what_coarse_ones_cannot():
    """With the first control period in parts the cost is never higher, and lower where limits switch the jerk."""
    coarse, fine = AxisOcp(MODEL, T), AxisOcp(AxisModel(NECK, 0, N, first_parts=4), T)
    gained = []
    for state, reference in random_states(40, 0.5, N, seed=5):
        costs = []
        for ocp in (coarse, fine):
            g, _, _ = ocp.program(ocp.parameters(state, reference))
            x = ocp.solve(state, reference).scaled_jerk
            costs.append(0.5 * x @ ocp.data.h @ x + g @ x)
        gained.append((costs[0] - costs[1]) / abs(costs[0]))
    assert min(gained) > -1e-9
    assert max(gained) > 1e-4


# ---------------------------------------------------------------- does a limit bind?


def within_limits(model, command, scaled_jerk, room):
    low, high = NECK.command_limits.position_min_rad[0], NECK.command_limits.position_max_rad[0]
    shares = [
        (command[0] - (low + high) / 2) / ((high - low) / 2),
        (command[1] + H / 2 * command[2]) / NECK.command_limits.velocity_max_rad_s[0],
        command[2] / NECK.command_limits.acceleration_max_rad_s2[0],
        scaled_jerk,
    ]
    return all(np.abs(share).max() <= 1.0 + room for share in shares)


def test_the_gain_is_used_exactly_where_no_limit_binds():
    """The best motion without limits, by the normal equations: taken if it keeps them all, else DAQP is asked."""
    p, asked = MODEL.prediction, {"gain": 0, "daqp": 0}
    rng = np.random.default_rng(6)
    for _ in range(400):
        near = rng.uniform(0, 0.9) * rng.choice([-1, 1])
        state = np.array([near, 0, near, 0, 0]) + 10 ** rng.uniform(-4, -0.5) * rng.uniform(-1, 1, 5) * LIMITS
        reference = state[0] + state[1] * 0.02 * np.arange(1, N + 1) + 10 ** rng.uniform(-4, 0) * rng.uniform(-1, 1)
        solution = OCP.solve(state, reference)
        free = np.linalg.lstsq(*least_squares(state, reference), rcond=None)[0]
        command = (p.command_from_state @ state + p.command_from_jerk @ free).reshape(3, N)
        asked[solution.solver] += 1
        if solution.solver == "gain":
            assert within_limits(MODEL, solution.command, solution.scaled_jerk, 1e-8)
        else:
            assert not within_limits(MODEL, command, free, -1e-5)
    assert min(asked.values()) > 50


@pytest.mark.parametrize("share", [0.9999, 1.0001])
def test_the_gain_is_used_to_the_very_limit(share):
    """From rest all is in proportion to the reference: scaled until the hardest limit is just kept, or just left."""
    reference = np.linspace(0.0, 1.0, N) ** 2
    free = np.linalg.lstsq(*least_squares(np.zeros(5), reference), rcond=None)[0]
    u, du, ddu = (MODEL.prediction.command_from_jerk @ free).reshape(3, N)
    limits, moved = NECK.command_limits, du + H / 2 * ddu
    most = max(
        np.abs(free).max(),
        np.abs(u).max() / limits.position_max_rad[0],
        np.abs(moved).max() / (ROUNDED * limits.velocity_max_rad_s[0]),
        np.abs(ddu).max() / (ROUNDED * limits.acceleration_max_rad_s2[0]),
    )
    assert OCP.solve(np.zeros(5), share / most * reference).solver == ("gain" if share < 1 else "daqp")


@settings(max_examples=100)
@given(st.tuples(*[st.floats(-1, 1)] * 5), st.floats(-1, 1), st.floats(-4, -1.5))
def test_where_no_limit_binds_daqp_finds_what_the_gain_finds(unit_state, change, exponent):
    state = 10**exponent * np.array(unit_state) * LIMITS
    reference = np.full(N, 10**exponent * change)
    solution = OCP.solve(state, reference)
    g, lower, upper = OCP.program(OCP.parameters(state, reference))
    asked = Daqp(OCP.data).solve(g, lower, upper)
    assert asked.status == "solved"
    assert joint(OCP, state, solution.scaled_jerk) == pytest.approx(joint(OCP, state, asked.x), abs=1e-9)
    assert kkt_residual(OCP.data, g, lower, upper, solution.scaled_jerk).stationarity < 1e-9


# ---------------------------------------------------------------- soft limits


def test_soft_limits_are_exact_when_they_can_be_kept():
    """A target far beyond the position limit presses hardest against it, and does not bend it."""
    state, reference = np.array([1.2, 0, 1.2, 0, 0.0]), np.full(40, 3.0)
    solution = LONG.solve(state, reference)
    z, _ = ipopt(40, 0.085, soft=False)(state, reference)
    assert solution.softened == 0.0
    assert solution.command[0].max() == pytest.approx(NECK.command_limits.position_max_rad[0], abs=1e-6)
    assert joint(LONG, state, solution.scaled_jerk) == pytest.approx(z[0], abs=1e-5)


@pytest.mark.parametrize(
    ("state", "target_rad"),
    [
        ([1.5, 0.0, 1.5, 0.0, 0.0], 0.0),
        ([0.0, 3.5, 0.0, 3.5, 0.0], 1.0),
        ([0.0, 0.0, 0.0, 0.0, 25.0], 0.5),
        ([1.2, 2.0, 1.3, 2.4, 10.0], 0.5),
        ([-1.6, -3.0, -1.6, -3.0, -20.0], -1.0),
    ],
)
def test_a_start_outside_the_limits_is_solved_as_by_ipopt_with_slacks(state, target_rad):
    state, reference = np.array(state), np.full(N, target_rad)
    z, _ = ipopt(N, T, soft=True)(state, reference)
    low, high = NECK.command_limits.position_min_rad[0], NECK.command_limits.position_max_rad[0]
    shares = [
        (z[2] - (low + high) / 2) / ((high - low) / 2),
        (z[3] + H / 2 * z[4]) / NECK.command_limits.velocity_max_rad_s[0],
        z[4] / NECK.command_limits.acceleration_max_rad_s2[0],
    ]
    softened = np.abs(shares).max() - 1.0
    assert softened > 0.001
    for maker in (Daqp, Piqp):
        solution = AxisOcp(MODEL, T, solvers=(maker,)).solve(state, reference)
        assert solution.solver == maker.name
        assert solution.softened == pytest.approx(softened, abs=1e-5)
        assert joint(OCP, state, solution.scaled_jerk) == pytest.approx(z[0], abs=1e-5)


# ---------------------------------------------------------------- catching up

CATCH_UP = AxisOcp(LONG.model, 0.085, catching_up=True)
FAR_RAD = 100.0


def not_past(reference, below):
    bounds = np.full((2, len(reference)), [[-FAR_RAD], [FAR_RAD]])
    bounds[int(below)] = reference
    return bounds


@pytest.mark.parametrize("below", [True, False])
def test_a_joint_that_catches_up_does_not_pass_the_person(below):
    """From rest 0.9 rad away; without the bound it passes by more than a degree."""
    side = 1.0 if below else -1.0
    reference = side * np.linspace(0.7, 0.9, LONG.model.steps)
    state = np.array([-side * 0.2, 0.0, -side * 0.2, 0.0, 0.0])
    plain = LONG.solve(state, reference)
    assert np.degrees(np.max(side * (joint(LONG, state, plain.scaled_jerk) - reference))) > 1.0
    bounds = not_past(reference, below)
    ours = CATCH_UP.solve(state, reference, bounds)
    angles = joint(CATCH_UP, state, ours.scaled_jerk)
    assert np.max(side * (angles - reference)) < 1e-3
    # It comes as soon, but for the last moments.
    early = slice(0, 20)
    assert angles[early] == pytest.approx(joint(LONG, state, plain.scaled_jerk)[early], abs=0.03)
    assert ours.softened == 0.0
    assert within_limits(CATCH_UP.model, ours.command, ours.scaled_jerk, 1e-5)
    g, lower, upper = CATCH_UP.program(CATCH_UP.parameters(state, reference), bounds)
    # In units of 150 rad the usual tolerance of being on a bound would be nearly a degree.
    x = ours.scaled_jerk[np.unique(CATCH_UP.variable_of_step, return_index=True)[1]]
    assert kkt_residual(CATCH_UP.data, g, lower, upper, x, tolerance=1e-6).stationarity < 1e-4
    other = AxisOcp(LONG.model, 0.085, catching_up=True, solvers=(Piqp,)).solve(state, reference, bounds)
    assert joint(CATCH_UP, state, other.scaled_jerk) == pytest.approx(angles, abs=1e-3)


def test_limits_come_before_not_passing():
    """Too fast to stop before somebody near: the person is passed, no limit is left."""
    state, reference = np.array([0.0, 2.4, 0.2, 2.4, 0.0]), np.full(LONG.model.steps, 0.1)
    ours = CATCH_UP.solve(state, reference, not_past(reference, below=True))
    assert joint(CATCH_UP, state, ours.scaled_jerk).max() > 0.15
    assert ours.softened == 0.0
    assert within_limits(CATCH_UP.model, ours.command, ours.scaled_jerk, 1e-5)


def test_bounds_out_of_reach_change_nothing():
    """But for late jerks that are the same in three steps on end."""
    bounds = np.full((2, LONG.model.steps), [[-FAR_RAD], [FAR_RAD]])
    solvers = set()
    for state, reference in random_states(40, 0.3, LONG.model.steps, seed=3):
        ours, plain = CATCH_UP.solve(state, reference, bounds), LONG.solve(state, reference)
        solvers.add(ours.solver)
        assert joint(LONG, state, ours.scaled_jerk) == pytest.approx(joint(LONG, state, plain.scaled_jerk), abs=5e-3)
    slow = np.linspace(0.0, 0.002, LONG.model.steps)
    assert CATCH_UP.solve(np.zeros(5), slow, bounds).solver == "gain"
    # A bound that binds is noticed where no limit does.
    assert CATCH_UP.solve(np.zeros(5), slow, not_past(0.5 * slow, below=True)).solver == "daqp"


# ---------------------------------------------------------------- solvers


@pytest.mark.parametrize("ocp", [OCP, LONG], ids=["20", "40"])
@pytest.mark.parametrize("scale", [0.3, 0.8, 1.5])
def test_answers_of_both_solvers_are_optimal(ocp, scale):
    """Apart from any solver; up to 1.5 times the limits, where most starts make them soft."""
    daqp, piqp = Daqp(ocp.data), Piqp(ocp.data)
    checked, softened = 0, 0
    for state, reference in random_states(60, scale, ocp.model.steps, seed=1):
        g, lower, upper = ocp.program(ocp.parameters(state, reference))
        answers = [daqp.solve(g, lower, upper), piqp.solve(g, lower, upper)]
        assert answers[1].status == "solved"
        if answers[0].status != "solved":
            continue
        for answer, most in zip(answers, (1e-6, 3e-4), strict=True):
            residual = kkt_residual(ocp.data, g, lower, upper, answer.x)
            assert residual.stationarity < most
            assert residual.bound < 1e-5
            # The check would notice: the first jerk a hundredth off.
            off = answer.x.copy()
            off[0] -= 0.01 * np.sign(off[0])
            assert kkt_residual(ocp.data, g, lower, upper, off).stationarity > 1e-3
        first, second = (joint(ocp, state, answer.x) for answer in answers)
        assert first == pytest.approx(second, abs=2e-5)
        checked += 1
        softened += ocp.solve(state, reference).softened > 0
    assert checked > 50
    assert (softened > 20) == (scale > 1)


@pytest.mark.parametrize(
    ("state", "target_rad"),
    [
        ([-1.2, 5.4, -2.1, -2.8, -9.7], -0.9),
        ([0.0, 0.0, 2.0, 0.0, 0.0], 0.0),
        ([0.0, 0.0, 3.0, -2.0, -10.0], 2.0),
    ],
)
def test_softened_solutions_of_both_solvers_agree(state, target_rad):
    """Far outside: any curvature of a solver's penalty would show."""
    state = np.array(state)
    reference = np.full(LONG.model.steps, target_rad)
    first, second = (AxisOcp(LONG.model, 0.085, solvers=(maker,)).solve(state, reference) for maker in (Daqp, Piqp))
    assert first.softened > 0.1
    assert joint(LONG, state, first.scaled_jerk) == pytest.approx(joint(LONG, state, second.scaled_jerk), abs=1e-5)


@pytest.mark.parametrize(("pull", "best"), [(0.25, 0.25), (2.0, 0.5), (2.75, 0.75), (9.0, 1.0)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_residual_of_a_program_solved_by_hand(pull, best, side):
    """(x - pull)^2 / 2 with |x| <= 1/2 at 2 a unit: inside, held by a multiplier up to 2, beyond, at the bound."""
    data = QpData(h=np.eye(1), a=np.eye(1), penalty=2.0)
    for x in (0.0, 0.25, 0.5, 0.75, 1.0):
        residual = kkt_residual(data, np.array([-side * pull]), np.array([-0.5]), np.array([0.5]), np.array([side * x]))
        assert (residual.stationarity < 1e-12) == (x == best)


def test_the_residual_of_what_is_not_finite_is_nan():
    g, lower, upper = OCP.program(OCP.parameters(np.zeros(5), np.zeros(N)))
    residual = kkt_residual(OCP.data, g, lower, upper, np.full(N, np.nan))
    assert np.isnan(residual.stationarity)
    assert np.isnan(residual.bound)


def test_the_residual_says_by_how_much_a_bound_is_left():
    g, lower, upper = OCP.program(OCP.parameters(np.zeros(5), np.zeros(N)))
    assert kkt_residual(OCP.data, g, lower, upper, np.full(N, -1.25)).bound == pytest.approx(0.25)
    assert kkt_residual(OCP.data, g, lower, upper, np.full(N, -1.0)).bound == 0.0


@settings(max_examples=200)
@given(st.tuples(*[st.floats(-1, 1)] * 5), st.floats(-6, 6), st.floats(-4, 4), st.sampled_from([0.3, 1.0, 3.0]))
def test_any_state_has_a_solution(unit_state, target_rad, slope_rad_s, scale):
    """Also starts far outside every limit and unreachable targets: soft limits always leave a way."""
    state = scale * np.array(unit_state) * LIMITS
    solution = OCP.solve(state, target_rad + slope_rad_s * np.linspace(0, 0.4, N))
    assert np.abs(solution.scaled_jerk).max() <= 1.0 + 1e-9
    assert solution.softened >= 0.0
    assert np.all(np.isfinite(solution.command))


def test_where_the_first_solver_gives_up_the_second_does_not():
    """Stopped on purpose, on a start that needs more than one change of its active set."""
    state, reference = np.array([0.0, 0.0, 0.0, 2.0, 10.0]), np.ones(N)
    stopped = AxisOcp(MODEL, T, solvers=(lambda data: Daqp(data, iteration_limit=1), Piqp)).solve(state, reference)
    normal = OCP.solve(state, reference)
    assert (stopped.solver, normal.solver) == ("piqp", "daqp")
    assert joint(OCP, state, stopped.scaled_jerk) == pytest.approx(joint(OCP, state, normal.scaled_jerk), abs=1e-5)
    assert stopped.scaled_jerk == pytest.approx(normal.scaled_jerk, abs=1e-4)


def test_a_solver_that_gave_up_goes_on_as_if_new():
    """What a stopped run leaves behind is no start for the next one."""
    tired = Daqp(OCP.data, iteration_limit=40)
    statuses = []
    for state, reference in random_states(100, 1.0, N, seed=2):
        arguments = OCP.program(OCP.parameters(state, reference))
        answer = tired.solve(*arguments)
        statuses.append(answer.status)
        if answer.status == "solved":
            assert kkt_residual(OCP.data, *arguments, answer.x).stationarity < 1e-6
    assert statuses.count("timed_out") > 10
    assert statuses.count("solved") > 10


def test_starts_far_outside_the_limits_are_solved_without_the_second_solver():
    """At three times the limits, over the default horizon."""
    solvers = [LONG.solve(state, reference).solver for state, reference in random_states(60, 3.0, 40, seed=3)]
    assert set(solvers) <= {"gain", "daqp"}


def test_a_failed_solver_is_an_error_not_a_command():
    class Broken:
        name = "broken"

        def __init__(self, data):
            self.answer = np.zeros(data.h.shape[0])

        def solve(self, g, lower, upper):
            return QpResult(self.answer, "failed")

    ocp = AxisOcp(MODEL, T, solvers=(Broken,))
    assert ocp.solve(np.zeros(5), np.zeros(N)).solver == "gain"
    with pytest.raises(SolverFailedError, match="broken failed") as raised:
        ocp.solve(np.zeros(5), np.ones(N))
    assert not raised.value.timed_out


def test_a_time_out_of_all_solvers_says_so():
    makers = (lambda data: Daqp(data, iteration_limit=1), lambda data: Piqp(data, iteration_limit=1))
    ocp = AxisOcp(MODEL, T, solvers=makers)
    with pytest.raises(SolverFailedError, match="piqp timed out") as raised:
        ocp.solve(np.array([0.0, 0.0, 0.0, 2.0, 10.0]), np.ones(N))
    assert raised.value.timed_out


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("where", [0, 1])
def test_what_is_not_finite_is_refused(where, value):
    for k in range(5):
        arguments = [np.zeros(5), np.zeros(N)]
        arguments[where][k] = value
        with pytest.raises(SolverFailedError, match="not finite") as raised:
            OCP.solve(*arguments)
        assert not raised.value.timed_out


# ---------------------------------------------------------------- sizes


def test_smoothing_times_share_one_model():
    """They differ in smoothness, not in limits; a longer time moves less."""
    quick, slow = AxisOcp(MODEL, 0.05), AxisOcp(MODEL, 0.4)
    assert quick.model is slow.model is MODEL
    state, reference = np.zeros(5), 0.01 * np.sin(np.linspace(0, 6, N))
    swings = [np.ptp(joint(ocp, state, ocp.solve(state, reference).scaled_jerk)) for ocp in (quick, slow)]
    assert swings[0] > 2 * swings[1]
    z, _ = ipopt(N, 0.4, soft=False)(state, np.ones(N))
    assert joint(slow, state, slow.solve(state, np.ones(N)).scaled_jerk) == pytest.approx(z[0], abs=1e-5)


def test_a_long_horizon_is_solved():
    ocp = AxisOcp(AxisModel(NECK, 0, 160), 0.085)
    for target_rad, names in ((1e-4, {"gain"}), (1.0, {"daqp", "piqp"})):
        solution = ocp.solve(np.zeros(5), np.full(160, target_rad))
        assert solution.solver in names
        assert solution.command.shape == (3, 160)
        assert solution.softened == 0.0
        assert solution.command[0, 100:150] == pytest.approx(np.full(50, target_rad), abs=1e-4)
