"""Do the runs of a sweep, on this machine or on a cluster; keep every result at once and never do one twice."""

from __future__ import annotations

import hashlib
import json
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

from tqdm import tqdm

from experiments.engine.jobs import attempt, figures_of, fitted_hash, program_hash
from experiments.engine.pool import write_whole
from experiments.sweep.plan import Walk
from experiments.sweep.variants import Variant
from gazempc.controllers.controller import Controller
from gazempc.errors import GazempcError, MissingOptionalDependencyError
from gazempc.neck.spec import NeckSpec
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.recording import Recording
from gazempc.settings import ControllerName, LookAheadSettings, MpcSettings, RunSettings
from gazempc.sim.replay import make_controller, replay

# These say where a run is written or are resolved into specifications; none changes its figures.
_NOT_HASHED = {"replay", "list", "controllers", "out", "figures", "config", "neck", "sensor"}
# A result with this key says nothing about the run, only that the worker could not do it; it is not kept.
_AGAIN = "again"
# Controllers and solvers are not made for threads, of which a worker of a cluster may have several.
_ONE_AT_A_TIME = threading.Lock()


@dataclass(frozen=True)
class Run:
    """One variant on one recording.

    Attributes:
        walk: The recording.
        variant: Everything else.
        version: Hash of the program that is to do it.
    """

    walk: Walk
    variant: Variant
    version: str

    def key(self) -> str:
        """Name of the result: a hash of the resolved settings, the recording's bytes and the version."""
        v = self.variant
        content = {
            "recording": [self.walk.name, self.walk.digest],
            "controller": v.controller,
            "settings": v.settings.model_dump(mode="json", exclude=_NOT_HASHED),
            "necks": [v.model_neck.model_dump(mode="json"), v.robot_neck.model_dump(mode="json")],
            "sensors": {name: sensor.model_dump(mode="json") for name, sensor in v.sensors.items()},
            "version": self.version,
        }
        if (fitted := v.settings.walker.fitted) is not None:
            content["fitted"] = fitted_hash(fitted)
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:20]


# Does runs by their keys and gives each result as soon as there is one, in any order.
Evaluate = Callable[[Mapping[str, Run]], Iterator[tuple[str, dict[str, Any]]]]


class Runner:
    """Does runs that have no result yet and keeps each result in a file of its own.

    Args:
        folder: Where the results are kept; an interrupted sweep goes on there, and several may share it.
        evaluate: What does the runs, see `local` and `cluster`.
        total: Number of different runs at most, for the progress bar.

    Attributes:
        simulated_s: Simulated time of the runs done, not of those found done, seconds.
    """

    def __init__(self, folder: Path, evaluate: Evaluate, total: int) -> None:
        self._folder = folder
        self._evaluate = evaluate
        self._bar = tqdm(total=total, unit="run", file=sys.stderr, mininterval=1.0)
        self._counted: set[str] = set()
        self._folder.mkdir(parents=True, exist_ok=True)
        self.simulated_s = 0.0

    def run(self, runs: Sequence[Run]) -> list[dict[str, Any]]:
        """Get the results of runs.

        Args:
            runs: Which; equal ones are done once.

        Returns:
            A result for each run: figures, or ``left_out`` or ``failed`` with the reason.
        """
        keys = [run.key() for run in runs]
        missing = {key: run for key, run in zip(keys, runs, strict=True) if not self._path(key).is_file()}
        self._count(key for key in keys if key not in missing)
        lost: dict[str, dict[str, Any]] = {}
        for key, result in self._evaluate(missing) if missing else ():
            if result.pop(_AGAIN, False):
                lost[key] = result
            else:
                write_whole(self._path(key), json.dumps(result))
                self.simulated_s += result.get("simulated_s", 0.0)
            self._count([key])
        return [lost[key] if key in lost else json.loads(self._path(key).read_text(encoding="utf-8")) for key in keys]

    def close(self) -> None:
        """End the progress bar."""
        self._bar.close()

    def _count(self, keys: Iterable[str]) -> None:
        # A tuning reads its results more than once.
        new = set(keys) - self._counted
        self._counted |= new
        self._bar.update(len(new))

    def _path(self, key: str) -> Path:
        return self._folder / f"{key}.json"


