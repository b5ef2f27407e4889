"""Limits of the program and its solver: soft limits, acquisition bounds, optimality, and an early stop."""

import numpy as np
import pytest
from builders.kkt import kkt_residual
from builders.ocp import (
    LIMITS,
    LONG,
    MODEL,
    NECK,
    OCP,
    ZETA,
    H,
    N,
    T,
    ipopt,
    joint,
    least_squares,
    parameters,
    random_states,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from gazempc.controllers.controller import ControllerError
from gazempc.controllers.mpc.ocp import AxisOcp
from gazempc.controllers.mpc.problem import Tuning
from gazempc.controllers.mpc.qp import Daqp, QpData


def within_limits(model, command, scaled_jerk, room):
    low, high = NECK.command_limits.position_min_rad[0], NECK.command_limits.position_max_rad[0]
    shares = [
        (command[0] - (low + high) / 2) / ((high - low) / 2),
        (command[1] + H / 2 * command[2]) / NECK.command_limits.velocity_max_rad_s[0],
        command[2] / NECK.command_limits.acceleration_max_rad_s2[0],
        scaled_jerk,
    ]
    return all(np.abs(share).max() <= 1.0 + room for share in shares)


def test_the_gain_is_used_exactly_when_no_limit_is_active():
    """The unconstrained optimum by the normal equations: used if feasible, else DAQP solves."""
    solved = {"gain": 0, "daqp": 0}
    rng = np.random.default_rng(6)
    for _ in range(200):
        near = rng.uniform(0, 0.9) * rng.choice([-1, 1])
        state = np.array([near, 0, near, 0, 0]) + 10 ** rng.uniform(-4, -0.5) * rng.uniform(-1, 1, 5) * LIMITS
        reference = state[0] + state[1] * 0.02 * np.arange(1, N + 1) + 10 ** rng.uniform(-4, 0) * rng.uniform(-1, 1)
        solution = OCP.solve(state, reference)
        free = np.linalg.lstsq(*least_squares(state, reference), rcond=None)[0]
        command = (MODEL.knots @ np.concatenate([state, [1.0], free])).reshape(3, N)
        solved[solution.solver] += 1
        if solution.solver == "gain":
            assert within_limits(MODEL, solution.command, solution.scaled_jerk, 1e-8)
        else:
            assert not within_limits(MODEL, command, free, -1e-5)
    assert min(solved.values()) > 25


@settings(max_examples=30)
@given(st.tuples(*[st.floats(-1, 1)] * 5), st.floats(-1, 1), st.floats(-4, -1.5))
def test_without_active_limits_daqp_and_the_gain_agree(unit_state, change, exponent):
    state = 10**exponent * np.array(unit_state) * LIMITS
    reference = np.full(N, 10**exponent * change)
    solution = OCP.solve(state, reference)
    g, lower, upper = OCP.changing(parameters(state, reference))
    solved = Daqp(OCP.program.data).solve(g, lower, upper)
    assert solved is not None
    assert joint(OCP, state, solution.scaled_jerk) == pytest.approx(joint(OCP, state, solved), abs=1e-9)
    assert kkt_residual(OCP.program.data, g, lower, upper, solution.scaled_jerk).stationarity < 1e-9


@pytest.mark.slow
def test_soft_limits_are_exact_when_feasible():
    """A target far beyond the position limit does not violate it."""
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
def test_a_start_outside_the_limits_has_the_optimum_of_ipopt_with_slacks(state, target_rad):
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
    solution = AxisOcp(MODEL, Tuning(T, ZETA)).solve(state, reference)
    assert solution.solver == "daqp"
    assert solution.softened == pytest.approx(softened, abs=1e-5)
    assert joint(OCP, state, solution.scaled_jerk) == pytest.approx(z[0], abs=1e-5)


BOUNDED = AxisOcp(LONG.model, Tuning(0.085, ZETA), bounded=True)
FAR_RAD = 100.0


def not_past(reference, below):
    bounds = np.full((2, len(reference)), [[-FAR_RAD], [FAR_RAD]])
    bounds[int(below)] = reference
    return bounds


@pytest.mark.parametrize("below", [True, False])
def test_a_joint_with_bounds_does_not_pass_the_person(below):
    """From rest 0.9 rad away; without the bound the overshoot exceeds 1 deg."""
    side = 1.0 if below else -1.0
    reference = side * np.linspace(0.7, 0.9, LONG.model.lengths.size)
    state = np.array([-side * 0.2, 0.0, -side * 0.2, 0.0, 0.0])
    plain = LONG.solve(state, reference)
    assert np.degrees(np.max(side * (joint(LONG, state, plain.scaled_jerk) - reference))) > 1.0
    bounds = not_past(reference, below)
    ours = BOUNDED.solve(state, reference, bounds)
    angles = joint(BOUNDED, state, ours.scaled_jerk)
    assert np.max(side * (angles - reference)) < 1e-3
    # Equal motion but for the last steps.
    early = slice(0, 20)
    assert angles[early] == pytest.approx(joint(LONG, state, plain.scaled_jerk)[early], abs=0.03)
    assert ours.softened == 0.0
    assert within_limits(BOUNDED.model, ours.command, ours.scaled_jerk, 1e-5)
    g, lower, upper = BOUNDED.changing(parameters(state, reference), bounds)
    # In units of 150 rad the default tolerance of an active bound would be nearly a degree.
    data = BOUNDED.program.data
    assert kkt_residual(data, g, lower, upper, ours.scaled_jerk, tolerance=1e-6).stationarity < 1e-4


def test_limits_have_priority_over_the_no_passing_bound():
    """Too fast to stop before a near person: overshoot, and all limits are kept."""
    state, reference = np.array([0.0, 2.4, 0.2, 2.4, 0.0]), np.full(LONG.model.lengths.size, 0.1)
    ours = BOUNDED.solve(state, reference, not_past(reference, below=True))
    assert joint(BOUNDED, state, ours.scaled_jerk).max() > 0.15
    assert ours.softened == 0.0
    assert within_limits(BOUNDED.model, ours.command, ours.scaled_jerk, 1e-5)


@pytest.mark.parametrize("ocp", [OCP, LONG], ids=["20", "40"])
@pytest.mark.parametrize("scale", [0.3, 0.8, 1.5])
def test_solutions_satisfy_the_kkt_conditions(ocp, scale):
    """Independent of any solver; starts up to 1.5 times the limits, where most soften them."""
    data = ocp.program.data
    daqp, softened = Daqp(data), 0
    for state, reference in random_states(60, scale, ocp.model.lengths.size, seed=1):
        g, lower, upper = ocp.changing(parameters(state, reference))
        answer = daqp.solve(g, lower, upper)
        assert answer is not None
        residual = kkt_residual(data, g, lower, upper, answer)
        assert residual.stationarity < 1e-6
        assert residual.bound < 1e-5
        # Sensitivity: the first jerk perturbed by a hundredth.
        off = answer.copy()
        off[0] -= 0.01 * np.sign(off[0])
        assert kkt_residual(data, g, lower, upper, off).stationarity > 1e-3
        softened += ocp.solve(state, reference).softened > 0
    assert (softened > 20) == (scale > 1)


@pytest.mark.parametrize(("pull", "best"), [(0.25, 0.25), (2.0, 0.5), (2.75, 0.75), (9.0, 1.0)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_kkt_residual_of_a_program_solved_by_hand(pull, best, side):
    """(x - pull)^2 / 2, |x| <= 1/2 at a price of 2: inside, on the limit (multiplier up to 2), beyond, at the bound."""
    data = QpData(h=np.eye(1), a=np.eye(1), penalty=2.0)
    for x in (0.0, 0.25, 0.5, 0.75, 1.0):
        residual = kkt_residual(data, np.array([-side * pull]), np.array([-0.5]), np.array([0.5]), np.array([side * x]))
        assert (residual.stationarity < 1e-12) == (x == best)


@settings(max_examples=50)
@given(st.tuples(*[st.floats(-1, 1)] * 5), st.floats(-6, 6), st.floats(-4, 4), st.sampled_from([0.3, 1.0, 3.0]))
def test_the_program_is_feasible_for_any_state(unit_state, target_rad, slope_rad_s, scale):
    """Also starts far outside every limit and unreachable targets: soft limits keep the program feasible."""
    state = scale * np.array(unit_state) * LIMITS
    solution = OCP.solve(state, target_rad + slope_rad_s * np.linspace(0, 0.4, N))
    assert np.abs(solution.scaled_jerk).max() <= 1.0 + 1e-9
    assert solution.softened >= 0.0
    assert np.all(np.isfinite(solution.command))


def test_a_stopped_solver_gives_the_unconstrained_optimum():
    """Stopped at a start with several active-set changes; the smoother keeps the limits."""
    state, reference = np.array([0.0, 0.0, 0.0, 2.0, 10.0]), np.ones(N)
    stopped = AxisOcp(MODEL, Tuning(T), iterations=1).solve(state, reference)
    assert stopped.solver == "none"
    free = np.linalg.lstsq(*least_squares(state, reference, zeta=None), rcond=None)[0]
    assert stopped.scaled_jerk == pytest.approx(free, rel=1e-6, abs=1e-8)
    assert stopped.softened > 0.0
    assert AxisOcp(MODEL, Tuning(T)).solve(state, reference).solver == "daqp"


def test_a_failed_solve_is_not_used_as_warm_start():
    """The state of a stopped solve is discarded."""
    tired = Daqp(OCP.program.data, iteration_limit=32)
    statuses = []
    for state, reference in random_states(100, 1.0, N, seed=2):
        arguments = OCP.changing(parameters(state, reference))
        answer = tired.solve(*arguments)
        statuses.append(answer is not None)
        if answer is not None:
            assert kkt_residual(OCP.program.data, *arguments, answer).stationarity < 1e-6
    assert statuses.count(False) > 10
    assert statuses.count(True) > 10


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("where", [0, 1])
def test_nan_and_infinity_are_refused(where, value):
    for k in range(5):
        arguments = [np.zeros(5), np.zeros(N)]
        arguments[where][k] = value
        with pytest.raises(ControllerError, match="not finite"):
            OCP.solve(*arguments)
