"""Checks of a file before it is read: its kind, its size, and the size of its content."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

import numpy as np

MEGABYTE = 2**20
# An hour of 30 joints at 30 Hz as text. Larger files are no recording of one walk.
MOST_TEXT_BYTES = 100 * MEGABYTE
# Settings, necks and mappings have a few kilobytes; parsers written in Python need a second for this.
MOST_SETTINGS_BYTES = 256 * 1024
# An hour of 75 columns at 100 Hz; as Python's text they take 2 GB.
MOST_VALUES = 30_000_000
# Content of a packed file: some megabytes are packed to nearly nothing, larger content rarely to a twelfth.
_UNPACKED_BYTES, _UNPACKED_PER_BYTE = 250 * MEGABYTE, 12
_IS_BLANK = np.isin(np.arange(256), list(b" \r\n"))


def is_there(path: Path) -> bool:
    """Whether there is a file, or anything else but a folder; False, too, for names that no system has."""
    try:
        return path.exists() and not path.is_dir()
    except (OSError, ValueError):
        return False


def check_file(path: Path, most_bytes: int | None = None) -> int:
    """Check type and size of a file before reading: a pipe would never end.

    Args:
        path: The file.
        most_bytes: Its largest size; None for any.

    Returns:
        Its size, bytes.

    Raises:
        OSError: If there is no such file, or it is refused; `strerror` has the reason.
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
        OSError: If it cannot be read, is no regular file or is too large; `strerror` has the reason.
    """
    # Without O_NONBLOCK, opening a pipe waits for a writer.
    opened = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    with os.fdopen(opened, "rb") as file:
        _checked(path, os.fstat(file.fileno()), most_bytes)
        data = file.read(most_bytes + 1)
    if len(data) > most_bytes:  # such as files of the system, which state no size
        raise _too_large(path, most_bytes)
    return data


def most_unpacked_bytes(size_bytes: int) -> int:
    """Largest content of a packed file that its size explains.

    Args:
        size_bytes: Size of the file.

    Returns:
        Bytes.
    """
    return _UNPACKED_BYTES + _UNPACKED_PER_BYTE * size_bytes


def check_unpacked(unpacked_bytes: int, size_bytes: int) -> None:
    """Refuse a packed file by the size of its content, before it is unpacked.

    Args:
        unpacked_bytes: Size of the content.
        size_bytes: Size of the file.

    Raises:
        OSError: If the content is far larger than the file.
    """
    if unpacked_bytes > most_unpacked_bytes(size_bytes):
        problem = f"its content takes far more memory than its size explains: {_size(unpacked_bytes)} unpacked"
        raise OSError(errno.ENOMEM, f"{problem}, {_size(most_unpacked_bytes(size_bytes))} accepted")


def check_values(data: bytes) -> None:
    """Refuse text by the number of its values, before it is cut: each takes some 60 bytes of memory.

    Args:
        data: Text whose values are separated by blanks, commas, semicolons or tabs.

    Raises:
        OSError: If there are more than `MOST_VALUES`.
    """
    blank = _IS_BLANK[np.frombuffer(data, dtype=np.uint8)]
    # A run of blanks separates once.
    count = sum(map(data.count, (b",", b";", b"\t"))) + int((blank[1:] & ~blank[:-1]).sum())
    if count > MOST_VALUES:
        raise OSError(errno.EFBIG, f"it has {count} values; accepted are {MOST_VALUES} at most")


def _checked(path: Path, found: os.stat_result, most_bytes: int | None) -> int:
    if not stat.S_ISREG(found.st_mode):
        kind = "a folder" if stat.S_ISDIR(found.st_mode) else "a pipe, a socket or a device"
        raise OSError(errno.EINVAL, f"this is {kind}, not a regular file", str(path))
    if most_bytes is not None and found.st_size > most_bytes:
        raise _too_large(path, most_bytes, found.st_size)
    return found.st_size


def _too_large(path: Path, most_bytes: int, size_bytes: int | None = None) -> OSError:
    has = "" if size_bytes is None else f"it has {_size(size_bytes)}; "
    return OSError(errno.EFBIG, f"the file is too large: {has}accepted are {_size(most_bytes)} at most", str(path))


def _size(count_bytes: int) -> str:
    return f"{count_bytes / MEGABYTE:.0f} MB" if count_bytes >= MEGABYTE else f"{count_bytes / 1024:.0f} kB"
