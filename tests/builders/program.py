"""The program `python -m gazempc.live` in a process of its own."""

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

from builders.waiting import FOREVER_S, wait_for
from gazempc.live.session import main
from gazempc.results.log_files import load_log
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
        """Wait for the first output, printed when the run begins."""
        while b"Ctrl-C stops" not in self.printed:
            ready, _, _ = select.select([self.process.stdout], [], [], FOREVER_S)
            chunk = self.process.stdout.read1() if ready else b""
            if not chunk:
                self.process.kill()  # otherwise reading its errors would block
                raise AssertionError(self.process.stderr.read().decode())
            self.printed += chunk

    def walk(self, seconds, rate_hz=30):
        """Send lines of a passing person, in real time."""
        for k in range(int(seconds * rate_hz)):
            t = k / rate_hz
            head = [2.5, 1.2 * math.sin(1.2 * t), 0.4]
            seen = {
                "capture_time_s": time.time() - 0.03,
                "head_position_m": head,
                "head_quat_wxyz": [1, 0, 0, 0],
            }
            self.process.stdin.write(json.dumps(seen).encode() + b"\n")
            self.process.stdin.flush()
            time.sleep(1.0 / rate_hz)

    def end(self):
        out, err = self.process.communicate(timeout=FOREVER_S)
        return (self.printed + out).decode(), err.decode()

    def until_it_takes_signals(self):
        """Wait until signal handlers are installed, early in the start."""
        status = Path(f"/proc/{self.process.pid}/status")
        caught = lambda: int(re.search(r"SigCgt:\s*(\w+)", status.read_text()).group(1), 16)  # noqa: E731
        wait_for(lambda: caught() >> (signal.SIGTERM - 1) & 1, FOREVER_S, step=lambda: time.sleep(0.001))


def check_output(out, output):
    """Logs, summary, report and printed output of a run agree; returns summary and log."""
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    assert summary["logs"] == ["log_000.npz"]
    log = load_log(out / "log_000.npz")
    assert log.time_s.size == summary["ticks"] > 10
    assert np.all(np.abs(log.command_velocity_rad_s[-1]) < 1e-9)
    assert np.all(np.isfinite(log.command_position_rad))
    assert summary["limit_violations"] == limit_violations(log, log.neck) == 0
    assert (out / "compute_000.npz").is_file()
    assert f"stopped by: {summary['stopped_by']}" in output
    report = BeautifulSoup((out / "report.html").read_text(encoding="utf-8"), "html.parser")
    cells = {row.th.text: row.td.text for row in report.select("tbody tr")}
    assert (cells["ticks"], cells["observations"]) == (str(summary["ticks"]), str(summary["observations"]))
    for name, value in (summary["metrics_of_last_log"] or {}).items():
        assert value is None or float(cells[name]) == pytest.approx(value, rel=1e-3)
    assert all(name in report.find(id="unusual").text for name in summary["events"])
    assert report.find(class_="command").text.startswith("python -m gazempc.live --")
    return summary, log


# The second signal comes while the first one is handled: handlers run between any two instructions.
SIGNALLED = """
import signal, threading, time
from gazempc.live.process import stopped_by_signals
class Stop(threading.Event):
    lock = threading.Lock()
    def set(self):
        with self.lock:
            if not self.is_set():
                super().set()
                signal.raise_signal(signal.SIGTERM)
stop = Stop()
with stopped_by_signals(stop):
    signal.raise_signal(signal.SIGINT)
    print(stop.wait(60), flush=True)
    while signal.getsignal(signal.SIGHUP) is not signal.SIG_DFL:
        time.sleep(0.01)
    signal.raise_signal(signal.SIGHUP)
    print("alive", flush=True)
"""


def assert_refused(words, named, out, capsys):
    """Exit status 2 with these words in the message, before any file is written."""
    assert main([*words, "--out", str(out)]) == 2
    complained = capsys.readouterr().err
    assert all(word in complained for word in named), complained
    assert "Traceback" not in complained
    assert not list(out.glob("*"))
