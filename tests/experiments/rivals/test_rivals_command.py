"""The command, its rows, wrong models, and the construction of rivals."""

import inspect
import itertools
import json

import pytest
from builders.replays import quick_neck
from builders.rival_bench import CAMERA

from experiments.rivals.comparison import main
from experiments.rivals.jobs import FIGURES, ModelError, RivalJob, calibrate
from experiments.rivals.laws import RIVALS
from experiments.rivals.plan import ERRORS, at_their_best, by_error, labelled, summarise, wrong_jobs
from experiments.rivals.simulate import driven_by, on_the_head
from experiments.rivals.trials import make_trial
from gazempc.neck.spec import load_neck
from gazempc.sim.sensor import load_sensor

REFERENCE, SENSOR = load_neck("reference"), on_the_head(load_sensor("face_camera"))
ROW_NAMES = {
    "rival", "trial", "neck", "sensor", "overshoot_deg", "settling_s", "reversals", "gaze_error_rms_deg",
    "eye_contact_2p6", "rms_acceleration_rad_s2", "gaze_error_rms_deg_ci95", "eye_contact_2p6_ci95",
}  # fmt: skip


def run_of(rival: str, contact: float, constants: str = "", error_deg: float = 9.0, **labels):
    row = dict.fromkeys(FIGURES) | {"eye_contact_2p6": contact, "gaze_error_rms_deg": error_deg, "rival": rival}
    row |= {"rms_acceleration_rad_s2": 1.0, "constants": constants, "subject": "a"}
    return row | {"trial": "turns", "neck": "n", "sensor": "s", "recording": "w1"} | labels


@pytest.mark.slow
@pytest.mark.usefixtures("in_this_process")
def test_the_command_writes_rows_tables_and_figure(tmp_path, capsys) -> None:
    neck = quick_neck(tmp_path, "reachy_mini")
    words = ["--necks", neck, "--rivals", "humotion", "reactive", "--jobs", "1", "--out", str(tmp_path)]
    words += ["--recordings", "subject01_R1", "subject02_R1", "--trials", "still_seated_left", "pass_2.5m"]
    assert main([*words, "--json", str(tmp_path / "own.json")]) == 0
    rows = json.loads((tmp_path / "own.json").read_text())["rows"]
    trials = ("still_seated_left", "pass_2.5m", "still", "walks")
    assert {(row["rival"], row["trial"]) for row in rows} == {*itertools.product(("humotion", "reactive"), trials)}
    assert all(set(row) >= ROW_NAMES for row in rows)
    walks = {row["rival"]: row for row in rows if row["trial"] == "walks"}
    assert {(row["n_clips"], row["n_people"]) for row in walks.values()} == {(2, 2)}
    low, high = walks["humotion"]["gaze_error_rms_deg_ci95"]
    assert low <= walks["humotion"]["gaze_error_rms_deg"] <= high
    assert walks["humotion"]["overshoot_deg"] is None
    still = [row["settling_s"] for row in rows if row["trial"] == "still_seated_left"]
    assert still == sorted(still)
    assert (tmp_path / "contact_face_camera.png").stat().st_size > 10_000
    text = capsys.readouterr().out
    for trial in ("walks", "still"):  # "still" of one trial alone
        assert f"## {trial}, neck reachy_mini, sensor face_camera" in text
    for row in walks.values():
        assert f"| {row['rival']} | {100 * row['eye_contact_2p6']:.1f} [" in text


def test_free_constants_maximise_eye_contact_on_walks_for_each_neck() -> None:
    runs = [
        run_of("autoptz", 0.2, "speed_scale=0.5"),
        run_of("autoptz", 0.9, "speed_scale=0.5", trial="step"),
        run_of("autoptz", 0.3, "speed_scale=1"),
        run_of("autoptz", 0.1, "speed_scale=1", trial="step"),
        run_of("autoptz", 0.4, "speed_scale=0.5", neck="m"),
        run_of("autoptz", 0.3, "speed_scale=1", neck="m"),
        run_of("mpc", 0.5),
    ]
    shown = {(run["rival"], run["neck"], run["trial"]): run["eye_contact_2p6"] for run in at_their_best(runs)}
    assert shown == {
        ("autoptz", "n", "turns"): 0.3,
        ("autoptz", "n", "step"): 0.1,
        ("autoptz", "m", "turns"): 0.4,
        ("mpc", "n", "turns"): 0.5,
    }


