"""The job engine: every job once, every result kept, every failure a row."""

import os
import subprocess
import sys

import numpy as np
import pytest
from tiny_jobs import Tiny

from experiments.engine.engine import Engine
from experiments.engine.job import carry_out, program_hash
from gazempc.errors import GazempcError


def names(folder):
    return {path.name: path.stat().st_mtime_ns for path in folder.iterdir()}


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """Folder and rows of a first run: squares, an array, and every way not to have a result."""
    folder = tmp_path_factory.mktemp("engine")
    jobs = [Tiny(3), Tiny(1), Tiny(3), Tiny(2, "array"), Tiny(1, "leave out"), Tiny(1, "fail"), Tiny(1, "bug")]
    with Engine(folder, jobs=2) as engine:
        return folder, jobs, engine.run(jobs)


def test_results_come_in_the_order_of_the_jobs_and_equal_jobs_are_done_once(first):
    folder, _, rows = first
    assert [row.get("square") for row in rows[:4]] == [9, 1, 9, 4]
    np.testing.assert_array_equal(rows[3]["array"], np.full((2, 2), 0.1))
    assert len(list(folder.iterdir())) == 4  # without the equal one and the failed ones
    assert all(row["pid"] != os.getpid() for row in rows[:4])


def test_failures_are_rows_with_their_reason(first):
    rows = first[2]
    assert rows[4] == {"left_out": "too near", "failed": None}
    assert rows[5] == {"left_out": None, "failed": "no such walk"}
    assert rows[6]["failed"].startswith("TypeError: a bug (tiny_jobs.py, line ")


def test_a_second_run_does_only_what_failed(first):
    folder, jobs, rows = first
    before = names(folder)
    with Engine(folder, jobs=1) as engine:
        again = engine.run(jobs)
    assert names(folder) == before
    assert [row.get("pid") for row in again[:4]] == [row["pid"] for row in rows[:4]]
    assert again[6]["failed"] == rows[6]["failed"]


@pytest.mark.slow
def test_before_many_jobs_their_time_is_estimated(tmp_path, capsys):
    jobs = [Tiny(k) for k in range(1100)]
    with Engine(tmp_path, jobs=2) as engine:
        rows = engine.run(jobs)
    assert [row["square"] for row in rows] == [k * k for k in range(1100)]
    assert "1100 runs to do: about" in capsys.readouterr().err


def test_a_worker_that_dies_is_said_and_the_rest_is_kept(tmp_path):
    with Engine(tmp_path, jobs=1) as engine:
        engine.run([Tiny(1), Tiny(2)])
        with pytest.raises(GazempcError, match=r"a worker process died .*; 2 of 3 results are kept in "):
            engine.run([Tiny(1, "die")])
    assert len(list(tmp_path.iterdir())) == 2


def test_another_program_or_file_in_the_worker_is_no_result():
    job = Tiny(2)
    assert "is not the one that asks" in carry_out(job, job.key(), "0")["failed"]
    assert "not find the same files" in carry_out(job, "0", program_hash())["failed"]
    assert carry_out(job, job.key(), program_hash())["square"] == 4


def test_importing_the_engine_for_a_worker_is_light():
    """A worker imports what its jobs need, and nothing that only the command needs."""
    heavy = {"matplotlib", "tyro", "scipy.stats", "casadi", "distributed", "joblib"}
    code = (
        f"import sys, experiments.engine.job, experiments.engine.workers; print(sorted({heavy!r} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
