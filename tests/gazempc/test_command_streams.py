"""Commands: streams, signals, full disks, and atomic writes."""

import json
import os
import re
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from experiments.console import main as gazempc
from gazempc import command
from gazempc.errors import LimitViolationError, SettingsError
from gazempc.files.whole import begin_folder, whole
from gazempc.results.log_files import load_log

ROOT = Path(__file__).resolve().parents[2]
RUN = ["gazempc.run", "--replay", "subject03_R4", "--controllers", "reactive", "--predictor", "constant_velocity"]
LIVE = ["gazempc.live", "--robot", "simulated", "--no-figures", "--source"]
HANG_S = 240


def start(words, shell_end=""):
    """Start a command as a shell does; both output streams are text pipes."""
    command = f'exec "{sys.executable}" -m {" ".join(words)} {shell_end}'
    return subprocess.Popen(
        ["/bin/sh", "-c", command],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
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
def test_closed_standard_input_ends_the_source(tmp_path):
    status, out, _ = ended(start([*LIVE, "stdin", "--log", "npz", "--out", str(tmp_path)], "<&-"))
    assert status == 0
    assert "end of the source" in out


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_output_to_a_full_disk_gives_a_message():
    status, _, error = ended(start(["gazempc.run", "--list"], ">/dev/full"))
    assert status == 2
    assert "[Errno 28]" in error


@pytest.mark.slow
def test_a_signal_ends_a_run_with_its_results_so_far(tmp_path):
    process = start([*RUN, "--noise-seeds", "1000", "--no-figures", "--out", str(tmp_path)])
    for line in process.stderr:  # the third seed is running: two are complete
        if re.search(r"noise seed ([2-9]|1\d)", line):
            break
    process.send_signal(signal.SIGTERM)
    status, out, error = ended(process)
    assert status == 128 + signal.SIGTERM
    assert "gazempc: interrupted: " in error
    assert "seeds of the noise" in out
    seeds = json.loads((tmp_path / "summary.json").read_text())["noise"]["seeds"]
    assert 1 <= len(seeds) < 1000
    assert load_log(tmp_path / "reactive.npz").run.controller == "reactive"


@pytest.mark.parametrize(
    ("module", "name"),
    [("experiments.console", "gazempc run"), ("experiments.compare", "compare")],
)
def test_a_signal_during_the_imports_is_one_line(module, name):
    """The signal arrives at the import of the first heavy module."""
    code = (
        "import os, runpy, signal, sys\n"
        "class Finder:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name in ('tyro', 'pydantic'):\n"
        "            os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Finder())\n"
        "sys.argv = ['gazempc', 'run', '--list']\n"
        f"runpy.run_module({module!r}, run_name='__main__', alter_sys=True)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 130
    assert done.stderr == f"{name}: interrupted during start-up\n"


# ruff: noqa: PTH208, PT012


MOST_BYTES = 20_000


def test_an_interrupted_write_keeps_the_old_file(tmp_path):
    path = tmp_path / "summary.json"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), whole(path) as part:
        part.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["summary.json"]


def test_only_files_of_an_earlier_run_are_removed(tmp_path):
    mine = ["notes.txt", "data.npz", "walk.csv", "log_of_mine.npz", "angles.pdf", "walk_compute.csv"]
    old = ["summary.json", "settings.yaml", "report.html", "log_000.npz", "log_001.mcap", "compute_000.npz", "gaze.gif"]
    old += ["mpc.npz", "mpc_compute.npz", "mpc.mcap", "overview.png", "summary.json.4711.part"]
    for name in mine + old:
        (tmp_path / name).write_text("old")
    (tmp_path / "angles.png").mkdir()
    with begin_folder(tmp_path):
        pass
    assert sorted(os.listdir(tmp_path)) == sorted([*mine, "angles.png"])


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        "run --replay subject03_R1 --controllers reactive --noise-seeds 1 --no-figures",
        "live --source replay --robot simulated --duration-s 2.5 --log-s 1",
    ],
)
def test_a_full_disk_is_reported_with_the_path_and_leaves_no_partial_file(words, tmp_path, capsys):
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (MOST_BYTES, before[1]))
    try:
        status = gazempc([*words.split(), "--out", str(tmp_path)])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    error = capsys.readouterr().err
    assert status == command.BAD_INPUT, error
    assert "cannot be written: File too large" in error
    assert str(tmp_path) in error
    assert "Traceback" not in error
    assert not list(tmp_path.glob("*.part"))
    for path in tmp_path.glob("log_*.npz"):
        load_log(path)


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (LimitViolationError("left"), 1),
        (SettingsError("wrong"), 2),
        (OSError("full"), 2),
        (ZeroDivisionError("bug"), 3),
        (MemoryError(), 3),
        (RecursionError(), 3),
    ],
)
def test_status_1_means_a_limit_violation_only(error, status, capsys):
    def work():
        raise error

    assert command.run_command("name", work) == status
    assert ("Traceback" in capsys.readouterr().err) == (status == command.UNEXPECTED)
