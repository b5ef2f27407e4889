"""What a file is, is looked at before it is read; and how much memory its reading may take."""

from __future__ import annotations

import errno
import os
import stat
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

try:
    import resource
except ImportError:  # Windows has no limits of a process
    resource = None  # type: ignore[assignment]

MEGABYTE = 2**20
# An hour of 30 joints at 30 Hz as text. Larger files are no recording of one walk.
MOST_TEXT_BYTES = 100 * MEGABYTE
# Settings, necks and mappings have a few kilobytes; parsers written in Python need a second for this.
MOST_SETTINGS_BYTES = 256 * 1024
# Reading a file takes so much memory, and so many times its size, at most: a table of text takes 12 times its size.
_READING_BYTES, _READING_PER_BYTE = 250 * MEGABYTE, 12
_KINDS: tuple[tuple[Callable[[int], bool], str], ...] = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
# The limit is that of the process: two threads at once would restore each other's.
_ONE_READER = threading.RLock()


def is_there(path: Path) -> bool:
    """Whether there is a file, or anything else but a folder; False, too, for names that no system has."""
    try:
        return path.exists() and not path.is_dir()
    except (OSError, ValueError):
        return False


def check_file(path: Path, most_bytes: int | None = None) -> int:
    """Refuse what is no regular file, or too large, before anything is read: a pipe would never end.

    Args:
        path: The file.
        most_bytes: Its largest size; None for any.

    Returns:
        Its size, bytes.

    Raises:
        OSError: If there is no such file, or it is refused; `strerror` says why.
    """
    return _checked(path, path.stat(), most_bytes)


def check_folder(path: Path) -> int:
    """Refuse a folder with anything but regular files and folders in it: a reader might wait for it for ever.

    Args:
        path: The folder.

    Returns:
        Size of its files together, bytes.

    Raises:
        OSError: Names what is refused, and why.
    """
    return sum(check_file(part) for part in path.iterdir() if not part.is_dir())


def read_limited(path: Path, most_bytes: int) -> bytes:
    """Read a file that may be anything.

    Args:
        path: The file.
        most_bytes: Its largest size.

    Returns:
        Its bytes.

    Raises:
        OSError: If it cannot be read, is no regular file or is too large; `strerror` says why.
    """
    # Without O_NONBLOCK, the opening of a pipe would wait for somebody who writes.
    opened = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    with os.fdopen(opened, "rb") as file:
        _checked(path, os.fstat(file.fileno()), most_bytes)
        data = file.read(most_bytes + 1)
    if len(data) > most_bytes:  # such as files of the system, which state no size
        raise _too_large(path, most_bytes)
    return data


@contextmanager
def memory_for(size_bytes: int) -> Iterator[None]:
    """Let nothing in here take far more memory or disk than a file's size explains; only where the system can do that.

    Args:
        size_bytes: Size of the file that is read in here.

    Raises:
        OSError: If more was asked for.
    """
    used_bytes = _address_space_bytes()
    if resource is None or used_bytes is None:
        yield
        return
    with _ONE_READER:
        more_bytes = _READING_BYTES + _READING_PER_BYTE * size_bytes
        before = {kind: resource.getrlimit(kind) for kind in (resource.RLIMIT_AS, resource.RLIMIT_FSIZE)}
        _lower(resource.RLIMIT_AS, used_bytes + more_bytes)
        _lower(resource.RLIMIT_FSIZE, more_bytes)  # a packed bag is unpacked on the disk
        try:
            yield
        except MemoryError:
            raise OSError(errno.ENOMEM, "its content takes far more memory than its size explains") from None
        finally:
            for kind, limits in before.items():
                resource.setrlimit(kind, limits)


def _lower(kind: int, most_bytes: int) -> None:
    """Lower a limit of the process, where it is not lower already."""
    soft, hard = resource.getrlimit(kind)
    known = [limit for limit in (soft, hard, most_bytes) if limit != resource.RLIM_INFINITY]
    resource.setrlimit(kind, (min(known), hard))


def _checked(path: Path, found: os.stat_result, most_bytes: int | None) -> int:
    if not stat.S_ISREG(found.st_mode):
        what = next((name for is_kind, name in _KINDS if is_kind(found.st_mode)), "something else")
        raise OSError(errno.EINVAL, f"this is {what}, not a regular file", str(path))
    if most_bytes is not None and found.st_size > most_bytes:
        raise _too_large(path, most_bytes, found.st_size)
    return found.st_size


def _too_large(path: Path, most_bytes: int, size_bytes: int | None = None) -> OSError:
    has = "" if size_bytes is None else f"it has {_size(size_bytes)}; "
    return OSError(errno.EFBIG, f"the file is too large: {has}accepted are {_size(most_bytes)} at most", str(path))


def _size(count_bytes: int) -> str:
    return f"{count_bytes / MEGABYTE:.0f} MB" if count_bytes >= MEGABYTE else f"{count_bytes / 1024:.0f} kB"


def _address_space_bytes() -> int | None:
    """What this process may address by now; None where the system does not say."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    except OSError:
        return None
    return pages * os.sysconf("SC_PAGE_SIZE")
