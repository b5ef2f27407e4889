"""Results of jobs, each in a file of its own that is written whole or not at all."""

from __future__ import annotations

import hashlib
import io
import json
import os
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from experiments.engine.job import Row
from gazempc.errors import GazempcError

# Name of the plain part of a result with arrays.
_PLAIN = "row"


class Cache:
    """A folder with results by their keys; several commands may share it.

    A result is a ``.json`` file, or an ``.npz`` file if it has numpy arrays.

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

    def find(self, key: str) -> Row | None:
        """The result of a job, if it is kept.

        Args:
            key: Key of the job.

        Returns:
            The result; None if there is none, or if its file is damaged, which is said on standard error.
        """
        path = result_file(self.folder, key)
        if path is None:
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
        text = _sealed(key, plain)
        if not arrays:
            write_whole(self.folder / f"{key}.json", text)
            return _opened(text, key)
        file = io.BytesIO()
        np.savez(file, allow_pickle=False, **{_PLAIN: np.array(text)}, **arrays)
        write_whole(self.folder / f"{key}.npz", file.getvalue())
        return _opened(text, key) | arrays


def result_file(folder: Path, key: str) -> Path | None:
    """Where the result of a job is; None if it is not kept."""
    return next((p for p in (folder / f"{key}.json", folder / f"{key}.npz") if p.is_file()), None)


def read_result(path: Path) -> Row:
    """Read and check a file of a `Cache`.

    Args:
        path: The file.

    Returns:
        The result.

    Raises:
        GazempcError: If the file is damaged, or is not that of the job by whose key it is named.
    """
    try:
        if path.suffix == ".json":
            return _opened(path.read_text(encoding="utf-8"), path.stem)
        with np.load(
            io.BytesIO(path.read_bytes()), allow_pickle=False
        ) as data:  # each array has a check sum, which reading compares
            return _opened(str(data[_PLAIN]), path.stem) | {name: data[name] for name in data.files if name != _PLAIN}
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile, EOFError) as error:
        raise GazempcError(f"{path}: a damaged result ({type(error).__name__}: {error})") from None


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file whole or not at all, also if the process is killed.

    Args:
        path: File to write.
        content: Text or bytes.
    """
    part = path.with_suffix(f".{os.getpid()}.part")
    try:
        part.write_bytes(content.encode() if isinstance(content, str) else content)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _sealed(key: str, plain: Row) -> str:
    text = json.dumps(plain)
    return json.dumps({"key": key, "sha256": hashlib.sha256(text.encode()).hexdigest(), "row": plain})


def _opened(text: str, key: str) -> Row:
    content: dict[str, Any] = json.loads(text)
    row: Row = content["row"]
    if content["key"] != key or content["sha256"] != hashlib.sha256(json.dumps(row).encode()).hexdigest():
        raise ValueError("its content is not what was written")
    return row
