"""The comparison over many recordings: right means, resumable, and no crash on a bad recording."""

import csv
import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from experiments.engine.jobs import execute, fitted_hash

from experiments.aggregate import add_gap_closed, bootstrap_mean, paired_differences, summarise
from experiments.compare import CompareSettings, compare, main, make_jobs
from experiments.engine.recordings import find_recordings
from gazempc.errors import GazempcError
from gazempc.recordings.synthetic.walks import synthetic_names
from gazempc.settings import WalkerSettings
from predictors.walker.network import shipped_walker_model

ROOT = Path(__file__).resolve().parents[2]
# The only figures that differ from run to run.
TIMING = {
    "update_ms_p50",
    "update_ms_p99",
    "update_ms_max",
    "step_ms_p50",
    "step_ms_p99",
    "step_ms_max",
    "missed_deadlines",
}


def settings(out, **changes):
    values = {
        "recordings": ("subject01_R1", "subject01_R4", "subject02_R6"),
        "controllers": ("reactive", "lookahead", "perfect"),
        "jobs": 2,
        "out": out,
        "figures": False,
    }
    return CompareSettings(**(values | changes))


def rows_of(out):
    with (out / "results.csv").open(newline="") as file:
        return [{k: v for k, v in row.items() if k not in TIMING} for row in csv.DictReader(file)]


def test_bootstrap_of_equal_values_has_no_spread():
    assert bootstrap_mean([2.0, 2.0, 2.0], ["a", "b", "b"]) == (2.0, 2.0, 2.0)


def test_every_clip_weighs_the_same():
    mean, low, high = bootstrap_mean([1.0, 2.0, 3.0, 10.0], ["a", "a", "a", "b"])
    assert mean == 4.0
    assert low == pytest.approx(2.0)
    assert high == pytest.approx(10.0)


def test_the_interval_has_its_coverage():
    """20 people with one clip each, unit spread: the interval's half width is near 1.96 / sqrt(20)."""
    values = np.random.default_rng(1).standard_normal(20)
    _, low, high = bootstrap_mean(values, [str(i) for i in range(20)])
    assert (high - low) / 2 == pytest.approx(1.96 * values.std() / np.sqrt(20), rel=0.1)


def test_one_person_has_no_interval_and_nan_does_not_count():
    mean, low, high = bootstrap_mean([1.0, np.nan, 3.0], ["a", "a", "a"])
    assert mean == 2.0
    assert np.isnan(low)
    assert np.isnan(high)


def row(recording, controller, rms, subject="s", group="turn", predictor="p"):
    labels = {"recording": recording, "source": recording, "kind": "synthetic", "subject": subject, "group": group}
    return labels | {
        "controller": controller,
        "predictor": predictor,
        "neck": "n",
        "seed": 0,
        "gaze_error_rms_deg": rms,
    }


def test_gap_closed_summary_and_differences_by_hand():
    rows = [
        row("a", "reactive", 10.0, "x"),
        row("a", "lookahead", 4.0, "x"),
        row("a", "mpc", 3.0, "x"),
        row("a", "perfect", 1.0, "x", predictor="perfect"),
        row("b", "reactive", 20.0, "y"),
        row("b", "lookahead", 5.0, "y"),
        row("b", "mpc", 7.0, "y"),
        row("b", "perfect", 0.0, "y", predictor="perfect"),
    ]
    add_gap_closed(rows)
    gaps = {(r["recording"], r["controller"]): r["gap_closed"] for r in rows}
    assert gaps["a", "mpc"] == pytest.approx(7 / 9)
    assert gaps["b", "mpc"] == pytest.approx(13 / 20)
    assert gaps["a", "perfect"] == 1.0
    table = {(r["group"], r["controller"]): r for r in summarise(rows)}
    assert table["turn", "mpc"]["gaze_error_rms_deg"] == 5.0
    assert table["all", "mpc"]["n_people"] == 2
    assert table["all", "mpc"]["gap_closed"] == pytest.approx((7 / 9 + 13 / 20) / 2)
    differences = paired_differences(rows, "gaze_error_rms_deg", "mpc", "lookahead")
    assert [d["difference"] for d in differences] == [0.5, 0.5]
    assert differences[0]["ci95"] == pytest.approx([-1.0, 2.0])
    assert (differences[0]["n_clips"], differences[0]["n_less"], differences[0]["n_more"]) == (2, 1, 1)


