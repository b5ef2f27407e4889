"""Jobs in worker processes: on this machine by joblib's loky backend, on a cluster by its dask backend."""

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
from gazempc.errors import GazempcError, MissingOptionalDependencyError
from gazempc.signals import kept_from_children

# Key and row of a job that has ended; to throw an exception into it ends the workers, and raises the exception.
Results = Generator[tuple[str, Row], None, None]
# An orphan ends within 2 s.
_LOOK_FOR_PARENT_S = 0.5
# A worker without a job ends after this time. One that starts needs a second.
_IDLE_S = 10
_CONNECT_WITHIN_S, _LEAVE_WITHIN_S = 10, 1
# Controllers and solvers are not made for threads, of which a worker of a cluster may have several.
_ONE_AT_A_TIME = threading.Lock()
# One numerical thread a process: the matrices are small, and the processes are the parallelism. Trackers do not warn of
# what killed workers leave: they clean it up.
_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    "PYTHONWARNINGS": "ignore:resource_tracker:UserWarning",
}


def on_this_machine(jobs: Mapping[str, Job], count: int) -> Results:
    """Do jobs in processes with a fresh interpreter each, which end with this process, however it ends.

    Args:
        jobs: Job by key.
        count: Worker processes that are busy at once.

    Yields:
        Key and result, in the order in which jobs end.

    Raises:
        GazempcError: If a worker process dies.
    """
    import joblib  # noqa: PLC0415  (workers import this module, and have no use for it)

    # With one process, joblib would work in this one, which a job could end. So there are two, of which one works.
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
    try:
        with _environment():
            # Before signals are blocked: the start of a tracker would lift the block.
            multiprocessing.resource_tracker.ensure_running()
            with kept_from_children():
                results = parallel(joblib.delayed(_work)(key, job, program_hash()) for key, job in jobs.items())
        yield from results
    except BrokenProcessPool:
        raise GazempcError("a worker process died (killed, or out of memory)") from None


class Cluster:
    """Workers of a dask.distributed cluster, which have this package and see the recordings under the same paths.

    Another worker does the job of one that died; the scheduler gives up a job that ends several.

    Args:
        address: Of the scheduler, such as ``tcp://10.0.0.1:8786``.

    Raises:
        MissingOptionalDependencyError: Without dask.distributed.
        GazempcError: If no scheduler answers there.
    """

    def __init__(self, address: str) -> None:
        try:
            import distributed  # noqa: PLC0415
        except ImportError:
            raise MissingOptionalDependencyError("--dask", "distributed", "cluster") from None
        self._address = address
        try:
            self._client: Any = distributed.Client(  # type: ignore[no-untyped-call]
                address, timeout=_CONNECT_WITHIN_S, set_as_default=False
            )
        except (OSError, ValueError) as error:
            raise GazempcError(f"--dask {address}: no scheduler answers there: {error}") from None

    def __call__(self, jobs: Mapping[str, Job]) -> Results:
        """Do jobs, see `on_this_machine`.

        Raises:
            GazempcError: If the cluster fails.
        """
        import joblib  # noqa: PLC0415

        try:
            # With one core, joblib would work in this process.
            if sum(self._client.ncores().values()) == 1:
                raise ValueError("a cluster of one core; accepted: two or more")
            with joblib.parallel_config(backend="dask", client=self._client):
                parallel = joblib.Parallel(return_as="generator_unordered", pre_dispatch="all", batch_size=1)
                results = parallel(joblib.delayed(_work)(key, job, program_hash()) for key, job in jobs.items())
            yield from results
        except Exception as error:  # of the cluster: jobs themselves do not raise
            raise GazempcError(f"--dask {self._address}: {type(error).__name__}: {error}") from None

    def close(self) -> None:
        """Leave; a job that a worker has begun ends there, unheard."""
        self._client.close(timeout=_LEAVE_WITHIN_S)


def _work(key: str, job: Job, program: str) -> tuple[str, Row]:
    with _ONE_AT_A_TIME:
        return key, carry_out(job, key, program)


@contextmanager
def _environment() -> Iterator[None]:
    """Environment of the processes that are started in here."""
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
    """End this worker soon after its parent, which may have been killed."""

    def look() -> None:
        while os.getppid() == parent:
            time.sleep(_LOOK_FOR_PARENT_S)
        os._exit(1)

    threading.Thread(target=look, name="parent watch", daemon=True).start()
