"""User-defined costs and rows: the optimum of IPOPT for the same program, and errors for invalid ones."""

import casadi as ca
import numpy as np
import pytest
from builders.control import NECK, run, still
from builders.ocp import even, ipopt_of, joint, random_states
from builders.replays import NECK as QUICK_NECK
from hypothesis import given, settings
from hypothesis import strategies as st

from gazempc.controllers.mpc import problem
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.controllers.mpc.ocp import AxisOcp
from gazempc.controllers.mpc.own import own_parts
from gazempc.errors import SettingsError
from gazempc.parts import check_function
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import SceneSettings, make_scene

STEPS, T, ZETA = 8, 0.06, 0.8
TUNING = problem.Tuning(T, ZETA)
UNITS = {"q": 1.0, "v": 2.0, "a": 10.0, "u": 1.0, "du": 2.0, "ddu": 10.0, "j": 200.0}
SYMBOLS = sorted(UNITS)
symbols = st.tuples(st.sampled_from(SYMBOLS), st.sampled_from([*SYMBOLS, "r", "dr"]))


def squares(names, weight, aim):
    """A convex quadratic: weight |x + y - aim|^2, x and y in units in which they are about 1."""
    first, second = names

    def term(o):
        y = getattr(o, second) / UNITS.get(second, 1.0)
        return weight * ca.sumsqr(getattr(o, first) / UNITS[first] + y - aim) + weight * aim * ca.sum1(o.u)

    return term


def between(names, width):
    first, second = names
    return lambda o: (getattr(o, first) / UNITS[first] - getattr(o, second) / UNITS.get(second, 1.0)) / width


def ours(terms, rows, bounded=False):
    return AxisOcp(even(STEPS), TUNING, bounded=bounded, own=own_parts(terms, rows, "pan"))


@pytest.mark.slow
@settings(max_examples=10)
@given(
    st.lists(st.tuples(symbols, st.floats(1e-3, 3.0), st.floats(-0.5, 0.5)), min_size=1, max_size=2), st.integers(0, 50)
)
def test_user_terms_give_the_optimum_of_ipopt(drawn, seed):
    terms = [squares(*each) for each in drawn]
    ocp, best = ours(terms, []), ipopt_of(NECK, 0, (1,) * STEPS, TUNING, True, tuple(terms))
    for state, reference in random_states(2, 0.2, STEPS, seed):
        solution = ocp.solve(state, reference)
        z, _ = best(state, reference)
        assert solution.solver != "none"
        if not solution.softened:  # beside a softened limit DAQP rounds a slack's price
            assert joint(ocp, state, solution.scaled_jerk) == pytest.approx(z[0], abs=2e-5)
            assert solution.command[0] == pytest.approx(z[2], abs=2e-5)


@pytest.mark.slow
@settings(max_examples=8)
@given(symbols.filter(lambda names: names[0] != names[1]), st.floats(0.02, 2.0), st.integers(0, 50))
def test_user_rows_give_the_optimum_of_ipopt(names, width, seed):
    row = between(names, width)
    ocp = ours([], [row])
    best = ipopt_of(NECK, 0, (1,) * STEPS, TUNING, True, (), (row,))
    for state, reference in random_states(2, 0.2, STEPS, seed):
        solution = ocp.solve(state, reference)
        z, _ = best(state, reference)
        assert solution.solver != "none"
        if not solution.softened and not solution.own_softened:
            assert joint(ocp, state, solution.scaled_jerk) == pytest.approx(z[0], abs=2e-5)


def test_velocity_and_posture_terms_give_the_optimum_of_ipopt():
    """One quick case of the same comparison."""
    terms = (lambda o: 0.05 * ca.sumsqr(o.du), lambda o: 0.3 * ca.sumsqr(o.q - 0.2))
    row = between(("u", "q"), 0.1)
    ocp, best = ours(terms, (row,)), ipopt_of(NECK, 0, (1,) * STEPS, TUNING, True, terms, (row,))
    for state, reference in random_states(5, 0.2, STEPS, seed=1):
        solution, (z, _) = ocp.solve(state, reference), best(state, reference)
        assert joint(ocp, state, solution.scaled_jerk) == pytest.approx(z[0], abs=2e-5)


