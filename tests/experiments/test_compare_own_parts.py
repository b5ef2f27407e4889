"""User-defined parts in a comparison, and their faults."""

import json

import pytest
from builders.own_parts import own_module
from builders.replays import quick_neck
from builders.studies import rows_of

from experiments.compare import main
from experiments.engine.command import name_parts
from experiments.engine.job import parts_hash


@pytest.mark.slow
def test_a_worker_process_imports_user_defined_parts_with_options(tmp_path, monkeypatch):
    """At a share of 1 `Sluggish` is look-ahead, and `Steady` is `constant_velocity` under another name."""
    own = own_module(tmp_path, monkeypatch)
    words = ["--recordings", "subject01_R4", "--controllers", f"{own}:Sluggish", "lookahead", "--jobs", "1"]
    words += ["--predictors", f"{own}:Steady", "constant_velocity", "--options.share", "1.0", "--no-figures"]
    words += ["--necks", quick_neck(tmp_path)]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    rows = {(row["controller"], row["predictor"]): row for row in rows_of(tmp_path / "out")}
    assert set(rows) == {(c, p) for c in ("sluggish", "lookahead") for p in ("steady", "constant_velocity")}
    assert len({row["gaze_error_rms_deg"] for row in rows.values()}) == 1
    assert {row["failed"] for row in rows.values()} == {""}
    assert "| sluggish | steady |" in (tmp_path / "out" / "summary.md").read_text()


def test_the_key_includes_the_source_of_a_user_defined_part(tmp_path, monkeypatch):
    own = own_module(tmp_path, monkeypatch)
    changed = own_module(tmp_path, monkeypatch, "changed_parts", more="# changed")
    assert own != changed
    hashes = [parts_hash(f"{name}:Sluggish", "walker") for name in (own, changed)]
    assert hashes[0] != hashes[1]
    assert parts_hash("mpc", "walker") == []


@pytest.mark.usefixtures("in_this_process")
def test_handled_exceptions_are_reported_and_saved(tmp_path, monkeypatch, capsys):
    own = own_module(tmp_path, monkeypatch)
    words = ["--recordings", "subject01_R4", "--controllers", "reactive", "--predictors", f"{own}:Failing"]
    assert main([*words, "--jobs", "1", "--no-figures", "--out", str(tmp_path / "out")]) == 0
    (fault,) = json.loads((tmp_path / "out" / "summary.json").read_text())["faults"]
    assert (fault["controller"], fault["predictor"], fault["event"], fault["runs"]) == (
        "reactive", "failing", "forecast_failed", 1,
    )  # fmt: skip
    assert fault["count"] > 10
    assert fault["traceback"].startswith("Traceback")
    assert f"reactive, failing: forecast_failed, {fault['count']} x in 1 runs" in capsys.readouterr().out
    assert "faults" not in rows_of(tmp_path / "out")[0]


def test_two_parts_with_one_name_are_distinguished():
    rows = [
        {"controller": choice, "controller_name": name}
        for choice, name in (("mpc", "mpc"), ("a:Mine", "Mine"), ("b:Mine", "Mine"), ("c:Yours", "Yours"))
    ]
    rows.append({"controller": "c:Yours"})  # of a failed run
    name_parts(rows, "controller")
    assert rows == [{"controller": name} for name in ("mpc", "a:Mine", "b:Mine", "Yours", "Yours")]
