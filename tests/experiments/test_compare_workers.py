"""A comparison by worker processes from end to end; the other tests of commands do their jobs in one process."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from builders.comparisons import rows_of, settings
from builders.in_process import workers_in_this_process
from builders.own_parts import own_module

from experiments.compare import compare, main

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
def test_interrupted_in_the_middle_it_goes_on_and_ends_the_same(tmp_path):
    """One SIGTERM after the first results: started again it does only the rest, and the tables are the same."""
    words = ["--recordings", "subject01_R1", "subject01_R4", "subject02_R6", "--controllers", "reactive", "lookahead"]
    words += ["--predictors", "last_position", "--no-figures", "--jobs", "1", "--out", str(tmp_path / "stopped")]
    process = subprocess.Popen(
        [sys.executable, "-m", "experiments.compare", *words], cwd=ROOT, stderr=subprocess.PIPE, text=True
    )
    kept = tmp_path / "stopped" / "runs"
    while len(list(kept.glob("*.npz"))) < 2:
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.01)
    process.send_signal(signal.SIGTERM)
    _, error = process.communicate(timeout=240)
    before = {path: path.stat().st_mtime_ns for path in kept.glob("*.npz")}
    assert process.returncode == 143
    assert 2 <= len(before) < 6
    assert f"compare: interrupted: {len(before)} of 6 results are kept in {kept}" in error
    with workers_in_this_process():
        assert main(words) == 0
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in before.items())
    chosen = settings(tmp_path / "undisturbed", controllers=("reactive", "lookahead"), predictors=("last_position",))
    with workers_in_this_process():
        compare(**chosen)
    assert rows_of(tmp_path / "stopped") == rows_of(tmp_path / "undisturbed")


@pytest.mark.slow
def test_a_worker_finds_a_part_of_ones_own(tmp_path, monkeypatch):
    own = own_module(tmp_path, monkeypatch)
    words = ["--recordings", "subject01_R4", "--controllers", f"{own}:Sluggish", "--predictors", "last_position"]
    assert main([*words, "--jobs", "1", "--no-figures", "--out", str(tmp_path / "out")]) == 0
    (row,) = rows_of(tmp_path / "out")
    assert (row["controller"], row["failed"]) == ("sluggish", "")