def test_terms_apply_to_pan_and_tilt_or_to_one_joint():
    seen = []

    def noted(o):
        seen.append(o.joint)
        return 0.02 * ca.sumsqr(o.du)

    Mpc(NECK, terms=[noted])
    assert set(seen) == {"pan", "tilt"}
    plain, both, one = Mpc(NECK), Mpc(NECK, terms=[noted]), Mpc(NECK, terms={"tilt": [noted]})
    hessians = [[ocp.program.data.h for ocp in mpc.ocps + mpc.acquisition_ocps] for mpc in (plain, both, one)]
    assert [np.array_equal(a, b) for a, b in zip(*hessians[:2], strict=True)] == [False] * 4
    assert [np.array_equal(a, b) for a, b in zip(hessians[0], hessians[2], strict=True)] == [True, False, True, False]


def test_a_term_function_is_evaluated_for_each_controller():
    """The function may close over a changing value."""
    weight = [0.01]

    def term(o):
        return weight[0] * ca.sumsqr(o.du)

    first = Mpc(NECK, terms=[term]).ocps[0].program.data.h
    weight[0] = 0.02
    assert not np.array_equal(first, Mpc(NECK, terms=[term]).ocps[0].program.data.h)


FOREIGN, PARAMETER = ca.SX.sym("q_0"), ca.MX.sym("g")


@pytest.mark.parametrize(
    ("term", "why"),
    [
        (lambda o: ca.sum1(ca.cos(o.q)), "not quadratic"),
        (lambda o: ca.sum1(o.q * o.u * o.j), "not quadratic"),
        (lambda o: ca.sum1(ca.fabs(o.q)), "not quadratic"),
        (lambda o: ca.sum1(ca.if_else(o.q > 0.3, o.q**2, 0.0)), "not quadratic"),
        (lambda o: 1.0 / o.q[0], "not quadratic"),
        (lambda o: -ca.sumsqr(o.q), "not convex"),
        (lambda o: ca.dot(o.q, o.v), "not convex"),
        (lambda o: o.du, r"shape \(16, 1\)"),
        (lambda o: np.nan * ca.sumsqr(o.q), "not finite"),
        (lambda o: FOREIGN * o.q[0], "foreign symbols: q_0"),
        (lambda o: PARAMETER, "casadi.SX"),
        (lambda o: 3.0, "does not depend on the motion"),
        (lambda o: ca.sumsqr(o.r), "does not depend on the motion"),
        (lambda: 0.0, "TypeError"),
        (3.0, "not a function"),
    ],
)
def test_a_cost_that_is_not_convex_quadratic_is_refused(term, why):
    with pytest.raises(SettingsError, match=rf"mpc\.terms\[0\].*{why}"):
        Mpc(NECK, terms=[term])


@pytest.mark.parametrize(
    ("row", "why"),
    [
        (lambda o: o.q**2, "not linear"),
        (lambda o: ca.fabs(o.q), "not linear"),
        (lambda o: o.q / 0.0, "not finite"),
        (lambda o: o.q.T, "shape"),
        (lambda o: ca.SX(0, 1), "shape"),
        (lambda o: o.r, "does not depend on the motion in element 0"),
        (lambda o: ca.vertcat(o.q, 0.5), "does not depend on the motion in element 16"),
        (lambda o: FOREIGN + o.q, "foreign symbols"),
        (lambda o: (o.u - 3.0) / 0.2, "infeasible"),
        (lambda o: ca.vertcat(o.u + 2.0, o.u - 2.0), "infeasible"),
    ],
)
def test_a_nonlinear_or_infeasible_row_is_refused(row, why):
    with pytest.raises(SettingsError, match=rf"mpc\.rows.*{why}"):
        Mpc(NECK, rows=[row])


