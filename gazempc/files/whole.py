"""Files that are written whole or not at all, and the folder that a run writes to."""

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

# Files that a run writes. A controller's log has its computing times beside it.
_OURS = re.compile(
    r"(summary\.json|settings\.yaml|report\.html|(overview|birds_eye|angles|gaze_error)\.png|gaze\.gif|"
    r"(log|compute)_\d{3,}\.(npz|mcap))(\.\d+\.part)?"
)
_TIMES = "_compute.npz"


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A file to write in here, which takes the place of another one only once it is complete.

    Args:
        path: Where it is to stand at the end. A link there is replaced, not followed.

    Yields:
        Where to write it.

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
    """Write a file whole or not at all, also if the process is killed or the disk is full.

    Args:
        path: File to write.
        content: Text, bytes, or what writes to an open file.

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
    """Name the file in errors of the file system.

    Args:
        path: The file that is written inside.

    Raises:
        OSError: With the path.
    """
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, f"cannot be written: {error.strerror or error}", str(path)) from None


@contextmanager
def begin_folder(out: Path) -> Iterator[None]:
    """The folder that one run alone writes to inside; what an earlier run wrote there is taken away.

    Args:
        out: The folder, made if it does not exist. Files of other names stay; folders are not looked into.

    Raises:
        GazempcError: If another run, of this process or another one, writes there now.
        OSError: If it cannot be constructed, or an old file cannot be removed.
    """
    with naming(out):
        out.mkdir(parents=True, exist_ok=True)
    with _alone_in(out):
        _remove_earlier(out)
        yield


@contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    if os.name == "nt":
        yield
        return
    # A lock of the folder itself: no file stays behind, and it ends with the process.
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
        if (path.name in old or _OURS.fullmatch(path.name)) and not path.is_dir():
            path.unlink()
