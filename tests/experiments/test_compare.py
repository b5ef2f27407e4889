"""The comparison over many recordings: means, resumption, and bad recordings as rows."""

import dataclasses
import json
from pathlib import Path

import pytest
from bs4 import BeautifulSoup
from builders.replays import quick_neck
from builders.studies import rows_of, runs

from experiments.compare import main
from experiments.engine.job import models_hash
from gazempc.recordings.readers.options import ReadOptions
from gazempc.settings import WalkerSettings
from predictors.walker.network import save_walker_model, shipped_walker_model

pytestmark = pytest.mark.usefixtures("in_this_process")


@pytest.fixture(scope="module")
def compared(tmp_path_factory, in_this_process):
    """A walking, a starting and a standing person; start offsets; the model was fitted on one of them."""
    folder = tmp_path_factory.mktemp("compared")
    model = dataclasses.replace(shipped_walker_model(), about={"people": ["subject01"]})
    save_walker_model(model, folder / "walker.npz")
    slow = folder / "slow.toml"
    slow.write_text('name = "slow"\nsource = "a test"\nrate_hz = 10.0\nlatency_s = 0.1\n')
    words = ["--recordings", "subject01_R1", "subject03_start", "subject05_stand", "--start-offset-deg", "60"]
    words += ["--walker.fitted", str(folder), "--controllers", "lookahead", "mpc"]
    words += ["--necks", quick_neck(folder), "--sensors", str(slow), "--jobs", "1"]
    assert main([*words, "--out", str(folder / "<b>out")]) == 0
    out = folder / "<b>out"
    return out, json.loads((out / "summary.json").read_text()), (out / "summary.md").read_text()


@pytest.mark.slow
def test_the_report_has_the_values_of_the_summary(compared):
    out, summary, _ = compared
    report = BeautifulSoup((out / "report.html").read_text(encoding="utf-8"), "html.parser")
    columns = [cell.text for cell in report.table.thead.find_all("th")]
    lines = [[cell.text for cell in row.find_all(["th", "td"])] for row in report.table.tbody.find_all("tr")]
    shown = [dict(zip(columns, line, strict=True)) for line in lines]
    for line, row in zip(shown, summary["rows"], strict=True):
        assert (line["group"], line["kind"]) == (row["group"], row["kind"])
        assert float(line["gaze error RMS [deg]"].split()[0]) == pytest.approx(row["gaze_error_rms_deg"], abs=0.005)
        if (row["group"], row["kind"], row["controller"]) == ("all", "all", "lookahead"):
            assert f"look-ahead {100 * row['eye_contact_2p6']:.1f} %" in report.find(class_="answer").text
    # The curves are the clips, the best first.
    curves = json.loads(report.find("script", type="application/json").text)["curves"]
    errors = {(r["controller"], r["recording"]): float(r["gaze_error_rms_deg"]) for r in rows_of(out)}
    for curve, controller in zip(curves, ("lookahead", "mpc"), strict=True):
        expected = [errors[controller, name] for name in curve["names"]]
        assert curve["xs"] == sorted(curve["xs"]) == pytest.approx(expected, rel=1e-4)
        assert curve["ys"] == pytest.approx([100 / 3, 200 / 3, 100.0], rel=1e-4)
    assert len(report.find_all("img")) == len(list(out.glob("*.png"))) > 0
    assert report.find(class_="command").text.endswith(f"--jobs 1 --out '{out}'")


@pytest.mark.slow
def test_start_offsets_are_compared_by_contact_time_and_overshoot(compared):
    out, summary, text = compared
    later_s = {r["controller"]: float(r["time_to_stable_contact_s"]) for r in rows_of(out) if r["kind"] == "standing"}
    (row,) = (d for d in summary["mpc_minus_lookahead_stable_contact_s"] if d["kind"] == "standing")
    assert row["difference"] == pytest.approx(later_s["mpc"] - later_s["lookahead"])
    assert "time to stable contact where both reach it [s]" in text
    assert "overshoot where both reach the person [deg]" in text


@pytest.mark.slow
def test_standing_and_starting_have_own_metrics_and_fitted_people_are_named(compared):
    out, summary, text = compared
    walks, starts, stands = (row for row in rows_of(out) if row["controller"] == "mpc")
    assert [row["group"] for row in (walks, starts, stands)] == ["straight", "straight", "standing"]
    assert (starts["kind"], stands["kind"]) == ("starting", "standing")
    assert float(stands["false_starts_per_min"]) == 0.0
    assert starts["false_starts_per_min"] == stands["time_from_start_to_contact_s"] == ""
    assert float(starts["time_from_start_to_contact_s"]) > 0.3
    groups = dict.fromkeys(row["group"] for row in summary["rows"] if row["kind"] == "all")
    assert list(groups) == ["standing", "straight", "all"]
    assert "false starts [1/min]" in text
    assert "start to contact [s]" in text
    assert summary["people_seen_in_fitting"] == ["subject01"]
    assert "fitted on 1 person" in text


def test_a_bad_recording_is_a_row_and_one_too_near_is_counted(tmp_path):
    (tmp_path / "bad.csv").write_text("t,head_x\n0,1\n")
    words = ["--recordings", str(tmp_path / "bad.csv"), "subject01_R1", "--controllers", "reactive", "lookahead"]
    words += ["--placement", "side", "--distance-m", "0.5", "--jobs", "1", "--no-figures"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 4
    failed = [r for r in rows_of(tmp_path / "out") if r["failed"]]
    assert [row["controller"] for row in failed] == ["reactive", "lookahead"]
    assert "bad.csv" in failed[0]["failed"]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["n_left_out"], summary["rows"]) == (1, [])


def test_the_perfect_forecast_is_run_once_for_all_predictors():
    labels = [row for row, _ in runs(Path("x"), predictors=("default", "walker", "head_pose"))]
    assert sum(row["controller"] == "mpc+perfect" for row in labels) == 3
    assert {row["predictor"] for row in labels if row["controller"] == "reactive"} == {"walker", "head_pose"}


def test_another_content_of_a_mapping_file_changes_the_key(tmp_path):
    [(_, job)] = runs(tmp_path, recordings=("subject01_R1",), controllers=("mpc",))
    reading = ReadOptions(mapping=tmp_path / "mine.toml")
    job, keys = dataclasses.replace(job, settings=job.settings.model_copy(update={"reading": reading})), []
    for axes in ("z-up", "y-up"):
        reading.mapping.write_text(f'axes = "{axes}"\n')
        keys.append(job.key())
    assert keys[0] != keys[1]


def test_another_fitted_model_changes_the_key(tmp_path):
    """A fit into the same folder changes the key, so that old results are not reused."""
    path = tmp_path / "left_out" / "ann.npz"
    path.parent.mkdir()
    save_walker_model(shipped_walker_model(), tmp_path / "walker.npz")
    keys = []
    for content in (b"one", b"two"):
        path.write_bytes(content)
        walker = WalkerSettings(fitted=tmp_path)
        [(_, job)] = runs(tmp_path, recordings=("subject01_R1",), controllers=("mpc",), walker=walker)
        keys.append(job.key())
    assert keys[0] != keys[1]
    assert models_hash(tmp_path / "walker.npz") != models_hash(tmp_path)
