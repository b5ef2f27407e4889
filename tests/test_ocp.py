"""The quadratic program against independent solvers and transcriptions."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

from gazempc.controllers.ocp import AxisOcp, SolverFailedError, predict, servo_step
from gazempc.neck import load_neck

NECK = load_neck("reference")
N = 20
T = 0.1
OCP = AxisOcp(NECK, 0, N, T)


def optimal(reference, state, steps=N, smoothing=T):
    """The same problem, transcribed sparsely from its definition and given to IPOPT."""
    limits = NECK.command_limits
    top = 0.99
    h, wn, zeta = NECK.servo_period_s, NECK.pan.natural_frequency_rad_s, NECK.pan.damping_ratio
    M, m = servo_step(NECK.pan, h)
    opti = ca.Opti()
    z = opti.variable(5, steps + 1)
    j = opti.variable(steps)
    opti.subject_to(z[:, 0] == state)
    cost = 0
    for k in range(steps):
        following = z[:, k]
        for _ in range(NECK.servo_ticks_per_plan):
            following = M @ following + m * j[k] * 300
        opti.subject_to(z[:, k + 1] == following)
        q, v, u = z[0, k + 1], z[1, k + 1], z[2, k + 1]
        cost += (q - reference[k]) ** 2 + smoothing**4 * (wn**2 * (u - q) - 2 * zeta * wn * v) ** 2
        cost += 1e-8 * (j[k] * 300 / (top * limits.jerk_max_rad_s3[0])) ** 2
    jmax = top * float(limits.jerk_max_rad_s3[0]) / 300
    opti.subject_to(opti.bounded(-jmax, j, jmax))
    opti.subject_to(opti.bounded(float(limits.position_min_rad[0]), z[2, 1:], float(limits.position_max_rad[0])))
    for row, bound in ((3, limits.velocity_max_rad_s[0]), (4, limits.acceleration_max_rad_s2[0])):
        opti.subject_to(opti.bounded(-top * float(bound), z[row, 1:], top * float(bound)))
    opti.minimize(1e4 * cost)
    opti.solver("ipopt", {"print_time": 0}, {"print_level": 0, "sb": "yes", "tol": 1e-12})
    solution = opti.solve()
    return np.array(solution.value(j)) * 300, np.array(solution.value(z))


@pytest.mark.parametrize("far_rad", [0.01, 0.1, 0.6])
def test_solution_is_that_of_ipopt(far_rad):
    """Far targets make jerk, acceleration and velocity limits bind."""
    reference = far_rad * np.linspace(0.5, 1.0, N)
    state = np.array([0.02, 0.1, 0.05, 0.1, 0.5])
    ours = OCP.solve(state, reference, np.ones(N))
    jerk, z = optimal(reference, state)
    assert ours.slack == pytest.approx(np.zeros(3), abs=1e-6)
    # The first command matters; it must agree with the reference solution to 1e-4 rad and much better.
    joint = OCP.prediction.joint_from_state @ state + OCP.prediction.joint_from_jerk @ (
        ours.jerk_rad_s3 / OCP.jerk_scale
    )
    assert joint == pytest.approx(z[0, 1:], abs=1e-5)
    assert ours.jerk_rad_s3[0] == pytest.approx(jerk[0], abs=1.0)


def test_unconstrained_solution_is_the_normal_equations():
    """Where no limit binds the program is least squares; solved here by scipy from the definition."""
    reference = 0.001 * np.sin(np.linspace(0, 1, N))
    state = np.zeros(5)
    p = OCP.prediction

    def cost(x):
        error = p.joint_from_jerk @ x - reference
        acceleration = p.acceleration_from_jerk @ x
        return 1e4 * (error @ error + T**4 * acceleration @ acceleration + 1e-8 * x @ x)

    best = minimize(cost, np.zeros(N), method="BFGS", options={"gtol": 1e-10, "maxiter": 2000})
    ours = OCP.solve(state, reference, np.ones(N)).jerk_rad_s3 / OCP.jerk_scale
    assert cost(ours) <= cost(best.x) * (1 + 1e-6)
    assert p.joint_from_jerk @ ours == pytest.approx(p.joint_from_jerk @ best.x, abs=1e-6)


def test_prediction_is_the_continuous_time_model():
    """The rolled maps against scipy's ODE solver with the command held between servo ticks."""
    p = predict(NECK.pan, NECK, 5, 300.0)
    rng = np.random.default_rng(3)
    state, jerk = rng.uniform(-1, 1, 5) * [0.5, 1, 0.5, 1, 5], rng.uniform(-1, 1, 5)
    h, wn, zeta = NECK.servo_period_s, 12.0, 0.9
    q, v, u, du, ddu = state
    angles, accelerations = [], []
    for j in 300.0 * jerk:
        for _ in range(4):
            u, du, ddu = u + h * du + h**2 / 2 * ddu + h**3 / 6 * j, du + h * ddu + h**2 / 2 * j, ddu + h * j
            held = u
            step = solve_ivp(
                lambda _, y, held=held: [y[1], wn**2 * (held - y[0]) - 2 * zeta * wn * y[1]],
                (0, h),
                [q, v],
                rtol=1e-11,
                atol=1e-13,
            )
            q, v = step.y[:, -1]
        angles.append(q)
        accelerations.append(wn**2 * (u - q) - 2 * zeta * wn * v)
    assert p.joint_from_state @ state + p.joint_from_jerk @ jerk == pytest.approx(angles, abs=1e-9)
    got = p.acceleration_from_state @ state + p.acceleration_from_jerk @ jerk
    assert got == pytest.approx(accelerations, abs=1e-6)


