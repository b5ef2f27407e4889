"""Names of results: hashes of all that a result depends on."""

from __future__ import annotations

import hashlib
import json
import sys
from functools import lru_cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from gazempc.recordings.readers.tables.mapping import saved_places

_LIBRARIES = ("casadi", "daqp", "numpy", "scipy", "filterpy", "ruckig", "control")
_CODE = {".py", ".toml", ".npz"}


def key_of(content: dict[str, Any], *modules: str) -> str:
    """Key of a job.

    Args:
        content: All settings and hashes of files that the result depends on; plain data.
        modules: Modules of `experiments` that do it, the job's own (``__name__``) among them.

    Returns:
        The key, fit for a file name.
    """
    told = {"content": content, "modules": [module_hash(m) for m in modules], "program": program_hash()}
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:20]


@lru_cache(maxsize=1)
def program_hash() -> str:
    """Hash of all that computes a run: the sources of `predictors` and `gazempc`, and the versions of the libraries.

    A process runs the program that it has started with, so the hash is made once.
    """
    digest = hashlib.sha256()
    for package in ("predictors", "gazempc"):
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
    """What a recording depends on.

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
    """What fitted models of the predictor `walker` are.

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