def test_ties_between_constants_are_broken_by_smoothness() -> None:
    figures = [("alpha=0.1", 0.900, 1.0), ("alpha=0.3", 0.955, 2.0), ("alpha=0.5", 0.960, 4.0)]
    runs = [run_of("smith", contact, constants) | {"rms_acceleration_rad_s2": a} for constants, contact, a in figures]
    assert at_their_best(runs) == runs[1:2]


def test_rivals_with_a_steady_state_error_are_ranked_last() -> None:
    near = run_of("mpc", 0.9, trial="step") | {"settling_s": 2.0, "rest_error_deg": 0.3}
    aside = run_of("conversation_app", 0.0, trial="step") | {"settling_s": 0.5, "rest_error_deg": 10.0}
    assert [row["rival"] for row in summarise([aside, near])] == ["mpc", "conversation_app"]


def test_eye_contact_is_compared_with_the_mpc_clip_by_clip() -> None:
    runs = [run_of("mpc", 0.5), run_of("humotion", 0.3)]
    runs += [run_of("mpc", 0.9, subject="b", recording="w2"), run_of("humotion", 0.4, subject="b", recording="w2")]
    behind = {row["rival"]: row for row in summarise(runs)}
    assert behind["humotion"]["eye_contact_behind_mpc"] == pytest.approx(0.35)
    assert behind["humotion"]["eye_contact_behind_mpc_ci95"] == pytest.approx([0.2, 0.5])
    assert behind["mpc"]["eye_contact_behind_mpc"] == 0.0
    assert summarise(runs[1:2])[0]["eye_contact_behind_mpc"] is None


def test_a_wrong_model_does_not_retune_the_constants() -> None:
    tried = [("smith", {"gain": 1.0}, 0.6), ("smith", {"gain": 0.5}, 0.4), ("humotion", {}, 0.9)]
    jobs = [RivalJob(rival, "turns", "w1", REFERENCE, SENSOR, constants=constants) for rival, constants, _ in tried]
    done = {"left_out": None, "failed": None, "gaze_error_rms_deg": 5.0, "rms_acceleration_rad_s2": 1.0}
    wrong = wrong_jobs(jobs, labelled(jobs, [done | {"eye_contact_2p6": contact} for *_, contact in tried]))
    assert {(job.rival, job.constants["gain"]) for job in wrong} == {("smith", 1.0)}
    assert [job.error for job in wrong] == [error for error in ERRORS if error != ModelError()]
    late = ModelError(dead_time_scale=1.3)
    found = by_error([run_of("smith", 0.6, "gain=1", error=ModelError()), run_of("smith", 0.1, "gain=1", error=late)])
    rows = [row for row in found["dead time"] if row["trial"] == "turns"]
    assert [(row["by"], row["eye_contact_2p6"]) for row in rows] == [(0.0, 0.6), (30.0, 0.1)]
    assert {(row["by"], row["error"]) for row in found["latency"]} == {(0.0, "latency")}


def test_a_wrong_model_changes_the_law_and_not_the_plant() -> None:
    error = ModelError(dead_time_scale=1.3, servo_scale=0.8, latency_error_s=0.05)
    believed = error.neck(REFERENCE)
    assert believed.pan.dead_time_s == pytest.approx(1.3 * REFERENCE.pan.dead_time_s)
    assert believed.tilt.natural_frequency_rad_s == pytest.approx(0.8 * REFERENCE.tilt.natural_frequency_rad_s)
    log = RivalJob("smith", "step", None, REFERENCE, SENSOR, error=error).log(make_trial("step", None))
    # The log has the true neck, with the command of the law.
    assert log.neck == driven_by(REFERENCE, "position")
    # With a longer modelled latency each frame gets an earlier capture time.
    assert log.capture_time_s[0] == pytest.approx(-0.05, abs=1e-9)


def test_calibration_measures_the_top_speed_of_a_neck():
    """Half the field of view takes at least its angle over the top speed; large moves settle later than small ones."""
    neck = load_neck("reachy_mini")
    found = calibrate(neck, CAMERA)
    least_s = CAMERA.half_width_rad / neck.pan.velocity_max_rad_s
    assert least_s < found.slope_s < 1.6 * least_s
    assert neck.pan.dead_time_s < found.offset_s < 0.6
    assert found.zero_move_s < 0.05


@pytest.mark.parametrize("law", [law for law in RIVALS.values() if law.free != ({},)])
def test_free_constants_are_keywords_and_include_the_default(law):
    parameters = inspect.signature(law).parameters
    own = {name: parameters[name].default for name in law.free[0]}
    assert own in law.free
    assert all(constants.keys() == own.keys() for constants in law.free)
    assert len({tuple(constants.items()) for constants in law.free}) == len(law.free)
