"""Trials with people who really stand or sit, beside the motionless face."""

import numpy as np

from experiments.rivals.comparison import STANDING
from experiments.rivals.plan import make_jobs
from experiments.rivals.simulate import on_the_head
from experiments.rivals.trials import SIT, STAND
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
