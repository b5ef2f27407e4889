"""Jobs: their interface, the keys of their results, and their execution in worker processes.

Workers are those of joblib: on this machine by its loky backend, on a cluster by its dask backend.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing.resource_tracker
import os
import sys
import threading
import time
import traceback
from collections.abc import Generator, Iterator, Mapping
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import lru_cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

from pydantic_core import to_jsonable_python

from gazempc.errors import GazempcError, LeftOutError, importing
from gazempc.parts import CONTROLLER, PREDICTOR, error_line, find, is_own
from gazempc.recordings.readers.tables.mapping import saved_places
from gazempc.signals import kept_from_children

_LIBRARIES = ("casadi", "daqp", "numpy", "scipy", "filterpy", "ruckig", "control")
_CODE = {".py", ".toml", ".npz"}

# Result of a job by name: plain data of JSON, or numpy arrays; `failed` and `left_out` are a reason or None.
Row = dict[str, Any]


class Job(Protocol):
    """A job: frozen plain data that can be sent to another process or machine."""

    def key(self) -> str:
        """Name of its result: a hash of all that the result depends on, see `key_of`."""
        ...

    def run(self) -> Row:
        """Do it, in a worker.

        Returns:
            The result; an entry ``left_out`` gives the reason why there is none.

        Raises:
            LeftOutError: If the experiment cannot be made with this recording.
            GazempcError: If it cannot be done.
        """
        ...


def carry_out(job: Job, key: str, program: str) -> Row:
    """Execute a job in a worker, without raising.

    Args:
        job: The job.
        key: Its key in the process that made it; another one here means another computation.
        program: `program_hash` of that process.

    Returns:
        The result of `job.run`, with ``left_out`` and ``failed``.
    """
    try:
        if (here := program_hash()) != program:
            return _failed(f"the worker's program ({here}) is not the one that asks ({program})")
        if job.key() != key:
            return _failed("the worker does not find the same files: one has changed since the start, or is not there")
        return {"left_out": None, "failed": None, **job.run()}
    except LeftOutError as error:
        return {"left_out": str(error), "failed": None}
    except GazempcError as error:
        return _failed(str(error))
    except (Exception, SystemExit) as error:  # a bug, a lack of memory or an exit in one job must not end the others
        last = traceback.extract_tb(error.__traceback__)[-1]
        return _failed(f"{error_line(error)} ({Path(last.filename).name}, line {last.lineno})")


def _failed(reason: str) -> Row:
    return {"left_out": None, "failed": reason}


def key_of(job: Job, **contents: Any) -> str:
    """Key of a job: a hash of its fields and of the program.

    Args:
        job: The job, a dataclass of plain data.
        contents: Further dependencies, such as hashes of files; an entry with the name of a field replaces it.

    Returns:
        The key, fit for a file name.
    """
    contents_of_job = [type(job).__qualname__, {**to_jsonable_python(job), **contents}, program_hash()]
    return hashlib.sha256(json.dumps(contents_of_job, sort_keys=True).encode()).hexdigest()[:20]


@lru_cache(maxsize=1)
def program_hash() -> str:
    """Hash of the program: the sources of `predictors`, `gazempc` and `experiments`, and the libraries' versions.

    A process runs the program that it has started with, so the hash is made once.
    """
    digest = hashlib.sha256()
    for package in ("predictors", "gazempc", "experiments"):
        found = find_spec(package)  # not imported: not every job needs them
        assert found is not None
        assert found.origin is not None
        root = Path(found.origin).parent
        for path in sorted(p for p in root.rglob("*") if p.suffix in _CODE):
            digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    for library in _LIBRARIES:
        digest.update(f"{library} {version(library)}".encode())
    return digest.hexdigest()[:20]


def file_hash(path: Path) -> str:
    """Hash of a file's bytes; empty if there is no such file."""
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


def recording_hash(name_or_path: str) -> list[str]:
    """Dependencies of a recording.

    Args:
        name_or_path: Synthetic name, or path.

    Returns:
        Its name, and hashes of its file or of all files of its folder, of the ``index.csv`` beside it, which gives
        person and group, and of what is saved there of its columns; for a synthetic name there are none.
    """
    path = Path(name_or_path)
    if not path.exists():
        return [path.stem]
    own = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    return [path.stem, *(file_hash(p) for p in (*own, path.with_name("index.csv"), *saved_places(path)))]


def models_hash(fitted: Path | None) -> str:
    """Hash of fitted models of the predictor `walker`.

    Args:
        fitted: A model, or a folder with models in it; None for the model that ships.

    Returns:
        The hash; the same wherever the folder is.
    """
    if fitted is None:
        return ""
    digest = hashlib.sha256(file_hash(fitted).encode())
    for path in sorted([*fitted.glob("*.npz"), *(fitted / "left_out").glob("*.npz")]):
        digest.update(f"{path.relative_to(fitted)} {file_hash(path)}".encode())
    return digest.hexdigest()


@lru_cache(maxsize=64)
def module_hash(module: str) -> str:
    """Hash of the source of a module, or of all sources of a package, that this process has imported.

    It is made once: what is changed later is not what this process runs.
    """
    loaded = sys.modules[module]
    # A folder without `__init__.py` is a package, too, and has no file of its own.
    folders = [Path(folder) for folder in getattr(loaded, "__path__", ())]
    files = sorted(file for folder in folders for file in folder.rglob("*.py")) or [Path(loaded.__file__ or "")]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files if path.is_file())).hexdigest()


def parts_hash(controller: str, predictor: str) -> list[str]:
    """Hashes of the user's own parts of a run.

    Args:
        controller: A shipped name, or ``module:Class``.
        predictor: The same.

    Returns:
        A hash for each that is the user's own: of its module, or of its whole package, any module of which may do the
        work. Modules imported from elsewhere are not seen.

    Raises:
        SettingsError: If one cannot be imported.
    """
    found = []
    for kind, choice in ((CONTROLLER, controller), (PREDICTOR, predictor)):
        if is_own(choice):
            find(kind, choice)
            found.append(module_hash(choice.partition(":")[0].partition(".")[0]))
    return found


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
        with importing("--dask", "distributed", "cluster"):
            import distributed  # noqa: PLC0415
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
