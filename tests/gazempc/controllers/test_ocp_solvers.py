"""The two solvers of the program: optimal, equal, and what follows when one gives up."""

import numpy as np
import pytest
from builders.ocp import LIMITS, LONG, MODEL, OCP, N, T, joint, random_states
from hypothesis import given, settings
from hypothesis import strategies as st

from gazempc.controllers.mpc.kkt import kkt_residual
from gazempc.controllers.mpc.ocp import AxisOcp, SolverFailedError
from gazempc.controllers.mpc.qp import Daqp, Piqp, QpData, QpResult


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
