"""Runs of a sweep: known effects, no repeated job, user-defined parts."""

import json

import numpy as np
import pytest
from builders.own_parts import own_module
from builders.replays import quick_neck
from builders.studies import SMALL, rows_of, written

from experiments.sweep.plan import load_plan
from experiments.sweep.sweep import SweepSettings, run_sweep, sweep

pytestmark = [pytest.mark.usefixtures("in_this_process"), pytest.mark.slow]


FIGURES = {
    "response": [["model.dead_time_scale", "gaze_error_rms_deg", "lookahead.smoothing_time_s"]],
    "pareto": ["rms_acceleration_rad_s2", "eye_contact_2p6", "case"],
}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory, in_this_process):
    """A small sweep without interruption."""
    folder = tmp_path_factory.mktemp("undisturbed")
    base = SMALL["base"] | {"neck": quick_neck(folder)}
    path = written(folder, SMALL | {"base": base, "figures": FIGURES})
    assert sweep(SweepSettings(sweep=str(path), jobs=2, out=folder / "out")) == 0
    return folder


def test_tables_are_written_and_known_effects_have_their_sign(undisturbed):
    rows, table = rows_of(undisturbed / "out"), rows_of(undisturbed / "out", "table.csv")
    assert len(rows) == 8
    assert len({(r["point"], r["recording"]) for r in rows}) == 8
    summary = json.loads((undisturbed / "out" / "summary.json").read_text())
    assert (summary["n_runs"], summary["failed"], summary["limit_violations"]) == (8, [], 0)
    overall = {
        (float(r["model.dead_time_scale"]), float(r["lookahead.smoothing_time_s"])): r
        for r in table
        if r["group"] == "all"
    }
    by_hand = [float(r["gaze_error_rms_deg"]) for r in rows if r["point"] == overall[1, 0]["point"]]
    assert float(overall[1, 0]["gaze_error_rms_deg"]) == pytest.approx(np.mean(by_hand))
    assert overall[1, 0]["n_clips"] == "2"
    # A wrong dead time increases the error; a low-pass smooths the gaze.
    assert float(overall[0.5, 0]["gaze_error_rms_deg"]) > 1.3 * float(overall[1, 0]["gaze_error_rms_deg"])
    assert float(overall[1, 0.1]["rms_acceleration_rad_s2"]) < 0.9 * float(overall[1, 0]["rms_acceleration_rad_s2"])
    assert {p["point"] for p in summary["pareto"]["small"]} <= {0, 1, 2, 3}
    assert {path.name for path in (undisturbed / "out").glob("*.png")} == {
        "response_model-dead_time_scale_gaze_error_rms_deg.png",
        "pareto_rms_acceleration_rad_s2_eye_contact_2p6.png",
    }
    report = (undisturbed / "out" / "report.html").read_text(encoding="utf-8")
    assert all(f"{row['gaze_error_rms_deg']:.4g}" in report for row in summary["rows"] if row["group"] == "all")
    assert "experiments.sweep.sweep.sweep(SweepSettings(" in report


def test_a_user_defined_part_is_swept_with_its_options_and_name(tmp_path, monkeypatch):
    own = own_module(tmp_path, monkeypatch)
    vary = {"controller": [f"{own}:Sluggish", "lookahead"], "options.share": [0.5, 1.0]}
    base = {"predictor": "constant_velocity", "neck": quick_neck(tmp_path)}
    plan = load_plan(written(tmp_path, SMALL | {"recordings": ["subject01_R1"], "base": base, "vary": vary}))
    rows = run_sweep(plan, tmp_path / "out")
    assert [row["failed"] for row in rows] == [None] * 4
    assert [row["controller"] for row in rows] == ["sluggish", "sluggish", "lookahead", "lookahead"]
    errors_deg = [row["gaze_error_rms_deg"] for row in rows]
    # At a share of 1 it equals look-ahead, which has no such option.
    assert errors_deg[0] > 1.5 * errors_deg[1]
    assert errors_deg[1] == errors_deg[2] == errors_deg[3]
    assert len(list((tmp_path / "out" / "runs").iterdir())) == 3
