"""The comparison over many recordings: right means, resumable, and no crash on a bad recording."""

import csv
import dataclasses
import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from builders.own_parts import own_module

from experiments.aggregate import add_gap_closed, bootstrap_mean, paired_differences, summarise
from experiments.compare import CompareSettings, compare, main, runs_of
from experiments.engine.keys import models_hash
from experiments.engine.own_parts import name_parts, parts_hash
from experiments.engine.recordings import find_recordings
from gazempc.errors import GazempcError, SettingsError
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
    return values | changes


def runs(out, **changes):
    return runs_of(CompareSettings(**settings(out, **changes)))


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
    compare(**settings(tmp_path))
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
    compare(**settings(tmp_path, **aside))
    by_gaze = {r["controller"]: r for r in rows_of(tmp_path)}
    later_s = [float(by_gaze[gaze]["time_to_stable_contact_s"]) for gaze in ("mpc", "lookahead")]
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["mpc_minus_lookahead_stable_contact_s"][0]["difference"] == pytest.approx(later_s[0] - later_s[1])
    # From where it is aimed at the person there is no way to them: nothing to overshoot.
    text = (tmp_path / "summary.md").read_text()
    assert "time to stable contact where both reach it [s]" in text
    assert "overshoot where both reach the person [deg]" in text


def test_interrupted_in_the_middle_it_goes_on_and_ends_the_same(tmp_path):
    """One SIGTERM after the first results: started again it does only the rest, and the tables are the same."""
    words = ["--recordings", "subject01_R1", "subject01_R4", "--controllers", "reactive", "lookahead", "perfect"]
    words += ["--no-figures", "--jobs", "1", "--out", str(tmp_path / "stopped")]
    process = subprocess.Popen(
        [sys.executable, "-m", "experiments.compare", *words], cwd=ROOT, stderr=subprocess.PIPE, text=True
    )
    kept = tmp_path / "stopped" / "runs"
    while len(list(kept.glob("*.json"))) < 2:
        assert process.poll() is None, process.stderr.read()
    process.send_signal(signal.SIGTERM)
    _, error = process.communicate(timeout=60)
    before = {path: path.stat().st_mtime_ns for path in kept.glob("*.json")}
    assert process.returncode == 143
    assert f"compare: interrupted: {len(before)} of 6 results are kept in {kept}" in error
    assert main(words) == 0
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in before.items())
    compare(**settings(tmp_path / "undisturbed", recordings=("subject01_R1", "subject01_R4"), jobs=1))
    assert rows_of(tmp_path / "stopped") == rows_of(tmp_path / "undisturbed")


def test_a_bad_recording_is_a_row_and_not_a_crash(tmp_path):
    (tmp_path / "bad.csv").write_text("t,head_x\n0,1\n")
    words = ["--recordings", str(tmp_path / "bad.csv"), "subject01_R1", "--controllers", "reactive", "lookahead"]
    assert main([*words, "--jobs", "1", "--no-figures", "--out", str(tmp_path / "out")]) == 1
    failed = [r for r in rows_of(tmp_path / "out") if r["failed"]]
    assert len(failed) == 2
    assert "bad.csv" in failed[0]["failed"]
    assert failed[0]["controller"] == "reactive"


def test_a_clip_that_comes_too_near_is_left_out_and_counted(tmp_path):
    near = settings(tmp_path, recordings=("subject01_R1",), placement="side", distance_m=0.5, jobs=1)
    assert {row["failed"] for row in compare(**near)} == {None}
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["n_left_out"] == 1
    assert summary["rows"] == []


def test_default_predictor_and_one_perfect_run_for_all():
    labels = [run.labels for run in runs(Path("x"), predictors=("default", "walker", "head_pose"))]
    assert sum(row["controller"] == "perfect" for row in labels) == 3
    assert {row["predictor"] for row in labels if row["controller"] == "reactive"} == {"walker", "head_pose"}


def test_a_job_is_named_by_all_it_depends_on(tmp_path):
    jobs = [run.job for run in runs(tmp_path)]
    assert len({job.key() for job in jobs}) == len(jobs)
    assert runs(tmp_path, seed=1)[0].job.key() != jobs[0].key()
    file = tmp_path / "walk.csv"
    file.write_text("one")
    job = runs(tmp_path, recordings=(str(file),))[0].job
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
    compare(**settings(tmp_path, recordings=recordings, controllers=controllers, figures=True))
    names = {path.name for path in tmp_path.glob("*.png")}
    assert names == {
        "gaze_error.png",
        "eye_contact.png",
        "gap_closed.png",
        "error_against_acceleration.png",
        "mpc_minus_lookahead.png",
    }


def test_another_fitted_model_is_another_run(tmp_path):
    """A fit into the same folder changes the key, so that old results are not taken for new ones."""
    path = tmp_path / "left_out" / "ann.npz"
    path.parent.mkdir()
    shipped_walker_model().save(tmp_path / "walker.npz")
    keys = []
    for content in (b"one", b"two"):
        path.write_bytes(content)
        walker = WalkerSettings(fitted=tmp_path)
        [run] = runs(tmp_path, recordings=("subject01_R1",), controllers=("mpc",), walker=walker)
        keys.append(run.job.key())
        assert run.job.settings.walker.fitted == tmp_path
    assert keys[0] != keys[1]
    assert models_hash(tmp_path / "walker.npz") != models_hash(tmp_path)


def test_a_fitted_model_that_is_not_there_is_refused_before_anything_runs(tmp_path):
    with pytest.raises(GazempcError, match=r"walker\.fitted.*nowhere"):
        runs(tmp_path, walker=WalkerSettings(fitted=tmp_path / "nowhere"))


