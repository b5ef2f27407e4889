"""Files of numpy arrays (``.npz``) from untrusted sources: no pickles, sizes checked before unpacking."""

from __future__ import annotations

import io
import math
import zipfile
from pathlib import Path
from typing import Any

from numpy.lib import format as npy

from gazempc.errors import shown
from gazempc.files.bounds import MEGABYTE, check_unpacked, read_limited

# Ten times the size of a log of an hour.
_MOST_BYTES = 500 * MEGABYTE
_MOST_ARRAYS = 200
_KINDS = "biufU"


def read_npz(file: Path | bytes, most_bytes: int = _MOST_BYTES) -> dict[str, Any]:
    """Read all arrays of a file.

    Args:
        file: Its path, or its bytes.
        most_bytes: Maximum size of a file that is given by its path.

    Returns:
        Arrays by name.

    Raises:
        OSError: If it cannot be read, or its content is far larger than the file.
        ValueError: If it is not such a file, is damaged or encrypted, or has arrays of other types than numbers and
            text.
    """
    data = file if isinstance(file, bytes) else read_limited(file, most_bytes)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            _check_members(archive, len(data))
            arrays = {}
            for member in archive.infolist():
                with archive.open(member) as content:
                    arrays[member.filename.removesuffix(".npy")] = npy.read_array(content, allow_pickle=False)
            return arrays
    except (OSError, ValueError):
        raise
    except Exception as error:  # a damaged archive makes the libraries raise errors of many unrelated classes
        raise ValueError(f"a damaged archive ({type(error).__name__}: {shown(str(error), 100)})") from None


def _check_members(archive: zipfile.ZipFile, size_bytes: int) -> None:
    """Reject too many arrays, and an array that disagrees with its header, before unpacking; names the array."""
    members = archive.infolist()
    if len(members) > _MOST_ARRAYS:
        raise ValueError(f"{len(members)} arrays; at most {_MOST_ARRAYS} are accepted")
    check_unpacked(sum(member.file_size for member in members), size_bytes)
    for member in members:
        name = shown(member.filename, 80)
        if member.flag_bits & 1:
            raise ValueError(f"{name} is encrypted")
        with archive.open(member) as file:
            version = npy.read_magic(file)
            read_header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
            shape, _, kind = read_header(file)
            header_bytes = file.tell()
        if kind.kind not in _KINDS or kind.hasobject:
            raise ValueError(f"{name} is of type {kind!s:.80}; accepted: numbers and text")
        if header_bytes + math.prod(shape) * kind.itemsize != member.file_size:
            raise ValueError(f"{name} has {member.file_size} bytes, which disagrees with its shape")