def test_clips_without_the_figure_are_no_pair():
    rows = [row(clip, gaze, 1.0, "x") for clip in "abc" for gaze in ("lookahead", "mpc")]
    for entry, overshoot_deg in zip(rows, (2.0, 1.5, None, 1.0, 0.5, 0.5), strict=True):
        entry["overshoot_deg"] = overshoot_deg
    (_, everyone) = paired_differences(rows, "overshoot_deg", "mpc", "lookahead")
    assert everyone["difference"] == -0.25
    assert (everyone["n_clips"], everyone["n_less"], everyone["n_more"]) == (2, 1, 0)
    for entry in rows:
        entry["overshoot_deg"] = None
    assert paired_differences(rows, "overshoot_deg", "mpc", "lookahead") == []


def test_a_comparison_writes_its_tables(tmp_path):
    assert compare(settings(tmp_path)) == 0
    rows = rows_of(tmp_path)
    assert len(rows) == 9
    assert {r["group"] for r in rows} == {"straight", "turn", "sharp"}
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert {r["group"] for r in summary["rows"]} == {"straight", "turn", "sharp", "all"}
    means = [float(r["gaze_error_rms_deg"]) for r in rows if r["controller"] == "lookahead"]
    entry = next(r for r in summary["rows"] if r["group"] == "all" and r["controller"] == "lookahead")
    assert entry["gaze_error_rms_deg"] == pytest.approx(np.mean(means))
    assert entry["n_clips"] == 3
    assert entry["n_people"] == 2
    assert "Limit violations in all runs: 0." in (tmp_path / "summary.md").read_text()


def test_a_gaze_that_starts_aside_is_compared_by_contact_and_overshoot(tmp_path):
    aside = {"controllers": ("lookahead", "mpc"), "start_offset_deg": 60.0, "recordings": ("subject01_R1",)}
    assert compare(settings(tmp_path, **aside)) == 0
    by_gaze = {r["controller"]: r for r in rows_of(tmp_path)}
    later_s = [float(by_gaze[gaze]["time_to_stable_contact_s"]) for gaze in ("mpc", "lookahead")]
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["mpc_minus_lookahead_stable_contact_s"][0]["difference"] == pytest.approx(later_s[0] - later_s[1])
    # From where it is aimed at the person there is no way to them: nothing to overshoot.
    text = (tmp_path / "summary.md").read_text()
    assert "time to stable contact where both reach it [s]" in text
    assert "overshoot where both reach the person [deg]" in text


def test_killed_in_the_middle_it_goes_on_and_ends_the_same(tmp_path):
    """SIGKILL after the first results: started again it does only the rest, and the tables are the same."""
    words = ["--recordings", "subject01_R1", "subject01_R4", "subject02_R6", "--controllers", "reactive", "lookahead"]
    words += ["perfect", "--no-figures", "--jobs", "1", "--out", str(tmp_path / "killed")]
    process = subprocess.Popen(
        [sys.executable, "-m", "experiments.compare", *words],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    runs = tmp_path / "killed" / "runs"
    give_up_s = time.monotonic() + 60
    while len(list(runs.glob("*.json"))) < 2 and time.monotonic() < give_up_s:
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    before = {path: path.stat().st_mtime_ns for path in runs.glob("*.json")}
    assert 2 <= len(before) < 9
    assert main(words) == 0
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in before.items())
    assert compare(settings(tmp_path / "undisturbed")) == 0
    assert rows_of(tmp_path / "killed") == rows_of(tmp_path / "undisturbed")


def test_a_bad_recording_is_a_row_and_not_a_crash(tmp_path):
    (tmp_path / "bad.csv").write_text("t,head_x\n0,1\n")
    status = compare(settings(tmp_path / "out", recordings=(str(tmp_path / "bad.csv"), "subject01_R1"), jobs=1))
    assert status == 1
    failed = [r for r in rows_of(tmp_path / "out") if r["failed"]]
    assert len(failed) == 3
    assert "bad.csv" in failed[0]["failed"]


def test_a_clip_that_comes_too_near_is_left_out_and_counted(tmp_path):
    near = settings(tmp_path, recordings=("subject01_R1",), placement="side", distance_m=0.5, jobs=1)
    assert compare(near) == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["n_left_out"] == 1
    assert summary["rows"] == []


