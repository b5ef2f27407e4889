"""Trials with people who really stand or sit, beside the motionless face."""

import json

import numpy as np
import pytest

from experiments.rivals.comparison import STANDING, main
from experiments.rivals.plan import make_jobs
from experiments.rivals.simulate import on_the_head
from experiments.rivals.trials import SIT, STAND, make_trial
from gazempc.errors import LeftOutError
from gazempc.neck.spec import load_neck
from gazempc.sim.sensor import load_sensor

NECK, SENSOR = load_neck("reachy_mini"), on_the_head(load_sensor("face_camera"))


def jobs_with(standing, trials=(STAND, SIT)):
    return [(job.trial, job.recording) for job in make_jobs(["mpc"], [], [NECK], [SENSOR], 0, trials, standing)]


def test_the_label_of_the_kind_tells_who_sits(tmp_path):
    times_s = np.arange(0.0, 3.0, 0.04)
    sway_m = 0.01 * np.sin(times_s)
    for name in ("anna", "bert"):
        rows = np.stack([times_s, 2.0 + sway_m, sway_m, 1.5 + 0.0 * times_s], axis=1)
        np.savetxt(tmp_path / f"{name}.csv", rows, "%.4f", ",", header="t,head_x,head_y,head_z", comments="")
    (tmp_path / "index.csv").write_text("clip,subject,group,kind\nanna,anna,standing,sitting\nbert,bert,standing,\n")
    anna, bert = (str(tmp_path / f"{name}.csv") for name in ("anna", "bert"))
    assert jobs_with([anna, bert]) == [(STAND, bert), (SIT, anna)]


def test_without_the_option_synthetic_people_stand():
    assert jobs_with(STANDING) == [(STAND, name) for name in STANDING]


@pytest.mark.slow
@pytest.mark.usefixtures("in_this_process")
def test_people_who_stand_have_rows_of_their_own(tmp_path, capsys):
    words = ["--standing", "subject01_stand", "subject02_stand", "--trials", STAND, "--necks", "reachy_mini"]
    assert main([*words, "--rivals", "humotion", "mpc", "--jobs", "1", "--out", str(tmp_path)]) == 0
    rows = {row["rival"]: row for row in json.loads((tmp_path / "rows.json").read_text())["rows"]}
    assert {(row["trial"], row["n_clips"], row["n_people"]) for row in rows.values()} == {(STAND, 2, 2)}
    assert rows["humotion"]["eye_contact_behind_mpc"] == pytest.approx(
        rows["mpc"]["eye_contact_2p6"] - rows["humotion"]["eye_contact_2p6"]
    )
    text = capsys.readouterr().out
    assert f"## {STAND}, neck reachy_mini, sensor face_camera" in text
    assert f"| mpc | {100.0 * rows['mpc']['eye_contact_2p6']:.1f}" in text


@pytest.mark.slow
def test_recorded_people_who_stand_are_placed_and_move(standing_dir):
    """Motion capture, where it is beside the checkout."""
    made = []
    for path in sorted(standing_dir.glob("*.csv")):
        if path.name != "index.csv":
            try:
                made.append(make_trial(STAND, str(path)))
            except LeftOutError:
                continue
    assert made
    for trial in made:
        heads_m = trial.walk.truth.head_position_m[trial.walk.truth.valid]
        assert np.hypot(*heads_m[:, :2].T).min() >= 0.8
        assert np.hypot(*heads_m[:, :2].mean(axis=0)) == pytest.approx(1.5, abs=0.3)
        assert np.ptp(heads_m, axis=0).max() > 0.005
