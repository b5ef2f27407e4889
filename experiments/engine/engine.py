"""Do jobs in parallel, keep every result at once in a file of its own, and never do one twice."""

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

from experiments.engine.job import Cluster, Job, Row, on_this_machine
from gazempc.errors import GazempcError, shown
from gazempc.files.npz import read_npz
from gazempc.files.whole import write_whole
from gazempc.signals import deferred, raise_if_received

# Name of a result's plain part, JSON with the job's key; the other entries are its arrays.
_PLAIN = "row"
_REASON_SHOWN = 200
# With more jobs the time that they take is estimated, from so many of them.
_MANY, _SAMPLE = 1000, 20


class Cache:
    """A folder with results by their keys, each an ``.npz`` file; several commands may share it.

    Args:
        folder: The folder; made if it is not there.

    Raises:
        GazempcError: If the folder cannot be made.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise GazempcError(f"{folder}: cannot make this folder: {error.strerror}") from None

    def path(self, key: str) -> Path:
        """Where the result of a job is kept."""
        return self.folder / f"{key}.npz"

    def find(self, key: str) -> Row | None:
        """The result of a job, if it is kept.

        Args:
            key: Key of the job.

        Returns:
            The result; None if there is none, or if its file is damaged, which is reported on standard error.
        """
        path = self.path(key)
        if not path.is_file():
            return None
        try:
            return read_result(path)
        except GazempcError as error:
            print(f"{error}; the job is done again", file=sys.stderr)
            path.unlink()
            return None

    def keep(self, key: str, row: Row) -> Row:
        """Keep a result.

        Args:
            key: Key of the job.
            row: The result.

        Returns:
            The result as `find` will give it.
        """
        arrays = {name: value for name, value in row.items() if isinstance(value, np.ndarray)}
        plain = {name: value for name, value in row.items() if name not in arrays}
        text = json.dumps({"key": key, "row": plain})
        file = io.BytesIO()
        np.savez(file, allow_pickle=False, **{_PLAIN: np.array(text)}, **arrays)
        write_whole(self.path(key), file.getvalue())
        return {**json.loads(text)["row"], **arrays}


def read_result(path: Path) -> Row:
    """Read a file of a `Cache`; the archive has check sums.

    Args:
        path: The file.

    Returns:
        The result.

    Raises:
        GazempcError: If the file is damaged, or is not that of the job by whose key it is named.
    """
    try:
        arrays = read_npz(path)
        content = json.loads(str(arrays.pop(_PLAIN)))
        if content["key"] != path.stem:
            raise ValueError("the result of another job")
        return {**content["row"], **arrays}
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        problem = shown(str(error), _REASON_SHOWN)
        raise GazempcError(f"{path}: a damaged result ({type(error).__name__}: {problem})") from None


class Engine:
    """Executes jobs without a result, in a ``with`` block; workers end with the program, or 10 s after the block.

    Each result is kept at once, so an interrupted command continues. Failed jobs are repeated at the next start.

    Args:
        folder: Where the results are kept; several commands may share it.
        jobs: Worker processes on this machine.
        dask: Address of the scheduler of a cluster that does the jobs instead; None for this machine.
        unit: What the progress bar counts.
        total: Number of jobs over all calls of `run`, as far as known before.

    Raises:
        MissingOptionalDependencyError: With `dask`, without dask.distributed.
        GazempcError: If no scheduler answers there, or the folder cannot be made.
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
        """Get the results of jobs.

        Args:
            jobs: Which; equal ones are done once.

        Returns:
            The results in the order of the jobs, each with ``failed`` and ``left_out``: the reason, or None.

        Raises:
            GazempcError: If worker processes die, or the cluster fails; what was done is kept.
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
        """Do some of the jobs, from all parts of the list, and print how long the others will take."""
        sample = list(missing)[:: len(missing) // _SAMPLE]
        # The first jobs of a worker include its start.
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
            raise GazempcError(f"{error}; {kept}: run the same command again to go on") from None
        except BaseException as error:
            results.throw(error)  # ends the workers, and raises it again
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
