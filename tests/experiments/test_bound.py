"""The lower bound on gaze error under limits, compared with controllers within the limits."""

import csv
import json
import math

import numpy as np
import pytest
from builders.replays import replayed

from experiments.bound import COLUMNS, least_error_deg, main, summarise
from gazempc.neck.spec import load_neck
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.results.metrics import measure
from gazempc.sim.replay import ReplaySettings
from gazempc.sim.sensor import load_sensor

pytestmark = pytest.mark.usefixtures("in_this_process")


def perfect(neck, recording, start_offset_deg=0.0):
    placed = place(load(recording), "side", 2.5, 1.2)
    settings = ReplaySettings(start_offset_deg=start_offset_deg)
    log = replayed(placed, "mpc+perfect", settings=settings, neck=load_neck(neck), sensor=load_sensor("perfect"))
    moving = np.flatnonzero(np.any(log.command_position_rad != log.command_position_rad[0], axis=1))
    return log, float(log.time_s[moving[0]])


def test_without_active_limits_the_least_error_is_zero():
    log, first_observation_s = perfect("reference", "subject03_R1")
    assert least_error_deg(log, first_observation_s) < 0.02


def test_with_active_limits_perfect_foresight_is_close_to_the_bound():
    """The MPC with the true future, another program and solver, is close to the bound and never below it."""
    log, first_observation_s = perfect("slow", "subject03_R4", 60.0)
    error_deg, least_deg = measure(log).gaze_error_rms_deg, least_error_deg(log, first_observation_s)
    assert error_deg > 1.0
    assert 0.95 * error_deg < least_deg < error_deg
    # A later forecast increases the error.
    assert least_error_deg(log, first_observation_s + 0.2) > least_deg


@pytest.mark.slow
def test_the_command_prints_and_saves_all_bounds(tmp_path, capsys):
    recordings = ["subject01_R1", "subject03_R5"]  # the first is too near
    status = main(["--recordings", *recordings, "--distance-m", "0.7", "--out", str(tmp_path)])
    printed = capsys.readouterr().out
    assert status == 0
    saved = json.loads((tmp_path / "bound.json").read_text())
    assert saved["settings"]["neck"] == "slow"
    assert "gazempc" in saved["versions"]
    rows = {row["group"]: row for row in saved["rows"]}
    assert rows["all"]["clips"] == 1
    assert rows["all"]["bound"] < min(rows["all"][name] for name in COLUMNS[:-1])
    assert f"{rows['all']['bound']:.2f}" in printed
    with (tmp_path / "bound.csv").open() as file:
        assert [row["recording"] for row in csv.DictReader(file)] == recordings


def test_a_walk_too_near_is_excluded_and_named(tmp_path, capsys):
    assert main(["--recordings", "subject03_R5", "--distance-m", "0.3", "--out", str(tmp_path)]) == 0
    assert "left out subject03_R5" in capsys.readouterr().out


def test_groups_are_means():
    rows = [dict.fromkeys(COLUMNS, 2.0 * k) | {"group": g} for k, g in enumerate(("straight", "straight", "turn"), 1)]
    straight, turn, both = summarise(rows)
    assert (straight["clips"], straight["mpc"], turn["mpc"], both["mpc"]) == (2, 3.0, 6.0, 4.0)
    assert math.isclose(both["bound_to_lookahead"], 1.0)


def test_a_neck_with_eyes_has_no_bound_and_is_refused(tmp_path, capsys):
    assert main(["--recordings", "subject01_R1", "--neck", "furhat", "--out", str(tmp_path)]) == 2
    assert "accepted: necks of pan and tilt only" in capsys.readouterr().err
