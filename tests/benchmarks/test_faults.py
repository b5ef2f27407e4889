"""The short table of faults: every command is within limits, and unused input is named."""

import json

import pytest

from benchmarks.faults import __main__ as faults


def test_a_run_too_short_for_a_gaze_error_is_refused(capsys):
    assert faults.main(seconds=1.0) == 2
    assert "--seconds 1: expected at least 1.2" in capsys.readouterr().err


@pytest.mark.slow
def test_the_short_table_counts_commands_intervals_and_reasons(tmp_path, capsys):
    path = tmp_path / "faults.json"
    assert faults.main(path, seconds=1.2, short=True) == 0
    ahead, stranger, clock, *parts = json.loads(path.read_text(encoding="utf-8"))["rows"]
    rows = [ahead, stranger, clock, *parts]
    assert not any(row["outside_limits"] or row["ended"] or row["log_lost"] for row in rows)
    assert ahead["used"] > 0.8 * ahead["observations"]
    assert ahead["gaze_error_rms_deg"] < 3.0
    # Hundreds of commands on any loaded machine; the benchmark itself evaluates their intervals.
    assert stranger["commands"] > 100
    assert stranger["gap_max_ms"] >= 5.0
    assert stranger["machine_gap_ms"] >= 5.0
    assert stranger["refused"]["sender_refused"] > 0
    assert set(stranger["refused"]) <= {"sender_refused", "stale_observation", "gate_refused"}
    assert clock["used"] + sum(clock["refused"].values()) == clock["observations"]
    assert clock["refused"]["future_observation"] > 0
    assert [row["family"] for row in parts] == ["none", *3 * ["Controller.plan"]]
    assert all("Wrong.plan()" in row["named"] for row in parts[1:])
    assert f"commands {sum(row['commands'] for row in rows)}," in capsys.readouterr().out