def test_people_that_the_model_has_seen_are_said(tmp_path):
    model = shipped_walker_model()
    dataclasses.replace(model, about={"people": ["subject01"]}).save(tmp_path / "walker.npz")
    recordings = ("subject01_R1", "subject02_R6")
    chosen = settings(
        tmp_path / "out", recordings=recordings, controllers=("reactive",), walker=WalkerSettings(fitted=tmp_path)
    )
    compare(**chosen)
    assert "fitted on 1 person of those who walk here" in (tmp_path / "out" / "summary.md").read_text()
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["people_seen_in_fitting"] == ["subject01"]


def test_parts_of_ones_own_are_compared_with_options_and_under_their_names(tmp_path, monkeypatch):
    own = own_module(tmp_path, monkeypatch)
    both = {"controllers": (f"{own}:Sluggish", "lookahead"), "predictors": (f"{own}:Steady", "constant_velocity")}
    chosen = settings(tmp_path / "out", recordings=("subject01_R4",), **both, options={"share": 1.0}, figures=True)
    rows = {(row["controller"], row["predictor"]): row for row in compare(**chosen)}
    assert set(rows) == {(c, p) for c in ("sluggish", "lookahead") for p in ("steady", "constant_velocity")}
    assert len({row["gaze_error_rms_deg"] for row in rows.values()}) == 1
    assert "| sluggish | steady |" in (tmp_path / "out" / "summary.md").read_text()
    words = ["--recordings", "subject01_R4", "--controllers", f"{own}:Sluggish", "--jobs", "1", "--no-figures"]
    assert main([*words, "--options.share", "0.5", "--out", str(tmp_path / "other")]) == 0
    (other,) = rows_of(tmp_path / "other")
    assert float(other["gaze_error_rms_deg"]) > 1.5 * rows["sluggish", "steady"]["gaze_error_rms_deg"]


def test_the_source_of_a_part_of_ones_own_is_in_the_key(tmp_path, monkeypatch):
    own = own_module(tmp_path, monkeypatch)
    chosen = {"recordings": ("subject01_R4",), "controllers": (f"{own}:Sluggish",)}
    first = runs(tmp_path, **chosen)[0].job.key()
    changed = own_module(tmp_path, monkeypatch, "changed_parts", more="# changed")
    assert own != changed
    hashes = [parts_hash(f"{name}:Sluggish", "walker") for name in (own, changed)]
    assert hashes[0] != hashes[1]
    assert parts_hash("mpc", "walker") == []
    assert first != runs(tmp_path, **{**chosen, "controllers": ("lookahead",)})[0].job.key()


def test_the_sources_of_a_folder_without_init_are_in_the_key(tmp_path, monkeypatch):
    hashes = []
    for i, more in enumerate(("", "# changed")):
        (tmp_path / f"loose{i}").mkdir()
        own_module(tmp_path / f"loose{i}", monkeypatch, more=more)
        monkeypatch.chdir(tmp_path)
        monkeypatch.syspath_prepend(str(tmp_path))
        hashes.append(parts_hash(f"loose{i}.my_parts:Sluggish", "walker"))
    assert hashes[0] != hashes[1]


def test_exceptions_that_runs_survived_are_said_and_kept(tmp_path, monkeypatch, capsys):
    fails = """

class Failing(Steady):
    name = "failing"
    calls = 0

    def forecast(self, times_s):
        Failing.calls += 1
        if Failing.calls > 50:
            raise TypeError("too often")
        return super().forecast(times_s)
"""
    own = own_module(tmp_path, monkeypatch, "failing_parts", more=fails)
    words = ["--recordings", "subject01_R4", "--controllers", "reactive", "--predictors", f"{own}:Failing"]
    assert main([*words, "--jobs", "1", "--no-figures", "--out", str(tmp_path / "out")]) == 0
    (fault,) = json.loads((tmp_path / "out" / "summary.json").read_text())["faults"]
    assert (fault["controller"], fault["predictor"], fault["event"], fault["runs"]) == (
        "reactive", "failing", "forecast_failed", 1,
    )  # fmt: skip
    assert fault["count"] > 10
    assert fault["traceback"].startswith("Traceback")
    said = f"- survived reactive, failing: forecast_failed ({fault['count']} x in 1 runs): TypeError: too often"
    assert said in capsys.readouterr().out
    assert "faults" not in rows_of(tmp_path / "out")[0]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--controllers", "my_parts:Slugish"], "perhaps you meant 'Sluggish'"),
        (["--controllers", "no_parts:Sluggish"], "there is no module 'no_parts'"),
        (["--controllers", "mpc", "--options.share", "1"], "options are for parts of your own"),
    ],
)
def test_a_part_that_is_not_there_is_said_before_anything_runs(words, expected, tmp_path, monkeypatch, capsys):
    own_module(tmp_path, monkeypatch)
    assert main(["--recordings", "subject01_R4", *words, "--out", str(tmp_path / "out")]) == 2
    assert expected in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_two_parts_of_one_name_are_told_apart():
    rows = [
        {"controller": choice, "controller_name": name}
        for choice, name in (("mpc", "mpc"), ("a:Mine", "Mine"), ("b:Mine", "Mine"), ("c:Yours", "Yours"))
    ]
    rows.append({"controller": "c:Yours"})  # of a failed run
    name_parts(rows, "controller")
    assert rows == [{"controller": name} for name in ("mpc", "a:Mine", "b:Mine", "Yours", "Yours")]


def test_wrong_settings_from_python_are_named():
    with pytest.raises(SettingsError, match="recordigs"):
        compare(recordigs=["synthetic"])
