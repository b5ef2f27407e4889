"""Terminals without a character, closed standard streams, a full disk, Ctrl-C: a message, never a traceback."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from gazempc.results.log import load_log

ROOT = Path(__file__).resolve().parents[2]
RUN = ["gazempc.run", "--replay", "subject03_R4", "--controllers", "reactive", "lookahead"]
LIVE = ["gazempc.live", "--robot", "simulated", "--no-figures", "--source"]
HANG_S = 240


def start(words, shell_end="", **environment):
    """A command as a shell starts it; text of both streams is for reading."""
    command = f'exec "{sys.executable}" -m {" ".join(words)} {shell_end}'
    return subprocess.Popen(
        ["/bin/sh", "-c", command],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
    )


def ended(process):
    out, error = process.communicate(timeout=HANG_S)
    assert "Traceback" not in error, error
    assert "Exception ignored" not in error, error
    return process.returncode, out, error


@pytest.mark.slow
def test_closed_standard_input_is_a_source_that_has_ended(tmp_path):
    status, out, _ = ended(start([*LIVE, "stdin", "--out", str(tmp_path)], "<&-"))
    assert status == 0
    assert "end of the source" in out


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_output_to_a_full_disk_is_a_message():
    status, _, error = ended(start(["gazempc.run", "--list"], ">/dev/full"))
    assert status == 2
    assert error.strip() == "gazempc: [Errno 28] No space left on device"


@pytest.mark.slow
def test_a_signal_ends_a_run_with_its_results_so_far(tmp_path):
    process = start([*RUN, "--noise-seeds", "1000", "--out", str(tmp_path)])
    for line in process.stderr:  # the second seed is under way: the first is complete
        if "noise seed 3" in line:
            break
    process.send_signal(signal.SIGTERM)
    status, out, error = ended(process)
    assert status == 128 + signal.SIGTERM
    assert "gazempc: interrupted: " in error
    assert "seeds of the noise" in out
    seeds = json.loads((tmp_path / "summary.json").read_text())["noise"]["seeds"]
    assert 1 <= len(seeds) < 1000
    for controller in ("reactive", "lookahead"):
        assert load_log(tmp_path / f"{controller}.npz").run.controller == controller


@pytest.mark.parametrize("module", ["gazempc.run", "experiments.console"])
def test_a_signal_during_the_imports_of_run_is_one_line(module):
    """The first heavy module that the command imports is the signal's moment."""
    code = (
        "import os, runpy, signal, sys\n"
        "class Finder:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name in ('tyro', 'pydantic'):\n"
        "            os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Finder())\n"
        "sys.argv = ['gazempc', 'run', '--list']\n"
        f"runpy.run_module({module!r}, run_name='__main__')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 130
    assert done.stderr == "gazempc run: interrupted before it began\n"
