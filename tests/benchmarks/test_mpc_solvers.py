"""The solver benchmark runs as a whole; its closed-loop run poses what the controller solves."""

import io
import json
from contextlib import redirect_stdout

import numpy as np
import pytest

from benchmarks import mpc_solvers
from benchmarks.solvers.figures import WARM_UP
from benchmarks.solvers.measure import measure, solve_all
from benchmarks.solvers.nlp_peers import DoMpc
from benchmarks.solvers.ours import Gazempc
from benchmarks.solvers.simulated_run import SMOOTHING_TIME_S, STEPS, simulate
from gazempc.controllers.mpc.condense import AxisModel, growing_steps
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.controllers.mpc.ocp import AxisOcp
from gazempc.neck.spec import load_neck

NECK = load_neck("reference")
PEERS = {"gazempc", "daqp_always", "casadi_qrqp", "piqp", "osqp", "do_mpc"}
# Of the whole run: qrqp fails or says "success" to commands 0.1 rad off, OSQP stops at its limit of iterations.
NOT_EXACT = {"casadi_qrqp", "osqp"}


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    path = tmp_path_factory.mktemp("bench") / "figures.json"
    printed = io.StringIO()
    with redirect_stdout(printed):
        assert mpc_solvers.main(["--ticks", "25", "--growth", "20", "--json", str(path)]) == 0
    return printed.getvalue(), json.loads(path.read_text())


@pytest.mark.slow
def test_all_solvers_are_measured_and_ours_agrees(measured):
    text, figures = measured
    peers = {peer["name"]: peer for peer in figures["peers"]}
    assert peers.keys() == PEERS
    for name, peer in peers.items():
        assert 0 < peer["median_ms"] <= peer["p95_ms"] <= peer["p99_ms"] <= peer["max_ms"]
        assert peer["calls"] == 25 - WARM_UP
        assert peer["agrees"] == (peer["ticks_over"] == peer["failures"] == 0)
        assert peer["agrees"] or name in NOT_EXACT
        assert name in text
    assert peers["gazempc"]["worst_difference_rad"] < 1e-6
    assert 0 < peers["gazempc"]["step_median_ms"] <= peers["gazempc"]["step_p99_ms"]
    assert peers["do_mpc"]["median_ms"] > 20 * peers["gazempc"]["median_ms"]


@pytest.mark.slow
def test_the_run_is_described(measured):
    text, figures = measured
    assert 0 < figures["ticks_with_limits"] <= figures["ticks"] == 25
    assert figures["ticks_softened"] == 0
    assert f"A limit binds in {figures['ticks_with_limits']} of 25 ticks" in text
    assert [row["horizon_steps"] for row in figures["growth"]] == [20]
    for row in figures["growth"]:
        assert 0 < row["median_ms"] <= row["p99_ms"]
        assert row["worst_difference_rad"] < 1e-6
        assert sum(row["solvers"].values()) == 2 * 25
        assert "none" not in row["solvers"]


def test_the_whole_run_makes_every_limit_bind_and_none_is_left():
    run = simulate(NECK, STEPS, 500)
    assert run.softened == 0
    assert 200 < run.binding.sum() < 300
    assert min(run.by_limit.values()) > 20


def test_the_run_poses_what_the_controller_solves(monkeypatch):
    """States come from the joints' history and the commands on their way, by another way than in the controller.

    The program is that of a joint which is on its way to nobody, with the controller's own steps.
    """
    monkeypatch.setattr("gazempc.controllers.mpc.acquisition.ACQUIRED_FROM_RAD", np.inf)
    run = simulate(NECK, STEPS, 60)
    lengths = growing_steps(STEPS * NECK.control_period_s, NECK.control_period_s)
    ends = np.cumsum(lengths) - 1
    mpc = Mpc(NECK, smoothing_time_s=SMOOTHING_TIME_S)
    ours = [AxisOcp(AxisModel(NECK, i, lengths, 20), SMOOTHING_TIME_S) for i in range(2)]
    for states, references, situation in zip(run.states, run.references, run.situations, strict=True):
        command = [ocp.solve(states[i], references[i, ends]).command[0] for i, ocp in enumerate(ours)]
        assert mpc.plan(situation).position_rad[1:] == pytest.approx(np.transpose(command), abs=1e-6)


def test_solver_without_a_solution_is_counted_not_hidden():
    run = simulate(NECK, STEPS, 20)
    peer = Gazempc(NECK, STEPS, SMOOTHING_TIME_S)
    first = solve_all(peer, run)[1]
    run.references[3] = np.nan
    first[7] += 2e-4
    figures = measure(peer, run, first)
    assert (figures.agrees, figures.failures, figures.ticks_over) == (False, 1, 1)
    assert figures.worst_difference_rad == pytest.approx(2e-4)


def test_peer_that_is_not_installed_is_named(monkeypatch, capsys):
    monkeypatch.setattr(DoMpc, "module", "do_mpc_that_is_not_there")
    assert mpc_solvers.main(["--ticks", "20", "--peers", "do_mpc", "--growth"]) == 0
    text = capsys.readouterr().out
    assert "do_mpc: skipped, not installed: pip install do-mpc" in text
    assert "\ngazempc " in text


def test_unknown_peer_is_refused(capsys):
    assert mpc_solvers.main(["--peers", "osqq"]) == 2
    assert "perhaps you meant 'osqp'" in capsys.readouterr().err
