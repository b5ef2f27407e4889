"""The comparison over many recordings: right means, resumable, and no crash on a bad recording."""

import dataclasses
import json
from pathlib import Path

import pytest
from bs4 import BeautifulSoup
from builders.comparisons import rows_of, runs, settings

from experiments.compare import compare, main
from experiments.engine.job import models_hash
from gazempc.settings import WalkerSettings
from predictors.walker.model_file import save_walker_model, shipped_walker_model

pytestmark = pytest.mark.usefixtures("in_this_process")


@pytest.mark.slow
def test_a_comparison_writes_a_report_with_its_numbers(tmp_path):
    out = tmp_path / "<b>out"
    words = ["--recordings", "subject01_R1", "subject02_R6", "--controllers", "reactive", "lookahead", "--jobs", "1"]
    assert main([*words, "--out", str(out)]) == 0
    report = BeautifulSoup((out / "report.html").read_text(encoding="utf-8"), "html.parser")
    columns = [cell.text for cell in report.table.thead.find_all("th")]
    lines = [[cell.text for cell in row.find_all(["th", "td"])] for row in report.table.tbody.find_all("tr")]
    shown = [dict(zip(columns, line, strict=True)) for line in lines]
    rows = json.loads((out / "summary.json").read_text())["rows"]
    assert len(shown) == len(rows)
    for line, row in zip(shown, rows, strict=True):
        assert line["group"] == row["group"]
        assert float(line["gaze error RMS [deg]"].split()[0]) == pytest.approx(row["gaze_error_rms_deg"], abs=0.005)
        if (row["group"], row["controller"]) == ("all", "lookahead"):
            assert f"look-ahead {100 * row['eye_contact_2p6']:.1f} %" in report.find(class_="answer").text
    # The curves are the clips, the best first.
    curves = json.loads(report.find("script", type="application/json").text)["curves"]
    errors = {(r["controller"], r["recording"]): float(r["gaze_error_rms_deg"]) for r in rows_of(out)}
    for curve, controller in zip(curves, ("reactive", "lookahead"), strict=True):
        expected = [errors[controller, name] for name in curve["names"]]
        assert curve["xs"] == sorted(curve["xs"]) == pytest.approx(expected, rel=1e-4)
        assert curve["ys"] == [50.0, 100.0]
    assert len(report.find_all("img")) == len(list(out.glob("*.png"))) > 0
    assert report.find(class_="command").text.endswith(f"--jobs 1 --out '{out}'")


@pytest.mark.slow
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


def test_a_bad_recording_is_a_row_and_not_a_crash(tmp_path):
    (tmp_path / "bad.csv").write_text("t,head_x\n0,1\n")
    words = ["--recordings", str(tmp_path / "bad.csv"), "subject01_R1", "--controllers", "reactive", "lookahead"]
    assert main([*words, "--jobs", "1", "--no-figures", "--out", str(tmp_path / "out")]) == 4
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
    labels = [row for row, _ in runs(Path("x"), predictors=("default", "walker", "head_pose"))]
    assert sum(row["controller"] == "mpc+perfect" for row in labels) == 3
    assert {row["predictor"] for row in labels if row["controller"] == "reactive"} == {"walker", "head_pose"}


@pytest.mark.slow
def test_everyday_people_are_compared_with_their_own_metrics(tmp_path):
    """Two words of a user's, one person who stands and one who starts; the walks stay what they were."""
    names = ["subject02_stand", "subject02_start"]
    words = ["--controllers", "reactive", "--predictors", "last_position", "--no-figures", "--jobs", "1"]
    assert main(["--recordings", *names, *words, "--out", str(tmp_path)]) == 0
    stands, starts = rows_of(tmp_path)
    assert (stands["group"], starts["group"]) == ("standing", "straight")
    assert (stands["kind"], starts["kind"]) == ("standing", "starting")
    assert float(stands["false_starts_per_min"]) == 0.0
    assert starts["false_starts_per_min"] == stands["time_from_start_to_contact_s"] == ""
    assert float(starts["time_from_start_to_contact_s"]) > 0.3
    rows = json.loads((tmp_path / "summary.json").read_text())["rows"]
    assert [row["group"] for row in rows if row["kind"] == "all"] == ["standing", "straight", "all"]
    text = (tmp_path / "summary.md").read_text()
    assert "false starts [1/min]" in text
    assert "start to contact [s]" in text


@pytest.mark.parametrize(
    ("words", "expected"),
    [(["--recordings", "nowhere"], "nowhere"), (["--recordings", "synthetic", "--necks", "x"], "'x'")],
)
def test_bad_input_is_refused_before_anything_runs(words, expected, tmp_path, capsys):
    assert main([*words, "--out", str(tmp_path / "out")]) == 2
    assert expected in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_another_fitted_model_is_another_run(tmp_path):
    """A fit into the same folder changes the key, so that old results are not taken for new ones."""
    path = tmp_path / "left_out" / "ann.npz"
    path.parent.mkdir()
    save_walker_model(shipped_walker_model(), tmp_path / "walker.npz")
    keys = []
    for content in (b"one", b"two"):
        path.write_bytes(content)
        walker = WalkerSettings(fitted=tmp_path)
        [(_, job)] = runs(tmp_path, recordings=("subject01_R1",), controllers=("mpc",), walker=walker)
        keys.append(job.key())
        assert job.settings.walker.fitted == tmp_path
    assert keys[0] != keys[1]
    assert models_hash(tmp_path / "walker.npz") != models_hash(tmp_path)


@pytest.mark.slow
def test_people_that_the_model_has_seen_are_said(tmp_path):
    model = shipped_walker_model()
    save_walker_model(dataclasses.replace(model, about={"people": ["subject01"]}), tmp_path / "walker.npz")
    recordings = ("subject01_R1", "subject02_R6")
    chosen = settings(
        tmp_path / "out", recordings=recordings, controllers=("reactive",), walker=WalkerSettings(fitted=tmp_path)
    )
    compare(**chosen)
    assert "fitted on 1 person of these recordings" in (tmp_path / "out" / "summary.md").read_text()
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["people_seen_in_fitting"] == ["subject01"]