@settings(max_examples=200)
@given(
    st.tuples(*[st.floats(-1, 1)] * 5),
    st.floats(-6, 6),
    st.floats(-4, 4),
    st.sampled_from([0.3, 1.0, 3.0]),
)
def test_any_state_has_a_solution(unit_state, target_rad, slope_rad_s, scale):
    """Also starts far outside every limit and unreachable targets: soft limits always leave a way."""
    state = scale * np.array(unit_state) * [1.4, 2.5, 1.4, 2.5, 15.0]
    reference = target_rad + slope_rad_s * np.linspace(0, 0.4, N)
    solution = OCP.solve(state, reference, np.ones(N))
    assert np.all(np.abs(solution.jerk_rad_s3) <= NECK.command_limits.jerk_max_rad_s3[0])
    assert np.all(solution.slack >= -1e-6)


def test_where_the_first_solver_gives_up_the_second_does_not():
    """Starts at up to three times the limits, some of which DAQP alone does not solve."""
    rng = np.random.default_rng(0)
    alone = AxisOcp(NECK, 0, N, T, solvers=("daqp",))
    given_up = 0
    for _ in range(2000):
        unit = np.round(rng.uniform(-2, 2, 5)) / 2
        state = 3.0 * unit * [1.4, 2.5, 1.4, 2.5, 15.0]
        reference = np.full(N, round(rng.uniform(-6, 6)))
        try:
            alone.solve(state, reference, np.ones(N))
        except SolverFailedError:
            given_up += 1
            OCP.solve(state, reference, np.ones(N))
    assert given_up > 0


def test_soft_limits_are_exact_when_they_can_be_kept():
    """A target far beyond the position limit presses hardest against it, and does not bend it."""
    ocp = AxisOcp(NECK, 0, 40, T)
    solution = ocp.solve(np.array([1.2, 0, 1.2, 0, 0.0]), np.full(40, 3.0), np.ones(40))
    assert solution.slack == pytest.approx(np.zeros(3), abs=1e-7)


@pytest.mark.parametrize("where", [0, 1, 2])
def test_nan_is_refused(where):
    arguments = [np.zeros(5), np.zeros(N), np.ones(N)]
    arguments[where] = arguments[where] * np.nan
    with pytest.raises(SolverFailedError, match="not finite"):
        OCP.solve(*arguments)


def test_solver_failure_is_an_error_not_a_command():
    """A solver that is stopped before it is done says so."""
    ocp = AxisOcp(
        NECK, 0, N, T, solvers=("qrqp",), solver_options={"max_iter": 1, "print_iter": False, "print_header": False}
    )
    with pytest.raises(SolverFailedError, match="QP solver"):
        ocp.solve(np.array([0, 0, 0, 3.0, 20.0]), np.ones(N), np.ones(N))
