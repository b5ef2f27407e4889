"""The quadratic program of one joint, against IPOPT and the continuous-time model."""

import numpy as np
import pytest
from builders.ocp import (
    LONG,
    MOVING,
    NECK,
    OCP,
    H,
    N,
    T,
    even,
    ipopt,
    joint,
    least_squares,
    random_states,
)
from scipy.integrate import solve_ivp
from scipy.optimize import lsq_linear

from gazempc.controllers.mpc.condense import AxisModel, growing_steps
from gazempc.controllers.mpc.ocp import AxisOcp
from gazempc.controllers.mpc.problem import Tuning

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
def test_the_solution_equals_that_of_ipopt(state, from_rad, to_rad, binding):
    """The farther the target the more limits bind."""
    steps = LONG.model.lengths.size
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
    """Without active limits; least squares by SciPy from the definition."""
    state, reference = np.zeros(5), 0.001 * np.sin(np.linspace(0, 1, N))
    best = lsq_linear(*least_squares(state, reference))
    ours = OCP.solve(state, reference)
    assert ours.solver == "gain"
    assert ours.softened == 0.0
    assert joint(OCP, state, ours.scaled_jerk) == pytest.approx(joint(OCP, state, best.x), abs=1e-10)
    assert ours.scaled_jerk == pytest.approx(best.x, abs=1e-8)


def test_the_prediction_equals_the_continuous_time_model():
    """Prediction matrices against SciPy's ODE solver with commands held between servo ticks; unequal steps."""
    lengths = (1, 1, 2, 3)
    p = AxisModel(NECK, 0, lengths, 5)
    program = AxisOcp(p, Tuning(T)).program
    rng = np.random.default_rng(3)
    state, jerk = rng.uniform(-1, 1, 5) * [0.5, 1, 0.5, 1, 5], rng.uniform(-1, 1, 4)
    h, wn, zeta = NECK.servo_period_s, 12.0, 0.9
    q, v, u, du, ddu = state
    angles, velocities, accelerations, commands, knots = [], [], [], [], []
    for length, j in zip(lengths, p.jerk_scale * jerk, strict=True):
        for tick in range(4 * length):
            u, du, ddu = u + h * du + h**2 / 2 * ddu + h**3 / 6 * j, du + h * ddu + h**2 / 2 * j, ddu + h * j
            held = u
            moved = solve_ivp(
                lambda _, y, held=held: [y[1], wn**2 * (held - y[0]) - 2 * zeta * wn * y[1]],
                (0, h),
                [q, v],
                rtol=1e-11,
                atol=1e-13,
            )
            q, v = moved.y[:, -1]
            if tick % 4 == 3:
                knots.append((u, du, ddu))
        commands.append(u)
        angles.append(q)
        velocities.append(v)
        accelerations.append(wn**2 * (u - q) - 2 * zeta * wn * v)
    z = np.concatenate([state, [1.0], jerk])
    assert p.joint @ z == pytest.approx(angles, abs=1e-9)
    assert p.velocity @ z == pytest.approx(velocities, abs=1e-8)
    assert p.acceleration @ z == pytest.approx(accelerations, abs=1e-6)
    rows = np.hstack([program.rows_map[:, :6], program.data.a])
    assert rows[:4] @ z == pytest.approx(commands / NECK.command_limits.position_max_rad[0], abs=1e-9)
    assert p.knots @ z == pytest.approx(np.transpose(knots[:5]).ravel(), abs=1e-9)


UNEVEN = (1, 1, 1, 2, 3, 4)


def test_the_command_is_the_integral_of_the_jerks():
    """The returned motion is the integral of the returned jerks, also with asymmetric position limits."""
    uneven = AxisModel(NECK, 0, UNEVEN, sum(UNEVEN))
    for ocp in (
        OCP,
        AxisOcp(even(N, 1), Tuning(T)),
        AxisOcp(uneven, Tuning(T)),
        AxisOcp(uneven, Tuning(T), bounded=True),
    ):
        lengths = ocp.model.lengths.astype(int)
        for scale in (0.02, 1.0, 2.0):
            for state, reference in random_states(10, scale, lengths.size):
                solution, (u, du, ddu) = ocp.solve(state, reference), state[2:]
                assert np.abs(solution.scaled_jerk).max() <= 1.0
                jerks = np.repeat(ocp.model.jerk_scale * solution.scaled_jerk, lengths)
                for k, j in enumerate(jerks):
                    u, du, ddu = u + H * du + H**2 / 2 * ddu + H**3 / 6 * j, du + H * ddu + H**2 / 2 * j, ddu + H * j
                    assert solution.command[:, k] == pytest.approx([u, du, ddu], abs=1e-8)


def test_the_velocity_limit_holds_across_unequal_steps():
    """From just below the limit while accelerating; a row at the wrong step's end would allow a violation."""
    ocp = AxisOcp(AxisModel(NECK, 0, UNEVEN, sum(UNEVEN)), Tuning(T))
    limit = NECK.command_limits.velocity_max_rad_s[0]
    bound, reached = 0, 0.0
    for acceleration in np.linspace(0.0, 9.0, 37):
        for speed in np.linspace(0.92, 1.0, 9) * limit:
            state = np.array([0.0, speed, 0.0, speed, acceleration])
            solution = ocp.solve(state, np.linspace(0.5, 1.2, len(UNEVEN)))
            # The initial state alone determines part of the first step.
            if solution.softened or speed + acceleration * H / 2 > limit:
                continue
            _, v, a = np.column_stack([state[2:], solution.command])
            shares = np.linspace(0.0, 1.0, 21)[:, None]
            between = v[:-1] + shares * H * a[:-1] + 0.5 * (shares * H) ** 2 * np.diff(a) / H
            assert between[:, 1:].max() <= limit * (1 + 1e-5)
            bound += 1
            reached = max(reached, between[:, 1:].max())
    assert bound > 50
    assert reached > limit * (1 - 1e-3)


def test_growing_steps_give_the_plan_of_equal_steps():
    """Compared: the first jerk, which is all that is sent before the next plan, and the joint at common knots."""
    horizon = growing_steps(0.8, H)
    assert horizon[:3] == (1, 1, 1)
    assert sum(horizon) == 40
    assert len(horizon) < 20
    growing = AxisOcp(AxisModel(NECK, 0, horizon, 20), Tuning(T))
    fine = AxisOcp(even(40), Tuning(T))
    ends = np.cumsum(horizon) - 1
    for state, reference in random_states(20, 0.1, 40, seed=4):
        coarse, exact = growing.solve(state, reference[ends]), fine.solve(state, reference)
        apart = joint(growing, state, coarse.scaled_jerk) - joint(fine, state, exact.scaled_jerk)[ends]
        assert np.degrees(np.abs(apart[:8])).max() < 0.02
        assert coarse.command[0, 0] == pytest.approx(exact.command[0, 0], abs=1e-4)
