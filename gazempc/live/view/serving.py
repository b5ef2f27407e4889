"""The process for viewers: it takes the moments of a run, writes MCAP files of them, and serves them."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from functools import partial
from multiprocessing.connection import Connection
from typing import Protocol

from gazempc.errors import GazempcError, SettingsError
from gazempc.live.process import second_to_the_run
from gazempc.live.view.orders import LOOPBACK, Ended, ViewFailed, ViewOrders, ViewReady
from gazempc.parts import said
from gazempc.results.log import NEEDS_VIEW
from gazempc.results.moments import Moment


class _Taker(Protocol):
    def take(self, moment: Moment, /) -> object: ...

    def close(self) -> None: ...


def serve(orders: ViewOrders, parent: Connection) -> None:
    """Work until the run is over, or its process is gone.

    Args:
        orders: What to do.
        parent: Gives moments, and takes problems.
    """
    second_to_the_run()
    lines: list[str] = []
    try:
        takers = [make(orders, lines) for make in _wanted(orders)]
    except (GazempcError, OSError) as error:
        parent.send(ViewFailed(str(error)))
        return
    if orders.view is not None and orders.host not in LOOPBACK:
        lines.append(f"view: WARNING this run is visible in the whole network (--view-at {orders.host})")
    try:
        parent.send(ViewReady(tuple(lines)))
        _work(takers, parent)
    except (EOFError, OSError):
        pass  # the parent has ended
    for taker in takers:
        _survived(taker.close, parent)


def _wanted(orders: ViewOrders) -> list[Callable[[ViewOrders, list[str]], _Taker]]:
    wanted: list[Callable[[ViewOrders, list[str]], _Taker]] = []
    if orders.mcap_folder is not None:
        wanted.append(_files)
    if orders.view is not None:
        wanted.append(_foxglove if orders.view == "foxglove" else _web)
    return wanted


def _files(orders: ViewOrders, _: list[str]) -> _Taker:
    try:
        from gazempc.live.view.foxglove import McapFiles  # noqa: PLC0415  (optional packages)
    except ImportError:
        raise SettingsError(NEEDS_VIEW) from None
    assert orders.mcap_folder is not None
    return McapFiles(orders.run, orders.mcap_folder)


def _foxglove(orders: ViewOrders, lines: list[str]) -> _Taker:
    try:
        from gazempc.live.view.foxglove import FoxgloveServer, write_layout  # noqa: PLC0415  (optional packages)
    except ImportError:
        raise SettingsError('--view needs more packages: pip install -e ".[view]"; --view web needs none') from None
    server = FoxgloveServer(orders.run, orders.host, orders.port)
    said_layout = ""
    if orders.layout is not None:
        write_layout(orders.layout, orders.run.neck, orders.pictures)
        said_layout = f", with the layout {orders.layout}"
    lines.append(f"view: open {server.url} in Foxglove{said_layout}")
    return server


def _web(orders: ViewOrders, lines: list[str]) -> _Taker:
    from gazempc.live.view.web import WebPage  # noqa: PLC0415  (only where it is wanted)

    page = WebPage(orders.run, orders.host, orders.port)
    lines.append(f"view: open {page.url} in a browser")
    return page


def _work(takers: list[_Taker], parent: Connection) -> None:
    while True:
        for moment in pickle.loads(parent.recv_bytes()):
            if isinstance(moment, Ended):
                return
            for taker in list(takers):
                if not _survived(partial(taker.take, moment), parent):
                    takers.remove(taker)


def _survived(do: Callable[[], object], parent: Connection) -> bool:
    """Whether it succeeded; else the run gets the problem, and goes on."""
    try:
        do()
    except Exception as error:
        why = str(error) if isinstance(error, GazempcError) else said(error)
        parent.send(ViewFailed(f"viewers: {why}"))
        return False
    return True
