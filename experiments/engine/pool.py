"""Do jobs in parallel processes, keep every result at once, and never do one twice."""

from __future__ import annotations

import json
import multiprocessing
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any, Protocol, TypeVar

from tqdm import tqdm

from gazempc.errors import GazempcError


class Keyed(Protocol):
    """A job: plain data that can be sent to another process."""

    def key(self) -> str:
        """Name of the job: a hash of all that its result depends on."""
        ...


J = TypeVar("J", bound=Keyed)


def run_jobs(
    jobs: Sequence[J], folder: Path, workers: int, execute: Callable[[J], dict[str, Any]]
) -> list[dict[str, Any]]:
    """Do all jobs that have no result yet.

    Each result is a file of its own, named by the job's hash and written whole or not at all, so that an interrupted
    command goes on where it stopped and several may share a folder.

    Args:
        jobs: What to do.
        folder: Where the results are kept.
        workers: Number of processes.
        execute: Does a job, in another process; never raises for what a user can cause, but says so in the row's
            ``failed``.

    Returns:
        The rows in the order of the jobs.

    Raises:
        GazempcError: If worker processes die (killed, out of memory); what was done is kept.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise GazempcError(f"{folder}: cannot make this folder: {error.strerror}") from None
    failed: dict[Path, dict[str, Any]] = {}
    paths = [folder / f"{job.key()}.json" for job in jobs]
    missing = {path: job for path, job in zip(paths, jobs, strict=True) if not path.is_file()}
    if missing:
        # One numerical thread a process: the matrices are small, and the processes are the parallelism.
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
            os.environ.setdefault(name, "1")
        # A fresh interpreter a worker: no state of this process is inherited.
        context = multiprocessing.get_context("spawn")
        bar = tqdm(total=len(jobs), initial=len(jobs) - len(missing), unit="run", file=sys.stderr, mininterval=1.0)
        pool = ProcessPoolExecutor(max_workers=workers, mp_context=context)
        try:
            waiting = {pool.submit(execute, job): path for path, job in missing.items()}
            for done in as_completed(waiting):
                row, path = done.result(), waiting[done]
                if row["failed"]:
                    failed[path] = row  # not kept: the next start tries again
                else:
                    write_whole(path, json.dumps(row))
                bar.update()
        except BrokenProcessPool:
            raise GazempcError(
                f"a worker process died; results so far are kept in {folder}: run the same command again to go on"
            ) from None
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            bar.close()
    return [failed[path] if path in failed else json.loads(path.read_text(encoding="utf-8")) for path in paths]


def write_whole(path: Path, text: str) -> None:
    """Write a file whole or not at all, also if the process is killed.

    Args:
        path: File to write.
        text: Its content.
    """
    part = path.with_suffix(f".{os.getpid()}.part")
    part.write_text(text, encoding="utf-8")
    part.replace(path)
