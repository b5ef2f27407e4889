"""Parallel execution of jobs with a persistent cache: each result is stored immediately in a separate file."""

from __future__ import annotations

import io
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from tqdm import tqdm

from experiments.engine.job import Job, Row
from experiments.engine.workers import Cluster, on_this_machine
from gazempc.errors import GazempcError, shown
from gazempc.files.npz import read_npz
from gazempc.files.whole import write_whole
from gazempc.signals import deferred, raise_if_received

# Archive entry with the job's key and the plain values as JSON; the other entries are arrays.
_PLAIN = "row"
_REASON_SHOWN = 200
# Number of jobs from which the duration is estimated, and size of the sample.
_MANY, _SAMPLE = 1000, 20


class Cache:
    """Persistent results by key, each an ``.npz`` file in a folder that several commands may share.

    Args:
        folder: The folder; created if missing.

    Raises:
        GazempcError: If the folder cannot be created.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise GazempcError(f"{folder}: cannot create this folder: {error.strerror}") from None

    def path(self, key: str) -> Path:
        """File of a job's result."""
        return self.folder / f"{key}.npz"

    def find(self, key: str) -> Row | None:
        """Look up the result of a job.

        Args:
            key: Key of the job.

        Returns:
            The result; None if missing, or if its file is damaged, which is reported on standard error.
        """
        path = self.path(key)
        if not path.is_file():
            return None
        try:
            return read_result(path)
        except GazempcError as error:
            print(f"{error}; the job is repeated", file=sys.stderr)
            path.unlink()
            return None

    def keep(self, key: str, row: Row) -> Row:
        """Store a result.

        Args:
            key: Key of the job.
            row: The result.

        Returns:
            The result as `find` returns it.
        """
        arrays = {name: value for name, value in row.items() if isinstance(value, np.ndarray)}
        plain = {name: value for name, value in row.items() if name not in arrays}
        text = json.dumps({"key": key, "row": plain})
        file = io.BytesIO()
        np.savez(file, allow_pickle=False, **{_PLAIN: np.array(text)}, **arrays)
        write_whole(self.path(key), file.getvalue())
        return {**json.loads(text)["row"], **arrays}


def read_result(path: Path) -> Row:
    """Read a file of a `Cache`; the archive has checksums.

    Args:
        path: The file.

    Returns:
        The result.

    Raises:
        GazempcError: If the file is damaged, or its key differs from its name.
    """
    try:
        arrays = read_npz(path)
        content = json.loads(str(arrays.pop(_PLAIN)))
        if content["key"] != path.stem:
            raise ValueError("it is the result of another job")
        return {**content["row"], **arrays}
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        problem = shown(str(error), _REASON_SHOWN)
        raise GazempcError(f"{path}: a damaged result ({type(error).__name__}: {problem})") from None


class Engine:
    """Context manager that executes uncached jobs; workers end with the program, or 10 s after the block.

    Each result is stored immediately, so an interrupted command can be resumed. Failed jobs are repeated at the next
    start.

    Args:
        folder: Folder of the results; several commands may share it.
        jobs: Worker processes on this machine.
        dask: Address of the scheduler of a cluster; None for this machine.
        unit: Unit of the progress bar.
        total: Expected number of jobs over all calls of `run`.

    Raises:
        MissingOptionalDependencyError: If `dask` is given and dask.distributed is not installed.
        GazempcError: If the scheduler does not respond, or the folder cannot be created.
    """

    def __init__(self, folder: Path, jobs: int, dask: str | None = None, unit: str = "run", total: int = 0) -> None:
        self._cluster = None if dask is None else Cluster(dask)
        self._cache = Cache(folder)
        self._jobs, self._unit, self._total = jobs, unit, total
        self._bar: Any = None  # a tqdm
        self._rows: dict[str, Row] = {}

    def __enter__(self) -> Engine:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        with deferred():
            if self._bar is not None:
                self._bar.close()
            if self._cluster is not None:
                self._cluster.close()
        if isinstance(error, KeyboardInterrupt):
            error.add_note(f"{self._kept()} are kept in {self._cache.folder}")

    def run(self, jobs: Sequence[Job]) -> list[Row]:
        """Results of jobs, cached or computed.

        Args:
            jobs: The jobs; equal ones are executed once.

        Returns:
            The results in the order of the jobs, each with ``failed`` and ``left_out``: the reason, or None.

        Raises:
            GazempcError: If worker processes die, or the cluster fails; finished results are kept.
            Interrupted: After a signal, see `gazempc.signals`.
        """
        with deferred():
            keys = [job.key() for job in jobs]
            new = {key: job for key, job in zip(keys, jobs, strict=True) if key not in self._rows}
            missing = {key: job for key, job in new.items() if not self._found(key)}
            self._total = max(self._total, len(self._rows) + len(missing))
        failed = self._do(missing) if missing else {}
        return [failed.get(key) or self._rows[key] for key in keys]

    def _found(self, key: str) -> bool:
        raise_if_received()
        row = self._cache.find(key)
        if row is not None:
            self._rows[key] = row
            self._count()
        return row is not None

    def _do(self, missing: dict[str, Job]) -> dict[str, Row]:
        if self._bar is None:
            self._bar = tqdm(total=self._total, unit=self._unit, file=sys.stderr, mininterval=1.0)
            self._count(len(self._rows))
        self._bar.total = self._total
        failed: dict[str, Row] = {}
        if len(missing) > _MANY:
            self._estimate(missing, failed)
        self._carry_out({key: job for key, job in missing.items() if key not in self._rows | failed}, failed)
        return failed

    def _estimate(self, missing: dict[str, Job], failed: dict[str, Row]) -> None:
        """Execute an evenly spaced sample of the jobs, and print the estimated duration of the others."""
        sample = list(missing)[:: len(missing) // _SAMPLE]
        # Untimed: the first jobs of a worker include its start-up.
        self._carry_out({key: missing[key] for key in sample[: _SAMPLE // 4]}, failed)
        timed, began_s = sample[_SAMPLE // 4 :], time.monotonic()
        self._carry_out({key: missing[key] for key in timed}, failed)
        left_min = (time.monotonic() - began_s) / len(timed) * (len(missing) - len(sample)) / 60.0
        self._bar.write(f"{len(missing)} {self._unit}s to do: about {left_min:.0f} min", file=sys.stderr)

    def _carry_out(self, missing: dict[str, Job], failed: dict[str, Row]) -> None:
        cluster = self._cluster
        results = cluster(missing) if cluster else on_this_machine(missing, min(self._jobs, len(missing)))
        try:
            for key, row in results:
                with deferred():
                    self._keep(key, row, failed)
        except GazempcError as error:
            kept = f"{self._kept()} are kept in {self._cache.folder}"
            raise GazempcError(f"{error}; {kept}: run the same command again to resume") from None
        except BaseException as error:
            results.throw(error)  # ends the workers and re-raises
            raise

    def _keep(self, key: str, row: Row, failed: dict[str, Row]) -> None:
        if row["failed"]:
            failed[key] = row
        else:
            self._rows[key] = self._cache.keep(key, row)
        self._count()

    def _count(self, n: int = 1) -> None:
        if self._bar is not None:
            self._bar.update(n)

    def _kept(self) -> str:
        return f"{len(self._rows)} of {self._total} results"
