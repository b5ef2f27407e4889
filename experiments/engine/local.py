"""Worker processes on this machine."""

from __future__ import annotations

import multiprocessing.resource_tracker
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from typing import TYPE_CHECKING

from experiments.engine.job import Job, Row, carry_out
from experiments.engine.keys import program_hash
from experiments.engine.signals import kept_from_children
from experiments.engine.workers import Outcome
from gazempc.errors import GazempcError

if TYPE_CHECKING:
    from concurrent.futures import Future

# An orphan is to end within 2 s.
_LOOK_FOR_PARENT_S = 0.5
# Killed workers are gone in a tenth of it; a command is to be able to say its last line within 3 s.
_LEAVE_WITHIN_S = 1.5
# One numerical thread a process: the matrices are small, and the processes are the parallelism.
_ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
}


class LocalWorkers:
    """Processes with a fresh interpreter each. They end with this process, however it ends.

    Args:
        count: How many.

    Attributes:
        at_once: See `Workers`.
    """

    def __init__(self, count: int) -> None:
        # Imported here, because the workers themselves import this module and have no use for it.
        from joblib.externals import loky  # noqa: PLC0415

        # One job each, and one that waits. Of more the pool forgets some when it is ended in the middle of them.
        self.at_once = 2 * count
        self._died = loky.process_executor.TerminatedWorkerError
        # Before signals are blocked: the start of a tracker would lift the block.
        with _quiet_trackers():
            loky.backend.resource_tracker.ensure_running()
            multiprocessing.resource_tracker.ensure_running()
        self._pool = loky.ProcessPoolExecutor(count, initializer=_watch, initargs=(os.getpid(),), env=_ONE_THREAD)
        self._started = False

    def submit(self, key: str, job: Job, ended: Callable[[str, Outcome], None]) -> None:
        """See `Workers`; the outcome raises GazempcError if a worker process died."""
        # The first job starts all processes.
        with nullcontext() if self._started else kept_from_children():
            future = self._pool.submit(carry_out, job, key, program_hash())
        self._started = True
        future.add_done_callback(lambda f: ended(key, partial(self._outcome, f)))

    def stop(self) -> None:
        """See `Workers`; what does not end soon ends with this process."""
        end = threading.Thread(target=self._pool.shutdown, kwargs={"kill_workers": True}, daemon=True)
        end.start()
        end.join(_LEAVE_WITHIN_S)

    def _outcome(self, future: Future[Row]) -> Row:
        try:
            return future.result()
        except self._died:
            raise GazempcError("a worker process died (killed, or out of memory)") from None


@contextmanager
def _quiet_trackers() -> Iterator[None]:
    """Trackers that start meanwhile do not warn of what killed workers leave: they only clean it up."""
    before = os.environ.get("PYTHONWARNINGS")
    os.environ["PYTHONWARNINGS"] = ",".join(filter(None, (before, "ignore:resource_tracker:UserWarning")))
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYTHONWARNINGS"]
        else:
            os.environ["PYTHONWARNINGS"] = before


def _watch(parent: int) -> None:
    """End this worker soon after its parent, which may have had no time to say so; and only then."""
    from joblib.externals.loky import process_executor  # noqa: PLC0415

    # It would end workers that have grown by 300 MB, as they do who fit networks, and warn of it.
    process_executor._MAX_MEMORY_LEAK_SIZE = sys.maxsize

    def look() -> None:
        while os.getppid() == parent:
            time.sleep(_LOOK_FOR_PARENT_S)
        os._exit(1)

    threading.Thread(target=look, name="parent watch", daemon=True).start()