@pytest.mark.parametrize(
    ("terms", "why"),
    [
        ({"pam": []}, "no joint 'pam'; accepted: pan, tilt"),
        ("calm", "str is not a list"),
        ({"pan": 3}, r"\['pan'\]: int"),
    ],
)
def test_an_invalid_option_is_refused(terms, why):
    with pytest.raises(SettingsError, match=why):
        Mpc(NECK, terms=terms)


def test_a_symbol_of_another_trajectory_is_refused():
    kept = []

    def term(o):
        kept.append(o)
        return ca.sumsqr(kept[0].q)

    with pytest.raises(SettingsError, match="foreign symbols"):
        Mpc(NECK, terms=[term])


def test_a_lag_limit_holds_in_closed_loop():
    """The row bounds the lag by 2 deg; without it a step of 30 deg exceeds that."""

    def lag(o):
        return (o.u - o.q) / np.radians(2.0)

    # Pan of the joint one dead time later, against the command.
    late = round(NECK.pan.dead_time_s / NECK.servo_period_s)
    most = {}
    for name, rows in (("plain", []), ("row", [lag])):
        joints, commands, _ = run(Mpc(NECK, rows=rows), NECK, still(np.radians(30.0)), 600)
        most[name] = np.degrees(np.abs(commands[:-late, 0] - joints[late:, 0])).max()
    assert most["plain"] > 5.0
    # The row holds at the ends of steps, after the first ones, whose motion is already commanded.
    assert most["row"] < 2.1


def replayed(mpc):
    scene = make_scene("subject03_R4", SceneSettings(start_offset_deg=30.0), QUICK_NECK)
    return replay_scene(scene, mpc, "constant_velocity").log


def test_terms_that_outweigh_the_slack_price_are_named():
    """A weight above the slack price: the plan violates limits, the smoother keeps them, an event names the term."""

    def far_away(o):
        return 1e7 * ca.sumsqr(o.q - 3.0)

    mpc = Mpc(QUICK_NECK, terms={"pan": [far_away]})
    log = replayed(mpc)
    assert {"limits_softened", "solver_gave_up"} & set(log.event_name.tolist())
    assert any("far_away" in fault.error and fault.error.startswith("ControllerError: pan") for fault in log.faults)
    assert log.command_position_rad[:, 0].max() <= NECK.command_limits.position_max_rad[0] + 1e-9


def test_a_temporarily_infeasible_row_is_named():
    """The row is feasible in other states, so it is accepted, and the nearest plan is used."""

    def at_once(o):
        return (o.q - o.r) / 1e-4

    log = replayed(Mpc(QUICK_NECK, rows={"pan": [at_once]}))
    assert "own_row_softened" in log.event_name.tolist()
    assert any("at_once" in fault.error for fault in log.faults)


def test_terms_are_given_by_name_on_the_command_line(tmp_path, monkeypatch):
    (tmp_path / "own_mpc_parts.py").write_text(
        "import casadi as ca\n\n\ndef calm(o):\n    return 0.05 * ca.sumsqr(o.du)\n", encoding="utf-8"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    logs = []
    for terms in ((), ("pan=own_mpc_parts:calm",)):
        chosen = ReplaySettings.model_validate({"mpc": {"terms": terms}})
        logs.append(replay_scene(make_scene("subject03_R4", neck=QUICK_NECK), "mpc", "constant_velocity", chosen).log)
    swings = [np.abs(np.diff(log.command_velocity_rad_s, axis=0)).max(axis=0) for log in logs]
    assert swings[1][0] < 0.8 * swings[0][0]
    assert swings[1][1] == swings[0][1]
    missing = ReplaySettings.model_validate({"mpc": {"terms": ("own_mpc_parts:clam",)}})
    with pytest.raises(SettingsError, match="no 'clam'; perhaps you meant 'calm'"):
        replay_scene(make_scene("subject03_R4"), "mpc", "constant_velocity", missing)


@pytest.mark.parametrize("choice", ["calm", "my_terms", "roll=my_terms:calm", "my_terms:", "=a:b:c", "my terms:calm"])
def test_an_unknown_term_function_is_refused(choice):
    with pytest.raises(ValueError, match="module:function"):
        check_function(choice)
