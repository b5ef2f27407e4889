"""User-defined parts in live runs: by module:Class, with options; defects are reported before any motion."""

import json

import numpy as np
import pytest
from builders.own_modules import write_spoilt
from builders.program import assert_refused

from benchmarks.faults.wrongs import FAMILIES
from gazempc.live.session import main
from gazempc.results.log_files import load_log

QUICK = ["--simulated-clock", "--no-figures", "--log", "npz"]


@pytest.mark.slow
def test_all_parts_may_be_user_defined_with_options(own, tmp_path, capsys):
    parts = ["--robot", f"{own}:Head", "--predictor", f"{own}:Standing", "--controller", f"{own}:Eager"]
    options = ["--options.zero_deg", "[1.5, -2]", "--options.gain=0.5", "--options.predictor.noise_m", "0.02"]
    options += ["--options.speed_m_s", "0.25", "--options.dynamixel.port", "/dev/null"]
    assert main(["--source", f"{own}:Walker", *QUICK, "--out", str(tmp_path), *parts, *options]) == 0
    summary, log = json.loads((tmp_path / "summary.json").read_text()), load_log(tmp_path / "log_000.npz")
    assert summary["stopped_by"] == "end of the source"
    assert summary["observations"] == 120
    assert summary["limit_violations"] == 0
    assert summary["faults"] == []
    assert log.head_observed_base_m[:, 1] == pytest.approx(0.25 * (np.arange(log.capture_time_s.size) / 30.0 - 2.0))
    assert (log.run.controller, log.run.robot) == ("Eager", "Head")
    # The forecast's covariance is the predictor's option.
    assert log.forecast_covariance_m2[0, 0] == pytest.approx(0.02**2 * np.eye(3))
    assert log.run.settings["options"]["speed_m_s"] == "0.25"
    assert log.run.settings["options"]["dynamixel"]["port"] == "/dev/null"
    assert f"robot {own}:Head" in capsys.readouterr().out


REFUSED = [
    (["--robot", "{own}:LackingRobot"], ["robot {own}:LackingRobot", "send_command(position_rad"]),
    (["--controller", "{own}:WrongPlan"], ["plan()", "NoneType", "Plan"]),
    (["--robot", "{own}:RaisingRobot"], ["'port'", "--options.port VALUE", "neck, clock_s, clock, position_rad"]),
    (["--robot", "{own}:Head", "--options.zero", "1"], ["options.zero:", "zero_deg"]),
    (["--robot", "{own}:RealHead"], ["--simulated-clock", "keeps_any_clock = True"]),
    (["--predictor", "perfect"], ["--predictor perfect"]),
]


@pytest.mark.parametrize(("words", "named"), REFUSED)
def test_an_invalid_part_is_reported_before_any_motion(own, words, named, tmp_path, capsys):
    words, named = ([word.format(own=own) for word in each] for each in (words, named))
    assert_refused(["--source", "replay", *words, *QUICK], named, tmp_path, capsys)


@pytest.mark.slow
@pytest.mark.parametrize("family", [name for name in FAMILIES if "." in name and "," not in name])
def test_the_summary_is_written_for_every_fault_of_a_part(own, family, tmp_path, monkeypatch, capsys):
    """Each fault of the benchmark in turn, in a run of the command; each event with its text."""
    part, name = family.partition(".")[0], write_spoilt(tmp_path, family, own)
    monkeypatch.syspath_prepend(str(tmp_path))
    parts = {"--source": "replay", "--controller": "lookahead", "--predictor": "constant_velocity"}
    words = [word for pair in (parts | {f"--{part.lower()}": f"{name}:Spoilt"}).items() for word in pair]
    # At 50 Hz each kind of the controller and the predictor twice; else at 200 Hz.
    seconds = "2.2" if part in ("Controller", "Predictor") else "1"
    assert main([*words, *QUICK, "--duration-s", seconds, "--log-s", "1", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    summary = json.loads((tmp_path / "summary.json").read_text())
    logs = [load_log(tmp_path / log) for log in summary["logs"]]
    assert sum(log.time_s.size for log in logs) == summary["ticks"] > 100
    assert summary["limit_violations"] == 0
    assert any("Spoilt" in fault["error"] for fault in summary["faults"])
    for fault in summary["faults"]:
        assert fault["traceback"].startswith("Traceback") or fault["event"] == "joint_reading_refused"
        assert fault["count"] == sum(f.count for log in logs for f in log.faults if f.event == fault["event"])
        assert f"  {fault['event']} ({fault['count']} x): {fault['error']}" in printed