def test_default_predictor_and_one_perfect_run_for_all():
    jobs = make_jobs(settings(Path("x"), predictors=("default", "walker", "head_pose")))
    assert sum(job.controller == "perfect" for job in jobs) == 3
    assert {job.predictor for job in jobs if job.controller == "reactive"} == {"walker", "head_pose"}


def test_a_job_is_named_by_all_it_depends_on(tmp_path):
    jobs = make_jobs(settings(tmp_path))
    assert len({job.key() for job in jobs}) == len(jobs)
    assert make_jobs(settings(tmp_path, seed=1))[0].key() != jobs[0].key()
    file = tmp_path / "walk.csv"
    file.write_text("one")
    job = make_jobs(settings(tmp_path, recordings=(str(file),)))[0]
    first = job.key()
    file.write_text("two")
    assert job.key() != first


def test_find_recordings(tmp_path):
    for name in ("b.csv", "a.bvh", "index.csv", "notes.txt"):
        (tmp_path / name).write_text("")
    assert find_recordings([str(tmp_path)]) == [str(tmp_path / "a.bvh"), str(tmp_path / "b.csv")]
    assert find_recordings(["synthetic"]) == list(synthetic_names())
    with pytest.raises(GazempcError) as caught:
        find_recordings(["syntetic", str(tmp_path / "none.csv")])
    assert "perhaps you meant 'synthetic'" in str(caught.value)
    assert "none.csv" in str(caught.value)


@pytest.mark.parametrize(
    ("words", "expected"),
    [(["--recordings", "nowhere"], "nowhere"), (["--recordings", "synthetic", "--necks", "x"], "'x'")],
)
def test_bad_input_is_refused_before_anything_runs(words, expected, tmp_path, capsys):
    assert main([*words, "--out", str(tmp_path / "out")]) == 2
    assert expected in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_figures_are_drawn(tmp_path):
    controllers = ("reactive", "lookahead", "mpc", "perfect")
    recordings = ("subject01_R4", "subject02_R4")
    assert compare(settings(tmp_path, recordings=recordings, controllers=controllers, figures=True)) == 0
    names = {path.name for path in tmp_path.glob("*.png")}
    assert names == {
        "gaze_error.png",
        "eye_contact.png",
        "gap_closed.png",
        "error_against_acceleration.png",
        "mpc_minus_lookahead.png",
    }


def test_a_worker_row_names_its_recording():
    job = make_jobs(settings(Path("x"), recordings=("subject01_R1",)))[0]
    assert execute(job)["recording"] == "subject01_R1"


def test_another_fitted_model_is_another_run(tmp_path):
    """A fit into the same folder changes the key, so that old results are not taken for new ones."""
    path = tmp_path / "left_out" / "ann.npz"
    path.parent.mkdir()
    shipped_walker_model().save(tmp_path / "walker.npz")
    keys = []
    for content in (b"one", b"two"):
        path.write_bytes(content)
        fitted_hash.cache_clear()
        walker = WalkerSettings(fitted=tmp_path)
        [job] = make_jobs(settings(tmp_path, recordings=("subject01_R1",), controllers=("mpc",), walker=walker))
        keys.append(job.key())
        assert job.settings().walker.fitted == tmp_path
    assert keys[0] != keys[1]


def test_a_fitted_model_that_is_not_there_is_refused_before_anything_runs(tmp_path):
    with pytest.raises(GazempcError, match=r"walker\.fitted.*nowhere"):
        make_jobs(settings(tmp_path, walker=WalkerSettings(fitted=tmp_path / "nowhere")))


def test_people_that_the_model_has_seen_are_said(tmp_path, capsys):
    model = shipped_walker_model()
    dataclasses.replace(model, about={"people": ["subject01"]}).save(tmp_path / "walker.npz")
    recordings = ("subject01_R1", "subject02_R6")
    chosen = settings(
        tmp_path / "out", recordings=recordings, controllers=("reactive",), walker=WalkerSettings(fitted=tmp_path)
    )
    assert compare(chosen) == 0
    assert "fitted on 1 person of those who walk here" in capsys.readouterr().out
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["people_seen_in_fitting"] == ["subject01"]
