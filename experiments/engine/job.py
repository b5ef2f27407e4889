"""Jobs: interface, keys of results, and execution of one job."""

from __future__ import annotations

import hashlib
import json
import sys
import traceback
from functools import lru_cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

from pydantic_core import to_jsonable_python

from gazempc.errors import GazempcError, LeftOutError
from gazempc.parts import CONTROLLER, PREDICTOR, error_line, find, is_own
from gazempc.recordings.readers.tables.mapping import saved_places

_LIBRARIES = ("casadi", "daqp", "numpy", "scipy", "filterpy", "ruckig", "control")
_CODE = {".py", ".toml", ".npz"}

# Result of a job: JSON values and NumPy arrays by name; `failed` and `left_out` are a reason or None.
Row = dict[str, Any]


class Job(Protocol):
    """A job: an immutable, serialisable value object."""

    def key(self) -> str:
        """Key of its result: a hash of all dependencies, see `key_of`."""
        ...

    def run(self) -> Row:
        """Execute the job, in a worker.

        Returns:
            The result; an entry ``left_out`` has the reason for an empty one.

        Raises:
            LeftOutError: If the recording is not applicable.
            GazempcError: If the job fails.
        """
        ...


def carry_out(job: Job, key: str, program: str) -> Row:
    """Execute a job in a worker, without raising.

    Args:
        job: The job.
        key: Its key in the main process; a different one here means different inputs.
        program: `program_hash` of the main process.

    Returns:
        The result of `job.run`, with ``left_out`` and ``failed``.
    """
    try:
        if (here := program_hash()) != program:
            return _failed(f"the worker's program ({here}) differs from the main process's ({program})")
        if job.key() != key:
            return _failed("the worker's files differ: one has changed since the start, or is missing")
        return {"left_out": None, "failed": None, **job.run()}
    except LeftOutError as error:
        return {"left_out": str(error), "failed": None}
    except GazempcError as error:
        return _failed(str(error))
    except (Exception, SystemExit) as error:  # isolates the other jobs from a bug, a lack of memory or an exit
        last = traceback.extract_tb(error.__traceback__)[-1]
        return _failed(f"{error_line(error)} ({Path(last.filename).name}, line {last.lineno})")


def _failed(reason: str) -> Row:
    return {"left_out": None, "failed": reason}


def key_of(job: Job, **contents: Any) -> str:
    """Key of a job: a hash of fields and program.

    Args:
        job: The job, a dataclass of plain data.
        contents: Further dependencies, such as hashes of files; an entry named like a field replaces it.

    Returns:
        The key, valid as a file name.
    """
    contents_of_job = [type(job).__qualname__, {**to_jsonable_python(job), **contents}, program_hash()]
    return hashlib.sha256(json.dumps(contents_of_job, sort_keys=True).encode()).hexdigest()[:20]


@lru_cache(maxsize=1)
def program_hash() -> str:
    """Hash of the program: the sources of `predictors`, `gazempc` and `experiments`, and the libraries' versions.

    Computed once: a process runs the program that was loaded at its start.
    """
    digest = hashlib.sha256()
    for package in ("predictors", "gazempc", "experiments"):
        found = find_spec(package)  # not imported: not all jobs need them
        assert found is not None
        assert found.origin is not None
        root = Path(found.origin).parent
        for path in sorted(p for p in root.rglob("*") if p.suffix in _CODE):
            digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    for library in _LIBRARIES:
        digest.update(f"{library} {version(library)}".encode())
    return digest.hexdigest()[:20]


def file_hash(path: Path) -> str:
    """Hash of a file's bytes; empty if the file does not exist."""
    if not path.is_file():
        return ""
    state = path.stat()
    return _hash_of(path, state.st_ino, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=4096)  # thousands of jobs have the same recordings and models
def _hash_of(path: Path, *_state: int) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def recording_hash(name_or_path: str) -> list[str]:
    """Dependencies of a recording.

    Args:
        name_or_path: Synthetic name, or path.

    Returns:
        The name; except for a synthetic one, hashes of its file or of all files of its folder, of the ``index.csv``
        beside it, which has person and group, and of the saved choice of columns.
    """
    path = Path(name_or_path)
    if not path.exists():
        return [path.stem]
    own = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    return [path.stem, *(file_hash(p) for p in (*own, path.with_name("index.csv"), *saved_places(path)))]


def models_hash(fitted: Path | None) -> str:
    """Hash of fitted models of the predictor `walker`.

    Args:
        fitted: A model file, or a folder of models; None for the shipped model.

    Returns:
        The hash, independent of the location.
    """
    if fitted is None:
        return ""
    digest = hashlib.sha256(file_hash(fitted).encode())
    for path in sorted([*fitted.glob("*.npz"), *(fitted / "left_out").glob("*.npz")]):
        digest.update(f"{path.relative_to(fitted)} {file_hash(path)}".encode())
    return digest.hexdigest()


@lru_cache(maxsize=64)
def module_hash(module: str) -> str:
    """Hash of the source of an imported module, or of all sources of a package.

    Computed once: this process does not run later changes.
    """
    loaded = sys.modules[module]
    # A namespace package, without `__init__.py`, has no file.
    folders = [Path(folder) for folder in getattr(loaded, "__path__", ())]
    files = sorted(file for folder in folders for file in folder.rglob("*.py")) or [Path(loaded.__file__ or "")]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files if path.is_file())).hexdigest()


def parts_hash(controller: str, predictor: str) -> list[str]:
    """Hashes of the custom parts of a run.

    Args:
        controller: A shipped name, or ``module:Class``.
        predictor: The same.

    Returns:
        One hash per custom part: of its module, or of its whole package. Modules imported from other places are not
        included.

    Raises:
        SettingsError: If one cannot be imported.
    """
    found = []
    for kind, choice in ((CONTROLLER, controller), (PREDICTOR, predictor)):
        if is_own(choice):
            find(kind, choice)
            found.append(module_hash(choice.partition(":")[0].partition(".")[0]))
    return found
