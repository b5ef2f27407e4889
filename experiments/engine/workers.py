"""Worker processes that execute jobs, on this machine or on a cluster.

Joblib provides them: its loky backend on this machine, its dask backend on a cluster.
"""

from __future__ import annotations

import multiprocessing.resource_tracker
import os
import threading
import time
from collections.abc import Generator, Iterator, Mapping
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any

from experiments.engine.job import Job, Row, carry_out, program_hash
from gazempc.errors import GazempcError, importing
from gazempc.signals import kept_from_children

# Keys and rows of completed jobs; an exception thrown into the generator ends the workers and propagates.
Results = Generator[tuple[str, Row], None, None]
# Polling period of the parent process by a worker; an orphan ends within 2 s.
_PARENT_POLL_S = 0.5
# Idle time after which a worker ends; its start takes a second.
_IDLE_S = 10
_CONNECT_WITHIN_S, _LEAVE_WITHIN_S = 10, 1
# Controllers and solvers are not thread-safe, and a cluster worker may have several threads.
_JOB_LOCK = threading.Lock()
# One numerical thread per process: small matrices, parallelism by processes. Resource trackers clean up after killed
# workers without a warning.
_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    "PYTHONWARNINGS": "ignore:resource_tracker:UserWarning",
}


def on_this_machine(jobs: Mapping[str, Job], count: int) -> Results:
    """Execute jobs in spawned processes, which end with this process in any case.

    Args:
        jobs: Job by key.
        count: Number of busy worker processes.

    Yields:
        Key and result, in order of completion.

    Raises:
        GazempcError: If a worker process dies.
    """
    import joblib  # noqa: PLC0415  (workers import this module, and have no use for it)

    # With one process, joblib would run jobs in this one, which a job could end: two processes, of which one is busy.
    ahead = "2 * n_jobs" if count > 1 else 1
    parallel = joblib.Parallel(
        max(count, 2),
        backend="loky",
        return_as="generator_unordered",
        pre_dispatch=ahead,
        batch_size=1,
        max_nbytes=None,
        idle_worker_timeout=_IDLE_S,
        initializer=_end_with_parent,
        initargs=(os.getpid(),),
    )
    results: Any = None
    with _without_loky_race():
        try:
            with _environment():
                # Before signals are blocked: the start of a resource tracker would unblock them.
                multiprocessing.resource_tracker.ensure_running()
                with kept_from_children():
                    results = parallel(joblib.delayed(_work)(key, job, program_hash()) for key, job in jobs.items())
            yield from results
        except BrokenProcessPool:
            raise GazempcError("a worker process died (killed, or out of memory)") from None
        except KeyboardInterrupt as error:
            if results is not None:  # during the start; joblib warns of a generator deleted before its tasks are done
                results.throw(error)
            raise


class Cluster:
    """Workers of a dask.distributed cluster with this package installed and the recordings under the same paths.

    The job of a dead worker is reassigned; the scheduler abandons a job that has ended several workers.

    Args:
        address: Address of the scheduler, such as ``tcp://10.0.0.1:8786``.

    Raises:
        MissingOptionalDependencyError: If dask.distributed is not installed.
        GazempcError: If the scheduler does not respond.
    """

    def __init__(self, address: str) -> None:
        with importing("--dask", "distributed", "cluster"):
            import distributed  # noqa: PLC0415
        self._address = address
        try:
            self._client: Any = distributed.Client(  # type: ignore[no-untyped-call]
                address, timeout=_CONNECT_WITHIN_S, set_as_default=False
            )
        except (OSError, ValueError) as error:
            raise GazempcError(f"--dask {address}: no scheduler responds: {error}") from None

    def __call__(self, jobs: Mapping[str, Job]) -> Results:
        """Execute jobs, see `on_this_machine`.

        Raises:
            GazempcError: If the cluster fails.
        """
        import joblib  # noqa: PLC0415

        try:
            # With one core, joblib would run jobs in this process.
            if sum(self._client.ncores().values()) == 1:
                raise ValueError("a cluster of one core; accepted: two or more")
            with joblib.parallel_config(backend="dask", client=self._client):
                parallel = joblib.Parallel(return_as="generator_unordered", pre_dispatch="all", batch_size=1)
                results = parallel(joblib.delayed(_work)(key, job, program_hash()) for key, job in jobs.items())
            yield from results
        except Exception as error:  # from the cluster: `carry_out` does not raise
            raise GazempcError(f"--dask {self._address}: {type(error).__name__}: {error}") from None

    def close(self) -> None:
        """Disconnect; results of running jobs are discarded."""
        self._client.close(timeout=_LEAVE_WITHIN_S)


def _work(key: str, job: Job, program: str) -> tuple[str, Row]:
    with _JOB_LOCK:
        return key, carry_out(job, key, program)


@contextmanager
def _without_loky_race() -> Iterator[None]:
    """Omit the report of a race in loky 3.6: jobs submitted just before an abort have an id in a queue, but no entry.

    By then the workers are killed, and the thread would end in any case.
    """
    before = threading.excepthook

    def report(failure: threading.ExceptHookArgs) -> None:
        thread = failure.thread.name if failure.thread else ""
        if not (failure.exc_type is KeyError and thread == "ExecutorManagerThread"):
            before(failure)

    threading.excepthook = report
    try:
        yield
    finally:
        threading.excepthook = before


@contextmanager
def _environment() -> Iterator[None]:
    """Set the environment variables of child processes."""
    before = {name: os.environ.get(name) for name in _ENVIRONMENT}
    warn = ",".join(filter(None, (before["PYTHONWARNINGS"], _ENVIRONMENT["PYTHONWARNINGS"])))
    os.environ.update(_ENVIRONMENT | {"PYTHONWARNINGS": warn})
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def _end_with_parent(parent: int) -> None:
    """End this worker after the death of its parent."""

    def look() -> None:
        while os.getppid() == parent:
            time.sleep(_PARENT_POLL_S)
        os._exit(1)

    threading.Thread(target=look, name="parent watch", daemon=True).start()
