"""Positions of people in the trials, their visibility, and the choice of recordings."""

import numpy as np
import pytest

from experiments.rivals.comparison import STANDING
from experiments.rivals.plan import make_jobs
from experiments.rivals.simulate import on_the_head
from experiments.rivals.trials import LOSS_S, SIT, STAND, make_trial, takes
from gazempc.errors import LeftOutError
from gazempc.neck.kinematics import look_at_rad
from gazempc.neck.spec import Geometry, load_neck
from gazempc.recordings.recording import Labels, TrueHead
from gazempc.sim.sensor import load_sensor

WALK = "subject01_R1"


def angles_deg(walk, times_s):
    return np.rad2deg(look_at_rad(Geometry(), TrueHead(walk)(np.asarray(times_s))))


@pytest.mark.parametrize("name", ["still_seated_left", "still_standing_centre", "still_standing_right"])
def test_still_faces_are_at_their_stated_angles(name: str) -> None:
    trial = make_trial(name, None)
    pan = {"centre": 0.0, "left": 20.0, "right": -20.0}[name.split("_")[2]]
    tilt = {"seated": 8.0, "standing": 22.0}[name.split("_")[1]]
    np.testing.assert_allclose(angles_deg(trial.walk, [1.0, 9.0, 16.0]), [[pan, tilt]] * 3, atol=1e-9)
    assert trial.start_rad == (0.0, 0.0)
    assert trial.joint == (1 if pan == 0.0 else 0)
    assert trial.walk.times_s[-1] == pytest.approx(16.0)
    np.testing.assert_array_equal(trial.walk.truth.valid, trial.walk.times_s >= trial.event_s)


def test_the_step_is_30_deg_and_the_ramp_20_deg_a_second() -> None:
    step, ramp = (make_trial(name, None) for name in ("step", "ramp"))
    np.testing.assert_allclose(angles_deg(step.walk, [2.9, 3.1])[:, 0], [-15.0, 15.0], atol=0.01)
    pan = angles_deg(ramp.walk, [2.0, 4.0, 5.0, 6.0, 8.0])[:, 0]
    np.testing.assert_allclose(pan, [-40.0, -20.0, 0.0, 20.0, 40.0], atol=1e-3)
    assert ramp.event_s == 7.0


def test_walks_pass_at_the_stated_distance() -> None:
    near, far = (make_trial(name, WALK).walk.truth.head_position_m for name in ("pass_1.0m", "pass_2.5m"))
    assert np.nanmin(np.hypot(*near[:, :2].T)) == pytest.approx(1.0, abs=0.15)
    assert np.nanmin(np.hypot(*far[:, :2].T)) == pytest.approx(2.5, abs=0.15)


def test_straight_walks_are_passes_and_others_are_turns() -> None:
    def labels(group):
        return Labels("anna", group)

    assert takes("pass_1.0m", labels("straight"))
    assert takes("pass_2.5m", labels(None))
    assert takes("turns", labels("sharp"))
    assert not takes("turns", labels("straight"))
    assert not takes("loss", labels("turn"))


def test_a_recorded_standing_person_is_at_the_distance_of_the_still_face() -> None:
    """The recorded head moves; the still face of the other trials is its reference."""
    trial = make_trial(STAND, "subject03_stand")
    head_m = trial.walk.truth.head_position_m[trial.walk.truth.valid]
    assert np.hypot(*head_m[:, :2].mean(axis=0)) == pytest.approx(1.5, abs=0.1)
    assert 0.005 < np.ptp(head_m[:, :2], axis=0).max() < 0.5
    assert trial.event_s is None


def test_the_face_is_lost_for_1_s_and_the_person_stops() -> None:
    trial, walk = make_trial("loss", WALK), make_trial("pass_2.5m", WALK).walk
    lost = trial.walk.times_s[~trial.walk.truth.valid]
    assert lost[-1] - lost[0] == pytest.approx(LOSS_S, abs=0.05)
    assert trial.back_s == pytest.approx(lost[-1], abs=0.05)
    end_s = walk.times_s[-1]
    kept = trial.walk.truth.valid[: walk.times_s.size]
    before, after = (np.asarray(w.truth.head_position_m)[: walk.times_s.size][kept] for w in (walk, trial.walk))
    np.testing.assert_array_equal(before, after)
    heads = TrueHead(trial.walk)([end_s + 3.0, end_s + 4.0])
    np.testing.assert_allclose(heads[0], heads[1], atol=1e-4)
    assert np.linalg.norm(TrueHead(trial.walk)([end_s + 0.01, end_s])[0] - walk.truth.head_position_m[-1]) < 0.03


def test_a_walk_that_comes_too_near_is_left_out() -> None:
    with pytest.raises(LeftOutError, match="comes within"):
        make_trial("pass_1.0m", "subject01_R4")


NECK, SENSOR = load_neck("reachy_mini"), on_the_head(load_sensor("face_camera"))


def jobs_with(standing, trials=(STAND, SIT)):
    return [(job.trial, job.recording) for job in make_jobs(["mpc"], [], [NECK], [SENSOR], 0, trials, standing)]


def test_sitting_people_are_selected_by_their_kind_label(tmp_path):
    times_s = np.arange(0.0, 3.0, 0.04)
    sway_m = 0.01 * np.sin(times_s)
    for name in ("anna", "bert"):
        rows = np.stack([times_s, 2.0 + sway_m, sway_m, 1.5 + 0.0 * times_s], axis=1)
        np.savetxt(tmp_path / f"{name}.csv", rows, "%.4f", ",", header="t,head_x,head_y,head_z", comments="")
    (tmp_path / "index.csv").write_text("clip,subject,group,kind\nanna,anna,standing,sitting\nbert,bert,standing,\n")
    anna, bert = (str(tmp_path / f"{name}.csv") for name in ("anna", "bert"))
    assert jobs_with([anna, bert]) == [(STAND, bert), (SIT, anna)]


def test_standing_people_are_synthetic_by_default():
    assert jobs_with(STANDING) == [(STAND, name) for name in STANDING]


@pytest.mark.parametrize("name", ["loss", "stop"])
def test_a_walk_of_few_frames_a_second_ends_in_standing(name, tmp_path):
    times_s = np.arange(30) / 5.0
    rows = np.transpose([times_s, np.full(30, 2.5), 1.0 * times_s - 3.0, np.full(30, 0.3)])
    path = tmp_path / "walk.csv"
    np.savetxt(path, rows, "%.6f", ",", header="t,head_x,head_y,head_z", comments="")
    walk = make_trial(name, str(path)).walk
    last_m = walk.truth.head_position_m[-5:]
    assert np.ptp(last_m, axis=0).max() < 0.01
