"""Reading of files after checks of type, size and unpacked size; of text, every failure is a `RecordingError`."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

import numpy as np

from gazempc.errors import RecordingError

MEGABYTE = 2**20
# An hour of 30 joints at 30 Hz as text. Larger files are not recordings of one walk.
MOST_TEXT_BYTES = 100 * MEGABYTE
# Settings, necks and mappings have a few kilobytes; parsers written in Python need a second for this.
MOST_SETTINGS_BYTES = 256 * 1024
# An hour of 75 columns at 100 Hz; as Python's text they take 2 GB.
MOST_VALUES = 30_000_000
# Largest unpacked size: a constant (a few megabytes compress to nearly nothing) plus twelve times the packed size.
_UNPACKED_BYTES, _UNPACKED_PER_BYTE = 250 * MEGABYTE, 12
_IS_BLANK = np.isin(np.arange(256), list(b" \r\n"))


def is_there(path: Path) -> bool:
    """Whether a path exists and is not a folder; False for invalid names."""
    try:
        return path.exists() and not path.is_dir()
    except (OSError, ValueError):
        return False


def check_file(path: Path, most_bytes: int | None = None, found: os.stat_result | None = None) -> int:
    """Check type and size of a file before reading: reading a pipe would not terminate.

    Args:
        path: The file.
        most_bytes: Maximum size; None for any.
        found: Facts about the file if it is open; default: by its path.

    Returns:
        Its size, bytes.

    Raises:
        OSError: If there is no such file, or it is rejected; `strerror` has the reason.
    """
    found = found or path.stat()
    if not stat.S_ISREG(found.st_mode):
        kind = "a folder" if stat.S_ISDIR(found.st_mode) else "a pipe, a socket or a device"
        raise OSError(errno.EINVAL, f"this is {kind}, not a regular file", str(path))
    if most_bytes is not None and found.st_size > most_bytes:
        raise _too_large(path, most_bytes, f"it has {_size(found.st_size)}; ")
    return found.st_size


def read_limited(path: Path, most_bytes: int) -> bytes:
    """Read a regular file of bounded size.

    Args:
        path: The file.
        most_bytes: Maximum size.

    Returns:
        Its bytes.

    Raises:
        OSError: If it cannot be read, is not a regular file or is too large; `strerror` has the reason.
    """
    # Without O_NONBLOCK, opening a pipe waits for a writer.
    opened = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    with os.fdopen(opened, "rb") as file:
        check_file(path, most_bytes, os.fstat(file.fileno()))
        data = file.read(most_bytes + 1)
    if len(data) > most_bytes:  # such as files of the system, whose stated size is 0
        raise _too_large(path, most_bytes)
    return data


def check_unpacked(unpacked_bytes: int, size_bytes: int) -> None:
    """Reject a packed file with an implausible unpacked size, before unpacking.

    Args:
        unpacked_bytes: Unpacked size.
        size_bytes: Size of the file.

    Raises:
        OSError: If the unpacked size is far larger than the file.
    """
    most_bytes = _UNPACKED_BYTES + _UNPACKED_PER_BYTE * size_bytes
    if unpacked_bytes > most_bytes:
        problem = f"its content is implausibly large for its size: {_size(unpacked_bytes)} unpacked"
        raise OSError(errno.ENOMEM, f"{problem}, {_size(most_bytes)} accepted")


def check_values(data: bytes) -> None:
    """Reject text with too many values, before splitting: each takes some 60 bytes of memory.

    Args:
        data: Text whose values are separated by blanks, commas, semicolons or tabs.

    Raises:
        OSError: If there are more than `MOST_VALUES`.
    """
    blank = _IS_BLANK[np.frombuffer(data, dtype=np.uint8)]
    # A run of blanks is one separator.
    count = sum(map(data.count, (b",", b";", b"\t"))) + int((blank[1:] & ~blank[:-1]).sum())
    if count > MOST_VALUES:
        raise OSError(errno.EFBIG, f"it has {count} values; at most {MOST_VALUES} are accepted")


def read_text(path: Path, format_name: str) -> str:
    """Read a UTF-8 text file.

    Args:
        path: File to read.
        format_name: Expected format, for the message (``a CSV table``).

    Returns:
        Its text without a byte order mark.

    Raises:
        RecordingError: If it cannot be opened, is empty, is not UTF-8 or contains zero bytes.
    """
    return decode(path, read_bytes(path), format_name)


def read_bytes(path: Path) -> bytes:
    """Read a text file of bounded size.

    Args:
        path: File to read.

    Returns:
        Its bytes.

    Raises:
        RecordingError: If it cannot be opened, or has too many bytes or values.
    """
    try:
        data = read_limited(path, MOST_TEXT_BYTES)
        check_values(data)
    except OSError as error:
        raise RecordingError(path, "", f"cannot be read: {error.strerror or error}", "a readable file") from None
    return data


def decode(path: Path, data: bytes, format_name: str) -> str:
    """Decode UTF-8 text.

    Args:
        path: Origin of the bytes, for messages.
        data: Its bytes.
        format_name: Expected format, for the message.

    Returns:
        Its text without a byte order mark.

    Raises:
        RecordingError: If it is not UTF-8, is blank or contains zero bytes.
    """
    expected = f"{format_name} as UTF-8 text"
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line, problem = data.count(b"\n", 0, error.start) + 1, f"byte {data[error.start]:#04x} is not UTF-8 text"
        raise RecordingError(path, f"line {line}", problem, expected) from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise RecordingError(path, f"line {line}", "a zero byte, as in binary files", expected)
    if not text.strip():
        raise RecordingError(path, "", "the file is empty", expected)
    return text


def _too_large(path: Path, most_bytes: int, has: str = "") -> OSError:
    return OSError(errno.EFBIG, f"the file is too large: {has}at most {_size(most_bytes)} are accepted", str(path))


def _size(count_bytes: int) -> str:
    return f"{count_bytes / MEGABYTE:.0f} MB" if count_bytes >= MEGABYTE else f"{count_bytes / 1024:.0f} kB"
