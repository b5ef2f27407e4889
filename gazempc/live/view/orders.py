"""Tasks of the process for viewers."""

from __future__ import annotations

import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

from gazempc.results.log import RunInfo

ViewKind = Literal["foxglove", "web"]
# Default port of Foxglove, and an unprivileged one for pages.
PORTS: dict[ViewKind, int] = {"foxglove": 8765, "web": 8080}
LOOPBACK = ("127.0.0.1", "localhost")


def named(host: str) -> str:
    """Host name of this computer for a server at all its addresses; else the address itself."""
    return socket.gethostname() if host == "0.0.0.0" else host


@dataclass(frozen=True)
class ViewOrders:
    """Tasks of the process for viewers.

    Attributes:
        run: Description of the run.
        mcap_folder: Folder of MCAP files; None for none.
        view: Kind of viewer; None for none.
        host: Address of the server.
        port: Its port; 0 for any free one.
        layout: Path of the layout file for Foxglove.
        pictures: Whether the moments include pictures of a camera.
    """

    run: RunInfo
    mcap_folder: Path | None = None
    view: ViewKind | None = None
    host: str = "127.0.0.1"
    port: int = 0
    layout: Path | None = None
    pictures: bool = False


class LogKept(NamedTuple):
    """A complete log on disk.

    Attributes:
        path: The ``.npz`` file; the MCAP file beside it has its name.
        lost: Number of its moments lost before the process for viewers.
    """

    path: Path
    lost: int
