"""Parts of a user's own in live runs: by module:Class, with options; what they lack is said before anything moves."""

import json

import numpy as np
import pytest
from builders.own_modules import write_own_parts

from benchmarks.faults.wrongs import FAMILIES
from gazempc.live.session import main
from gazempc.results.log_files import load_log

QUICK = ["--simulated-clock", "--no-figures", "--log", "npz"]


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("own")
        patch.chdir(folder)
        patch.syspath_prepend(folder)
        yield write_own_parts(folder)


def run(tmp_path, *words, source="replay"):
    arguments = ["--source", source, *QUICK, "--out", str(tmp_path), *words]
    assert main(arguments) == 0
    return json.loads((tmp_path / "summary.json").read_text()), load_log(tmp_path / "log_000.npz")


@pytest.mark.slow
def test_all_parts_may_be_one_s_own_and_have_options(own, tmp_path, capsys):
    parts = ["--robot", f"{own}:Head", "--predictor", f"{own}:Standing", "--controller", f"{own}:Eager"]
    options = ["--options.zero_deg", "[1.5, -2]", "--options.gain=0.5", "--options.predictor.noise_m", "0.02"]
    options += ["--options.speed_m_s", "0.25", "--options.dynamixel.port", "/dev/null"]
    summary, log = run(tmp_path, *parts, *options, source=f"{own}:Walker")
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
    (["--robot", "{own}:LackingRobot"], ["robot {own}:LackingRobot lacks the method send_command(position_rad"]),
    (["--source", "{own}:LackingSource"], ["source {own}:LackingSource lacks the method poll() -> Arrived"]),
    (["--controller", "{own}:WrongPlan"], ["plan() returned NoneType", "Plan"]),
    (["--robot", "{own}:RaisingRobot"], ["needs 'port'", "--options.port VALUE", "neck, clock_s, clock, position_rad"]),
    (["--robot", "{own}:Head", "--options.zero", "1"], ["options.zero: no chosen part takes it", "zero_deg"]),
    (["--robot", "{own}:Head", "--options.zero_deg", "far"], ["options.zero_deg", "'far'"]),
    (["--robot", "{own}:Hed"], ["has no 'Hed'", "'Head'"]),
    (["--robot", "{own}:RealHead"], ["--simulated-clock", "keeps_any_clock = True"]),
    (["--predictor", "perfect"], ["--predictor perfect"]),
]


@pytest.mark.parametrize(("words", "named"), REFUSED)
def test_what_is_wrong_with_a_part_is_said_before_anything_moves(own, words, named, tmp_path, capsys):
    words = [word.format(own=own) for word in words]
    source = [] if "--source" in words else ["--source", "replay"]
    assert main([*source, *words, *QUICK, "--out", str(tmp_path / "out")]) == 2
    complained = capsys.readouterr().err
    for word in named:
        assert word.format(own=own) in complained
    assert "Traceback" not in complained
    assert not list(tmp_path.glob("out/*"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("option", "name", "event", "error"),
    [
        ("--robot", "WrongLater", "robot_not_answering", "ValueError: read_state() returned position_rad"),
        ("--source", "Failing", "source_failed", "ConnectionError: the tracker is gone"),
    ],
)
def test_what_fails_under_way_is_an_event_with_its_text_and_traceback(
    own, option, name, event, error, tmp_path, capsys
):
    parts = {"--source": "replay", "--controller": "lookahead", "--predictor": "constant_velocity", "--log-s": "1"}
    words = [word for pair in (parts | {option: f"{own}:{name}"}).items() for word in pair]
    assert main([*words, *QUICK, "--out", str(tmp_path)]) == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    (fault,) = summary["faults"]
    assert fault["event"] == event
    assert fault["error"].startswith(error)
    assert fault["traceback"].startswith("Traceback")
    logs = [load_log(tmp_path / log) for log in summary["logs"]]
    assert fault["count"] == sum(each.count for log in logs for each in log.faults) > 10
    assert summary["limit_violations"] == 0
    said = capsys.readouterr().out
    assert f"  {event} ({fault['count']} x): {error}" in said
    assert f"{event} {summary['events'][event]} x" not in said.partition("stopped by")[2]


SPOILT = """
from benchmarks.faults.wrongs import FAMILIES
from {module} import {base}
KINDS = [change for name, change in FAMILIES["{family}"].items() if name not in ("blocks for 1 s", "15 ms each")]

class Spoilt({base}):
    calls = 0

    def spoilt(self, *args):
        self.calls += 1
        answer = super().{method}(*args) if "{method}" != "finished" else super().finished
        spoils = self.calls > {good_calls}
        return KINDS[self.calls // 2 % len(KINDS)](answer) if spoils else answer

    {method} = {wrap}(spoilt)
"""


@pytest.mark.slow
@pytest.mark.parametrize("family", [name for name in FAMILIES if "." in name and "," not in name])
def test_the_summary_is_written_whatever_a_part_does(own, family, tmp_path, monkeypatch):
    """Each kind of the benchmark of faults, one after the other, in a run by the command."""
    part, method = family.split(".")
    base = {"Robot": "Head", "Source": "Walker", "Controller": "Reactive", "Predictor": "ConstantVelocity"}[part]
    module, wrap = own if part in ("Robot", "Source") else "gazempc", "property" if method == "finished" else ""
    # Closed once; the others are tried out when they are made.
    good_calls = 0 if method == "close" else 40
    name = family.replace(".", "_").lower()
    text = SPOILT.format(module=module, base=base, family=family, method=method, wrap=wrap, good_calls=good_calls)
    (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    parts = {"--source": "replay", "--controller": "lookahead", "--predictor": "constant_velocity"}
    words = [word for pair in (parts | {f"--{part.lower()}": f"{name}:Spoilt"}).items() for word in pair]
    assert main([*words, *QUICK, "--duration-s", "3", "--out", str(tmp_path)]) == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert sum(load_log(tmp_path / log).time_s.size for log in summary["logs"]) == summary["ticks"] > 100
    assert summary["limit_violations"] == 0
    assert any("Spoilt" in fault["error"] for fault in summary["faults"])


@pytest.mark.slow
@pytest.mark.parametrize("call", ["update", "plan"])
def test_a_failure_before_the_first_tick_does_not_end_the_run(call, tmp_path, monkeypatch):
    # A part is tried out once when it is made; the second call is the warm-up of a run, and no part of its log.
    part, base, calls = ("predictor", "ConstantVelocity", 5) if call == "update" else ("controller", "Reactive", 1)
    (tmp_path / f"once_{call}.py").write_text(
        f"import gazempc as gz\nclass Once(gz.{base}):\n    calls = 0\n    def {call}(self, given):\n"
        f"        self.calls += 1\n        if self.calls == {calls} + 1:\n            raise KeyError('once')\n"
        f"        return super().{call}(given)\n"
    )
    monkeypatch.chdir(tmp_path)
    words = ["--source", "replay", f"--{part}", f"once_{call}:Once", "--duration-s", "1"]
    assert main([*words, *QUICK, "--out", str(tmp_path)]) == 0
    assert json.loads((tmp_path / "summary.json").read_text())["faults"] == []
