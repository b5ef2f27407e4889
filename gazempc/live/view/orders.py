"""Orders to the process for viewers."""

from __future__ import annotations

import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

from gazempc.results.log import RunInfo

ViewKind = Literal["foxglove", "web"]
# The port that Foxglove offers, and one for pages that needs no rights.
PORTS: dict[ViewKind, int] = {"foxglove": 8765, "web": 8080}
LOOPBACK = ("127.0.0.1", "localhost")


def named(host: str) -> str:
    """How others call this computer, where something is served at all its addresses; else the address itself."""
    return socket.gethostname() if host == "0.0.0.0" else host


@dataclass(frozen=True)
class ViewOrders:
    """What the process for viewers does.

    Attributes:
        run: What the run is.
        mcap_folder: Where MCAP files go; None for none.
        view: What is served; None for nothing.
        host: Address that it is served at.
        port: Its port; 0 for any that is free.
        layout: Where the layout file for Foxglove goes.
        pictures: Whether a camera's pictures are among the moments.
    """

    run: RunInfo
    mcap_folder: Path | None = None
    view: ViewKind | None = None
    host: str = "127.0.0.1"
    port: int = 0
    layout: Path | None = None
    pictures: bool = False


class LogKept(NamedTuple):
    """A log is complete, and on disk.

    Attributes:
        path: The ``.npz`` file; the MCAP file beside it has its name.
        lost: How many moments of it did not reach the process for viewers.
    """

    path: Path
    lost: int
