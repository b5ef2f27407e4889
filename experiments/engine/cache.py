"""Results of jobs, each in a file of its own that is written whole or not at all."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import numpy as np

from experiments.engine.job import Row
from gazempc.errors import GazempcError, shown
from gazempc.files.npz import read_npz
from gazempc.files.whole import write_whole

# Name of a result's plain part, JSON with the job's key; the other entries are its arrays.
_PLAIN = "row"
_REASON_SHOWN = 200


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
