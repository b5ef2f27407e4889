"""Pictures inside a page, as far as there is room."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

# Mail programs take a page of this size; the text has its share of it.
MAX_PAGE_BYTES = 3_000_000
_TYPES = {".png": "image/png", ".gif": "image/gif"}


@dataclass(frozen=True)
class Embedded:
    """A picture for a page.

    Attributes:
        name: Name of its file.
        uri: The picture itself, as a data URI; empty where there was no room.
        width: Pixels.
        height: Pixels.
    """

    name: str
    uri: str
    width: int
    height: int

    @property
    def moves(self) -> bool:
        """Whether it is an animation."""
        return self.name.endswith(".gif")


def embed(paths: Iterable[Path], room_bytes: int) -> list[Embedded]:
    """Read pictures, the first ones first, as long as there is room.

    Args:
        paths: PNG and GIF files.
        room_bytes: For all of them, encoded.

    Returns:
        The pictures in the same order. Where the files are too large together, PNG files are taken in 256 colours.
    """
    pictures = {path: path.read_bytes() for path in paths}
    if sum(map(_encoded_bytes, pictures.values())) > room_bytes:
        pictures = {path: _smaller(data) if path.suffix == ".png" else data for path, data in pictures.items()}
    found = []
    for path, data in pictures.items():
        with Image.open(io.BytesIO(data)) as image:
            width, height = image.size
        fits = _encoded_bytes(data) <= room_bytes
        room_bytes -= _encoded_bytes(data) if fits else 0
        uri = f"data:{_TYPES[path.suffix]};base64,{base64.b64encode(data).decode()}" if fits else ""
        found.append(Embedded(path.name, uri, width, height))
    return found


def _encoded_bytes(data: bytes) -> int:
    return 4 * (len(data) + 2) // 3


def _smaller(png: bytes) -> bytes:
    out = io.BytesIO()
    with Image.open(io.BytesIO(png)) as image:
        image.convert("RGB").quantize(256).save(out, "PNG", optimize=True)
    return min(png, out.getvalue(), key=len)
