"""The table of faults, in its short form: every command within limits, and what was not used is named."""

import json

import pytest

from benchmarks.faults import __main__ as faults


@pytest.mark.slow
def test_the_short_form_counts_commands_gaps_and_reasons(tmp_path, capsys):
    path = tmp_path / "faults.json"
    assert faults.main(path, seconds=2.0, short=True) == 0
    found = json.loads(path.read_text(encoding="utf-8"))
    sums = found["sums"]
    assert (sums["runs"], sums["outside_limits"], sums["not_finite"]) == (8, 0, 0)
    assert (sums["runs_ended"], sums["logs_lost"]) == (0, 0)
    assert sums["commands"] == sum(row["commands"] for kind in ("simulated", "live", "parts") for row in found[kind])
    (ahead,) = found["simulated"]
    assert ahead["used"] > 0.8 * ahead["observations"]
    assert ahead["gaze_error_rms_deg"] < 3.0
    stranger, clock = found["live"]
    # Hundreds of commands, whatever else the machine does; their gaps are for the benchmark to judge.
    assert stranger["commands"] > 100
    assert stranger["gap_max_ms"] >= stranger["gap_p99_ms"] >= 4.0
    assert stranger["refused"]["sender_refused"] > 0
    assert set(stranger["refused"]) <= {"sender_refused", "stale_observation", "gate_refused"}
    assert clock["used"] + sum(clock["refused"].values()) == clock["observations"]
    assert clock["refused"]["future_observation"] > 0
    printed = capsys.readouterr().out.splitlines()
    assert [row["family"] for row in found["parts"]] == ["none", "none", *3 * ["Controller.plan"]]
    assert all("Wrong.plan()" in row["named"] for row in found["parts"][2:])
    assert "1 outside limits" not in "".join(printed)
    assert printed[-1].startswith("runs 8, commands ")