def local(workers: int) -> AbstractContextManager[Evaluate]:
    """Processes of this machine.

    Args:
        workers: How many.

    Returns:
        A context with what does the runs. If a worker process dies, that raises GazempcError; what was done is kept.

    Raises:
        MissingOptionalDependencyError: Without joblib.
    """
    joblib = _extra("A sweep", "joblib", "sweep")
    died = joblib.externals.loky.process_executor.TerminatedWorkerError

    def evaluate(runs: Mapping[str, Run]) -> Iterator[tuple[str, dict[str, Any]]]:
        # One numerical thread a process: the matrices are small, and the processes are the parallelism.
        with joblib.parallel_config(backend="loky", inner_max_num_threads=1):
            # In batches of one, so that a result is kept as soon as there is one.
            parallel = joblib.Parallel(n_jobs=workers, return_as="generator_unordered", batch_size=1)
            try:
                yield from parallel(joblib.delayed(_execute_named)(key, run) for key, run in runs.items())
            except died:
                raise GazempcError(
                    "a worker process died; results so far are kept: run the same command again to go on"
                ) from None

    @contextmanager
    def context() -> Iterator[Evaluate]:
        yield evaluate

    return context()


def cluster(address: str) -> AbstractContextManager[Evaluate]:
    """Workers of a dask.distributed cluster, which need this package and see the recordings under the same paths.

    A run of a worker that dies is done by another. Results come back to this process, which alone writes them.

    Args:
        address: Of the scheduler, such as ``tcp://10.0.0.1:8786``.

    Returns:
        A context with what does the runs.

    Raises:
        MissingOptionalDependencyError: Without dask.distributed.
        GazempcError: If no scheduler answers there.
    """
    distributed = _extra("--dask", "distributed", "cluster")

    @contextmanager
    def context() -> Iterator[Evaluate]:
        try:
            client = distributed.Client(address, timeout=10)
        except (OSError, ValueError) as error:
            raise GazempcError(f"--dask {address}: no scheduler answers there: {error}") from None

        def evaluate(runs: Mapping[str, Run]) -> Iterator[tuple[str, dict[str, Any]]]:
            # The key says what is computed: the scheduler holds one task for it, however often it is asked.
            names = {f"gazempc-{key}": key for key in runs}
            futures = [client.submit(execute, runs[key], key=name, pure=True, retries=2) for name, key in names.items()]
            for future in distributed.as_completed(futures):
                try:
                    result = future.result()
                except Exception as error:  # whatever the worker or the scheduler says is the run's reason
                    result = {"failed": f"{type(error).__name__}: {error}", _AGAIN: True}
                yield names[future.key], result

        with client:
            yield evaluate

    return context()


def execute(run: Run) -> dict[str, Any]:
    """Do a run; never raises.

    Args:
        run: The run.

    Returns:
        The figures, or ``left_out`` or ``failed`` with the reason.
    """
    here = program_hash()
    if here != run.version:
        return {"failed": f"the worker's program ({here}) is not the sweep's ({run.version})", _AGAIN: True}
    if run.walk.digest:
        try:
            same = hashlib.sha256(Path(run.walk.path).read_bytes()).hexdigest() == run.walk.digest
        except OSError as error:
            return {"failed": f"the worker cannot read {run.walk.path}: {error.strerror}", _AGAIN: True}
        if not same:
            return {"failed": f"{run.walk.path} has changed since the sweep began", _AGAIN: True}
    try:
        with _ONE_AT_A_TIME:
            return attempt(lambda: _figures(run))
    except Exception as error:  # a bug or a lack of memory in one run must not end a thousand others
        return {"failed": f"{type(error).__name__}: {error}", _AGAIN: True}


def _extra(feature: str, package: str, extra: str) -> Any:
    try:
        return import_module(package)
    except ImportError:
        raise MissingOptionalDependencyError(feature, package, extra) from None


def _execute_named(key: str, run: Run) -> tuple[str, dict[str, Any]]:
    return key, execute(run)


def _figures(run: Run) -> dict[str, Any]:
    v = run.variant
    recording = _recording(run.walk.path, run.walk.digest, v.settings.reading)
    placement = v.settings.placement or ("recorded" if recording.has_robot else "side")
    placed = place(recording, placement, v.settings.distance_m, v.settings.height_m)
    controller = _controller(v.controller, v.model_neck, v.settings.lookahead, v.settings.mpc)
    sensor = v.sensor_for(recording)
    return figures_of(*replay(placed, v.model_neck, sensor, v.controller, v.settings, controller, v.robot_neck))


# What many runs share is made once in each worker; above all the MPC's solver.
@lru_cache(maxsize=8)
def _recording(path: str, digest: str, reading: ReadOptions) -> Recording:
    return load(path, reading)


@lru_cache(maxsize=16)
def _controller(name: ControllerName, neck: NeckSpec, lookahead: LookAheadSettings, mpc: MpcSettings) -> Controller:
    return make_controller(name, neck, RunSettings(lookahead=lookahead, mpc=mpc))
