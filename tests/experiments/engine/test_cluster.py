"""The engine on a dask.distributed cluster: a killed worker's job is done by another, a signal cancels the rest."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tiny_jobs import Tiny

from experiments.engine.engine import Engine

ROOT = Path(__file__).resolve().parents[3]
HANG_S = 240


@pytest.fixture(scope="module")
def cluster():
    """A cluster of two single-threaded processes that find the tests' modules."""
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed (extra cluster)")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0", silence_logs=50
    ) as running:
        yield running


@pytest.mark.slow
def test_results_come_from_the_cluster_and_failures_are_rows(cluster, tmp_path):
    with Engine(tmp_path, jobs=1, dask=cluster.scheduler_address) as engine:
        rows = engine.run([*(Tiny(n) for n in range(4)), Tiny(2, "array"), Tiny(1, "fail"), Tiny(1, "bug")])
    assert [row.get("square") for row in rows] == [0, 1, 4, 9, 4, None, None]
    assert [bool(row["failed"]) for row in rows] == [False] * 5 + [True] * 2
    assert len(list(tmp_path.iterdir())) == 5


@pytest.mark.slow
def test_a_killed_workers_job_is_done_by_another(cluster, tmp_path):
    log = tmp_path / "log"
    jobs = [Tiny(n, "die once", str(log)) for n in range(2)]
    with Engine(tmp_path / "runs", jobs=1, dask=cluster.scheduler_address) as engine:
        assert [row["square"] for row in engine.run(jobs)] == [0, 1]
    assert len(log.read_text().splitlines()) == 3


@pytest.mark.slow
def test_a_signal_ends_the_command_and_cancels_its_jobs(cluster, tmp_path):
    log = tmp_path / "log"
    log.touch()
    while len(cluster.scheduler.workers) < 2:  # one of them may just have been killed
        time.sleep(0.05)
    command = [sys.executable, str(ROOT / "tests" / "tiny_jobs.py"), str(tmp_path / "runs"), str(log), "1", "2"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(
        [*command, cluster.scheduler_address], stderr=subprocess.PIPE, text=True, env=environment
    )
    while not log.read_text():
        assert process.poll() is None, process.stderr.read()
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=HANG_S)
    (tmp_path / "log.over").touch()  # else the end of the cluster waits for what its workers are still at
    assert process.returncode == 130
    assert "tiny: interrupted: 1 of 3 results are kept in" in error
    assert "Traceback" not in error
