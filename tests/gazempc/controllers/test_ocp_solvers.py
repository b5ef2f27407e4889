"""The solver of the program: optimal, and what follows when it gives up."""

import numpy as np
import pytest
from builders.kkt import kkt_residual
from builders.ocp import LIMITS, LONG, MODEL, OCP, N, T, least_squares, parameters, random_states
from hypothesis import given, settings
from hypothesis import strategies as st

from gazempc.controllers.controller import SolverFailed
from gazempc.controllers.mpc.ocp import AxisOcp
from gazempc.controllers.mpc.qp import Daqp, QpData


@pytest.mark.parametrize("ocp", [OCP, LONG], ids=["20", "40"])
@pytest.mark.parametrize("scale", [0.3, 0.8, 1.5])
def test_answers_are_optimal(ocp, scale):
    """Apart from any solver; up to 1.5 times the limits, where most starts make them soft."""
    data = ocp.program.data
    daqp, softened = Daqp(data), 0
    for state, reference in random_states(60, scale, ocp.model.lengths.size, seed=1):
        g, lower, upper = ocp.changing(parameters(state, reference))
        answer = daqp.solve(g, lower, upper)
        assert answer is not None
        residual = kkt_residual(data, g, lower, upper, answer)
        assert residual.stationarity < 1e-6
        assert residual.bound < 1e-5
        # The check would notice: the first jerk a hundredth off.
        off = answer.copy()
        off[0] -= 0.01 * np.sign(off[0])
        assert kkt_residual(data, g, lower, upper, off).stationarity > 1e-3
        softened += ocp.solve(state, reference).softened > 0
    assert (softened > 20) == (scale > 1)


@pytest.mark.parametrize(("pull", "best"), [(0.25, 0.25), (2.0, 0.5), (2.75, 0.75), (9.0, 1.0)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_residual_of_a_program_solved_by_hand(pull, best, side):
    """(x - pull)^2 / 2 with |x| <= 1/2 at 2 a unit: inside, held by a multiplier up to 2, beyond, at the bound."""
    data = QpData(h=np.eye(1), a=np.eye(1), penalty=2.0)
    for x in (0.0, 0.25, 0.5, 0.75, 1.0):
        residual = kkt_residual(data, np.array([-side * pull]), np.array([-0.5]), np.array([0.5]), np.array([side * x]))
        assert (residual.stationarity < 1e-12) == (x == best)


@settings(max_examples=50)
@given(st.tuples(*[st.floats(-1, 1)] * 5), st.floats(-6, 6), st.floats(-4, 4), st.sampled_from([0.3, 1.0, 3.0]))
def test_any_state_has_a_solution(unit_state, target_rad, slope_rad_s, scale):
    """Also starts far outside every limit and unreachable targets: soft limits always leave a way."""
    state = scale * np.array(unit_state) * LIMITS
    solution = OCP.solve(state, target_rad + slope_rad_s * np.linspace(0, 0.4, N))
    assert np.abs(solution.scaled_jerk).max() <= 1.0 + 1e-9
    assert solution.softened >= 0.0
    assert np.all(np.isfinite(solution.command))


def test_where_the_solver_is_stopped_the_motion_is_the_best_without_limits():
    """Stopped on purpose, on a start that needs more than one change of its active set; the smoother does the rest."""
    state, reference = np.array([0.0, 0.0, 0.0, 2.0, 10.0]), np.ones(N)
    stopped = AxisOcp(MODEL, T, iterations=1).solve(state, reference)
    assert stopped.solver == "none"
    free = np.linalg.lstsq(*least_squares(state, reference, zeta=None), rcond=None)[0]
    assert stopped.scaled_jerk == pytest.approx(free, rel=1e-6, abs=1e-8)
    assert stopped.softened > 0.0
    assert AxisOcp(MODEL, T).solve(state, reference).solver == "daqp"


def test_a_solver_that_gave_up_goes_on_as_if_new():
    """What a stopped run leaves behind is no start for the next one."""
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
def test_what_is_not_finite_is_refused(where, value):
    for k in range(5):
        arguments = [np.zeros(5), np.zeros(N)]
        arguments[where][k] = value
        with pytest.raises(SolverFailed, match="not finite"):
            OCP.solve(*arguments)
