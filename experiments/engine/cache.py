"""Results of jobs, each in a file of its own that is written whole or not at all."""

from __future__ import annotations

import hashlib
import io
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from experiments.engine.job import Row
from gazempc.errors import GazempcError, shown
from gazempc.files.bounds import MEGABYTE, read_limited
from gazempc.files.npz import read_npz
from gazempc.files.whole import write_whole

# Name of the plain part of a result with arrays.
_PLAIN = "row"
_MOST_BYTES = 500 * MEGABYTE
_REASON_SHOWN = 200


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
        text = _sealed(key, plain, arrays)
        if not arrays:
            write_whole(self.folder / f"{key}.json", text)
            return _opened(text, key, arrays)
        file = io.BytesIO()
        np.savez(file, allow_pickle=False, **{_PLAIN: np.array(text)}, **arrays)
        write_whole(self.folder / f"{key}.npz", file.getvalue())
        return _opened(text, key, arrays)


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
        data = read_limited(path, _MOST_BYTES)
        if path.suffix == ".json":
            return _opened(data.decode("utf-8"), path.stem, {})
        arrays = read_npz(data)
        return _opened(str(arrays.pop(_PLAIN)), path.stem, arrays)
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        problem = shown(str(error), _REASON_SHOWN)
        raise GazempcError(f"{path}: a damaged result ({type(error).__name__}: {problem})") from None


def _sealed(key: str, plain: Row, arrays: Row) -> str:
    """Text of the plain part, with a check sum of all: archives have sums of their own, but not of names and kinds."""
    return json.dumps({"key": key, "sha256": _sum(plain, arrays), "row": plain})


def _opened(text: str, key: str, arrays: Row) -> Row:
    content: dict[str, Any] = json.loads(text)
    row: Row = content["row"]
    if content["key"] != key or content["sha256"] != _sum(row, arrays):
        raise ValueError("its content is not what was written")
    return row | arrays


def _sum(plain: Row, arrays: Row) -> str:
    digest = hashlib.sha256(json.dumps(plain).encode())
    for name, array in arrays.items():
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
