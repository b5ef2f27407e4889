"""The log that is attached to an MCAP file of `gazempc.results.mcap`."""

from __future__ import annotations

import io
from pathlib import Path

from gazempc.errors import SettingsError, shown
from gazempc.files.bounds import check_file

# The first bytes of every MCAP file.
MAGIC = b"\x89MCAP0\r\n"
ATTACHMENT = "log.npz"
# The names of attachments stand in the summary at a file's end.
_SUMMARY_BYTES = 2**20
NEEDS_VIEW = 'MCAP files need more packages: pip install -e ".[view]"'


def has_log(path: Path) -> bool:
    """Whether an MCAP file is a log of this package, and not a bag of ROS 2; needs no other package.

    Args:
        path: The file.

    Returns:
        True if an attachment of a log's name is in it; False, too, if there is no such file.
    """
    try:
        check_file(path)
        with path.open("rb") as file:
            size = file.seek(0, io.SEEK_END)
            file.seek(max(0, size - _SUMMARY_BYTES))
            return ATTACHMENT.encode() in file.read()
    except OSError:
        return False


def is_mcap(path: Path) -> bool:
    """Whether a file begins as MCAP files do.

    Args:
        path: The file.

    Returns:
        True if it does.

    Raises:
        OSError: If it cannot be read, or is no regular file.
    """
    check_file(path)
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def nanoseconds(time_s: float) -> int:
    """A time as MCAP files have it: whole nanoseconds, none before zero."""
    return max(0, round(1e9 * time_s))


def attached_log(path: Path) -> bytes:
    """The log in an MCAP file, as it was saved.

    Args:
        path: The file.

    Returns:
        Bytes of `gazempc.results.log.Log.save`.

    Raises:
        SettingsError: If a package is missing, the file cannot be read, or no log is in it.
    """
    try:
        from mcap.reader import make_reader  # noqa: PLC0415  (optional)
    except ImportError:
        raise SettingsError(NEEDS_VIEW) from None
    try:
        check_file(path)
        with path.open("rb") as file:
            found = [each.data for each in make_reader(file).iter_attachments() if each.name == ATTACHMENT]
    except Exception as error:  # a damaged file makes the library raise errors of many unrelated classes
        raise SettingsError(f"{path}: not an MCAP file that can be read: {shown(str(error), 200)}") from None
    if not found:
        raise SettingsError(f"{path}: no log of gazempc is in this MCAP file")
    return bytes(found[0])
