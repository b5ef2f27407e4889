"""Reading of text files: every failure to open or decode one is a `RecordingError`."""

from __future__ import annotations

from pathlib import Path

from gazempc.errors import RecordingError
from gazempc.files.bounds import MOST_TEXT_BYTES, check_values, read_limited


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
