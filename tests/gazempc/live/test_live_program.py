"""The whole program on observations from standard input and on a bag with its delays, and what it refuses."""

import json
import math
import re
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from bs4 import BeautifulSoup
from builders.bags import face_rows, write_bag
from builders.waiting import FOREVER_S, wait_for

from gazempc.live import session as live
from gazempc.loop.events import Event
from gazempc.results.log_files import load_log
from gazempc.results.metrics import measure
from gazempc.results.motion import limit_violations


class Program:
    """`python -m gazempc.live` in a process of its own."""

    def __init__(self, *arguments):
        command = [sys.executable, "-m", "gazempc.live", "--no-figures", "--log", "npz", *map(str, arguments)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        self.printed = b""

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.process.kill()
        for pipe in (self.process.stdin, self.process.stdout, self.process.stderr):
            pipe.close()
        self.process.wait()

    def until_it_runs(self):
        """Until its first output, which it prints when the run begins."""
        while b"Ctrl-C stops" not in self.printed:
            ready, _, _ = select.select([self.process.stdout], [], [], FOREVER_S)
            chunk = self.process.stdout.read1() if ready else b""
            if not chunk:
                self.process.kill()  # else its errors would never end
                raise AssertionError(self.process.stderr.read().decode())
            self.printed += chunk

    def walk(self, seconds, rate_hz=30, stamp=lambda: time.time() - 0.03, unit_m=1.0):
        """Lines of a person who walks by, in real time."""
        for k in range(int(seconds * rate_hz)):
            t = k / rate_hz
            head = [2.5 / unit_m, 1.2 * math.sin(1.2 * t) / unit_m, 0.4 / unit_m]
            observation = {"capture_time_s": stamp(), "head_position_m": head, "head_quat_wxyz": [1, 0, 0, 0]}
            self.process.stdin.write(json.dumps(observation).encode() + b"\n")
            self.process.stdin.flush()
            time.sleep(1.0 / rate_hz)

    def end(self):
        out, err = self.process.communicate(timeout=FOREVER_S)
        return (self.printed + out).decode(), err.decode()

    def until_it_takes_signals(self):
        """Early in its start: the first thing that it does."""
        status = Path(f"/proc/{self.process.pid}/status")
        caught = lambda: int(re.search(r"SigCgt:\s*(\w+)", status.read_text()).group(1), 16)  # noqa: E731
        wait_for(lambda: caught() >> (signal.SIGTERM - 1) & 1, FOREVER_S, step=lambda: time.sleep(0.001))


def check_output(out, said):
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    assert summary["logs"] == ["log_000.npz"]
    log = load_log(out / "log_000.npz")
    assert log.time_s.size == summary["ticks"] > 10
    assert np.all(np.abs(log.command_velocity_rad_s[-1]) < 1e-9)
    assert np.all(np.isfinite(log.command_position_rad))
    assert summary["limit_violations"] == limit_violations(log, log.neck) == 0
    assert (out / "compute_000.npz").is_file()
    assert f"stopped by: {summary['stopped_by']}" in said
    report = BeautifulSoup((out / "report.html").read_text(encoding="utf-8"), "html.parser")
    cells = {row.th.text: row.td.text for row in report.select("tbody tr")}
    assert (cells["ticks"], cells["observations"]) == (str(summary["ticks"]), str(summary["observations"]))
    for name, value in (summary["metrics_of_last_log"] or {}).items():
        assert value is None or float(cells[name]) == pytest.approx(value, rel=1e-3)
    assert all(name in report.find(id="unusual").text for name in summary["events"])
    assert report.find(class_="command").text.startswith("python -m gazempc.live --")
    return summary, log


@pytest.mark.slow
def test_a_run_from_standard_input_to_its_end(tmp_path):
    """Fed for a while in real time: the neck at rest, everything written, exit status 0."""
    # The predictor in a process of its own forecasts as in that of the run.
    with Program("--source", "stdin", "--robot", "simulated", "--isolate", "predictor", "--out", tmp_path) as program:
        program.until_it_runs()
        program.walk(1.2)  # metrics are of logs longer than a second
        program.process.stdin.write(b"this is no observation\n")
        program.walk(0.2)
        said, complained = program.end()
        assert program.process.returncode == 0, complained
    assert "Traceback" not in complained
    summary, log = check_output(tmp_path, said)
    assert summary["stopped_by"] == "end of the source"
    # The second walk begins where the first one did, too far away for a step.
    gated = summary["refused"].pop("gate_refused")
    assert (summary["observations"], summary["used"] + gated, summary["refused"]) == (43, 42, {"bad_observation": 1})
    assert said.splitlines()[-1] == f"{42 - gated} of 43 used: {gated} gate, 1 unreadable"
    assert any("m away; " in line and "observations/s" in line for line in said.splitlines())
    assert f"bad_observation: {Event.BAD_OBSERVATION.meaning}" in said
    assert summary["warnings"] == []
    assert "bad_observation: standard input, line 37" in complained
    # What cannot be measured in a live run is left open.
    assert summary["metrics_of_last_log"]["gaze_error_rms_deg"] is None
    assert summary["end_to_end_latency_ms"]["p50"] > 30.0
    assert np.ptp(log.command_position_rad[:, 0]) > 1e-3
    assert log.head_observed_base_m[:, 0] == pytest.approx(2.5)


@pytest.mark.slow
def test_a_signal_during_the_start_ends_it_in_order(tmp_path):
    with Program("--source", "stdin", "--robot", "simulated", "--out", tmp_path) as program:
        program.until_it_takes_signals()
        program.process.send_signal(signal.SIGINT)
        said, complained = program.end()
        assert (program.process.returncode, complained) == (0, "")
    assert said == "gazempc.live: stopped before the robot was connected\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_options_that_mend_a_wrong_clock_and_unit_are_named_while_it_runs_and_signals_end_it(tmp_path):
    def stamp():
        return 1e3 * (time.monotonic() - 0.03)

    options = ["--source", "stdin", "--robot", "simulated", "--predictor", "constant_velocity"]
    with Program(*options, "--controller", "lookahead", "--out", tmp_path) as program:
        program.until_it_runs()
        program.walk(1.0, stamp=stamp, unit_m=0.001)
        # It runs on: nothing but these lines is on standard error.
        lines = [program.process.stderr.readline().decode() for _ in range(3)]
        program.walk(0.1, stamp=stamp, unit_m=0.001)
        for number in (signal.SIGHUP, signal.SIGTERM):
            program.process.send_signal(number)
        said, complained = program.end()
        assert (program.process.returncode, complained) == (0, "")
    events = ["implausible_person", "wrong_clock", "wrong_unit"]
    assert [line.split()[2].rstrip(":") for line in lines] == events
    named = [word.strip("():;") for word in " ".join(lines).split()]
    named_options = [each for k, word in enumerate(named) if word.startswith("--") for each in (word, named[k + 1])]
    assert named_options == ["--stamps.clock", "monotonic", "--stamps.unit", "ms", "--mount.unit-m", "0.001"]
    summary, _ = check_output(tmp_path, said)
    assert summary["stopped_by"] == "signal"
    assert (summary["observations"], summary["used"]) == (33, 0)
    assert set(events) <= set(summary["events"])


T = np.arange(150) / 30.0
# A person walks to and fro, 2 m in front of a camera.
WALK = np.column_stack([np.full_like(T, 2.0), 0.8 * np.sin(0.6 * T), np.full_like(T, 0.3)])


def test_a_live_run_on_a_bag_has_the_delays_of_the_recording_and_writes_logs_that_join(tmp_path, capsys):
    bag = write_bag(tmp_path / "bag", face_rows("face_a", 1e9 + T, WALK, "camera_link"), delay_s=0.08)
    out = tmp_path / "out"
    words = f"--source bag:{bag} --robot simulated --simulated-clock --out {out} --log-s 3 --log npz --no-figures"
    assert live.main([*words.split(), "--predictor", "constant_velocity", "--controller", "lookahead"]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["stopped_by"] == "end of the source"
    assert (summary["observations"], summary["used"], summary["refused"]) == (150, 150, {})
    assert summary["skipped_ticks"] == summary["late_ticks"] == summary["limit_violations"] == 0
    assert summary["logs"] == ["log_000.npz", "log_001.npz"]
    logs = [load_log(out / name) for name in summary["logs"]]
    time_s, captured_s, arrived_s, heads_m = (
        np.concatenate([getattr(log, name) for log in logs])
        for name in ("time_s", "capture_time_s", "arrival_time_s", "head_observed_base_m")
    )
    assert np.diff(time_s) == pytest.approx(0.005, abs=1e-9)
    assert captured_s - captured_s[0] == pytest.approx(T, abs=1e-5)
    # At the first tick after the arrival.
    assert np.all((arrived_s - captured_s > 0.08 - 1e-5) & (arrived_s - captured_s < 0.085 + 1e-5))
    np.testing.assert_allclose(heads_m, WALK, atol=1e-9)
    assert measure(logs[1]).gaze_error_rms_deg < 3.0  # a neck that stands still: 16 deg
    printed = capsys.readouterr().out
    assert "  face_a, 150 frames in camera_link" in printed
    assert "against the tracker's own track, smoothed without lag" in printed
    (line,) = (line for line in printed.splitlines() if line.startswith("Written to "))
    assert sorted(line.partition("/: ")[2].split(", ")) == sorted(path.name for path in out.iterdir())


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ("--source telepathy", ["--source", "telepathy", "udp:PORT", "stdin"]),
        ("--source udp:5005 --simulated-clock", ["--simulated-clock", "replay"]),
        ("--source replay --mount.on head", ["--mount.on", "base"]),
        ("--source replay --attention-out ros2:a", ["one person"]),
        ("--source replay --attend nearest --simulated-clock --attention-out ros2:a", ["real time"]),
        ("--source replay --isolate predictor --attend nearest", ["--isolate"]),
        ("--source replay --stamps.unit ms", ["--stamps", "stdin, udp, tcp, ros2"]),
        ("--source stdin --camera.fov-deg 60", ["--camera", "--source camera"]),
        ("--source udp:5005 --robot dynamixel", ["--neck"]),
        ("--source udp:5005 --mount.on eye", ["--mount.on eye"]),
        ("--source bag:nowhere", ["nowhere"]),
        ("--source bag:nowhere --sensor reference", ["--sensor", "--source replay"]),
    ],
)
def test_bad_input_is_named_and_the_status_is_2(arguments, named, tmp_path, capsys):
    assert live.main([*arguments.split(), "--out", str(tmp_path)]) == 2
    complained = capsys.readouterr().err
    assert all(word in complained for word in named)
    assert "Traceback" not in complained
    assert not list(tmp_path.iterdir())
