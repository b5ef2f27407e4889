"""What is written is written whole or not at all, with the path where it cannot be, and not among what was there."""
# ruff: noqa: PTH208, PT012

import os
import subprocess
import sys

import pytest

from gazempc import command
from gazempc.errors import LimitViolationError, SettingsError
from gazempc.files.whole import begin_folder, whole
from gazempc.results.log import load_log
from gazempc.run import main

MOST_BYTES = 20_000


def test_whatever_interrupts_leaves_the_old_one(tmp_path):
    path = tmp_path / "summary.json"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), whole(path) as part:
        part.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["summary.json"]


def test_an_earlier_run_is_taken_away_and_nothing_else(tmp_path):
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
def test_results_of_two_runs_are_not_mixed(tmp_path):
    words = ["--replay", "subject03_R4", "--noise-seeds", "1", "--no-figures", "--out", str(tmp_path)]
    for controllers in (("reactive", "lookahead"), ("reactive",)):
        assert main([*words, "--controllers", *controllers]) == 0
    assert "reactive.npz" in os.listdir(tmp_path)
    assert not any(name.startswith("lookahead") for name in os.listdir(tmp_path))
    # A log that is measured again stays, and so does what stands beside it.
    assert main(["--replay", str(tmp_path / "reactive.npz"), "--no-figures", "--out", str(tmp_path)]) == 0
    assert "reactive.npz" in os.listdir(tmp_path)


COMMANDS = {
    "replay": [
        "gazempc.run",
        "--replay",
        "subject03_R4",
        "--controllers",
        "reactive",
        "--noise-seeds",
        "1",
        "--no-figures",
    ],
    "live": [
        "gazempc.live",
        "--source",
        "replay",
        "--robot",
        "simulated",
        "--duration-s",
        "2.5",
        "--log-s",
        "1",
    ],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_a_full_disk_is_said_with_the_path_and_leaves_no_half_file(name, tmp_path):
    # The limit is set in the new process: a function between fork and exec is unsafe in a process with threads.
    limited = f"""
import resource, runpy, sys
resource.setrlimit(resource.RLIMIT_FSIZE, ({MOST_BYTES}, {MOST_BYTES}))
del sys.argv[0]
runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
"""
    done = subprocess.run(
        [sys.executable, "-c", limited, *COMMANDS[name], "--out", str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == command.BAD_INPUT, done.stderr
    assert "cannot be written: File too large" in done.stderr
    assert str(tmp_path) in done.stderr
    assert "Traceback" not in done.stderr
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
def test_one_says_that_a_limit_was_left_and_only_that(error, status, capsys):
    def work():
        raise error

    assert command.run_command("name", work) == status
    assert ("Traceback" in capsys.readouterr().err) == (status == command.UNEXPECTED)
