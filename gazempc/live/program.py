"""Start of a live run's program: signals are taken before anything is imported that takes long."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from gazempc.live.process import stopped_by_signals


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; a signal ends it in order, from the start on.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status, see `gazempc.live.command.main`.
    """
    stop = threading.Event()
    with stopped_by_signals(stop):
        from gazempc.live.command import main as run  # noqa: PLC0415

        return run(arguments, stop)
