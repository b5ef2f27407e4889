"""The process for viewers: receives the moments of a run, writes MCAP files, and serves viewers."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Protocol

from gazempc.errors import GazempcError, SettingsError
from gazempc.live.sources.wires import is_loopback
from gazempc.parts import error_line
from gazempc.results.log import RunInfo
from gazempc.results.log_files import NEEDS_VIEW
from gazempc.results.moments import Moment


@dataclass(frozen=True)
class ViewOrders:
    """Tasks of the process for viewers.

    Attributes:
        run: Description of the run.
        mcap_folder: Folder of MCAP files; None for none.
        view: Kind of viewer, ``web`` or ``foxglove``; None for none.
        host: Address of the server.
        port: Its port; 0 for any free one.
        layout: Path of the layout file for Foxglove.
        pictures: Whether the moments include pictures of a camera.
    """

    run: RunInfo
    mcap_folder: Path | None = None
    view: str | None = None
    host: str = "127.0.0.1"
    port: int = 0
    layout: Path | None = None
    pictures: bool = False


class _Taker(Protocol):
    def take(self, moment: Moment, /) -> object: ...

    def close(self) -> None: ...


def serve(parent: Connection, orders: ViewOrders) -> None:
    """Work until the end of the run, or of its process.

    Args:
        orders: Tasks of the process.
        parent: Sends lists of moments, an empty one at the end. Receives a tuple of lines for the user when ready, and
            a text for each problem.
    """
    lines: list[str] = []
    try:
        takers = _takers(orders, lines)
    except (GazempcError, OSError) as error:
        parent.send(str(error))
        return
    with suppress(EOFError, OSError):  # the parent has ended
        parent.send(tuple(lines))
        while moments := parent.recv():
            for moment in moments:
                takers = [taker for taker in takers if _survived(partial(taker.take, moment), parent)]
    for taker in takers:
        _survived(taker.close, parent)


def _takers(orders: ViewOrders, lines: list[str]) -> list[_Taker]:
    """Receivers of the moments; lines for the user are appended."""
    takers: list[_Taker] = []
    if orders.mcap_folder is not None or orders.view == "foxglove":
        try:
            # Optional packages.
            from gazempc.live.view.foxglove import FoxgloveServer, McapFiles, write_layout  # noqa: PLC0415
        except ImportError:
            raise SettingsError(f"{NEEDS_VIEW}; --view web needs none") from None
        if orders.mcap_folder is not None:
            takers.append(McapFiles(orders.run, orders.mcap_folder))
        if orders.view == "foxglove":
            server = FoxgloveServer(orders.run, orders.host, orders.port)
            takers.append(server)
            if orders.layout is not None:
                write_layout(orders.layout, orders.run.neck, orders.pictures)
            lines.append(f"view: open {server.url} in Foxglove, with the layout {orders.layout}")
    if orders.view == "web":
        from gazempc.live.view.web import WebPage  # noqa: PLC0415  (optional)

        page = WebPage(orders.run, orders.host, orders.port)
        takers.append(page)
        lines.append(f"view: open {page.url} in a browser")
    if orders.view is not None and not is_loopback(orders.host):
        lines.append(f"view: WARNING this run is visible in the whole network (--view-at {orders.host})")
    return takers


def _survived(do: Callable[[], object], parent: Connection) -> bool:
    """Whether the call succeeded; else the problem is sent to the run, which continues."""
    try:
        do()
    except Exception as error:
        parent.send(f"viewers: {error if isinstance(error, GazempcError) else error_line(error)}")
        return False
    return True
