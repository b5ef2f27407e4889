"""Atomic writing of files, and exclusive access to a run's output folder."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from gazempc.errors import GazempcError

with suppress(ImportError):  # Windows
    import fcntl

# Output files of a run. A controller's log has a file of computing times beside it.
_OUTPUT_FILES = re.compile(
    r"(summary\.json|settings\.yaml|report\.html|(overview|birds_eye|angles|gaze_error)\.png|gaze\.gif|"
    r"(log|compute)_\d{3,}\.(npz|mcap))(\.\d+\.part)?"
)
_TIMES = "_compute.npz"


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Temporary file that atomically replaces the target on success.

    Args:
        path: Target. A link is replaced, not followed.

    Yields:
        Path of the temporary file.

    Raises:
        OSError: If it cannot be written; names the file.
    """
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        with naming(path):
            part.unlink(missing_ok=True)
            yield part
            part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def write_whole(path: Path, content: str | bytes | Callable[[IO[bytes]], object]) -> None:
    """Write a file atomically, also if the process is killed or the disk is full.

    Args:
        path: File to write.
        content: Text, bytes, or a function that writes to an open file.

    Raises:
        OSError: If it cannot be written; names the file.
    """
    with whole(path) as part, part.open("xb") as file:
        if callable(content):
            content(file)
        else:
            file.write(content.encode() if isinstance(content, str) else content)


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Add the file's path to errors of the file system.

    Args:
        path: The file that is written.

    Raises:
        OSError: With the path.
    """
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, f"cannot be written: {error.strerror or error}", str(path)) from None


@contextmanager
def begin_folder(out: Path) -> Iterator[None]:
    """Lock an output folder for one run, and remove the files of earlier runs.

    Args:
        out: The folder, made if it does not exist. Files of other names are kept; subfolders are ignored.

    Raises:
        GazempcError: If another run, of this process or another one, is writing to it.
        OSError: If it cannot be created, or an old file cannot be removed.
    """
    with naming(out):
        out.mkdir(parents=True, exist_ok=True)
    with _locked(out):
        _remove_earlier(out)
        yield


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    if os.name == "nt":
        yield
        return
    # A lock on the folder itself needs no lock file and ends with the process.
    opened = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise GazempcError(f"{folder}: another run is writing to this folder: give another --out") from None
        except OSError:  # a file system without locks
            pass
        yield
    finally:
        with suppress(OSError):
            fcntl.flock(opened, fcntl.LOCK_UN)  # also for child processes that have inherited it
        os.close(opened)


def _remove_earlier(out: Path) -> None:
    logs = {path.name.removesuffix(_TIMES) for path in out.glob(f"*{_TIMES}")}
    old = {f"{log}{ending}" for log in logs for ending in (".npz", ".mcap", _TIMES)}
    for path in out.iterdir():
        if (path.name in old or _OUTPUT_FILES.fullmatch(path.name)) and not path.is_dir():
            path.unlink()
