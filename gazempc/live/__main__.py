"""Entry point of `python -m gazempc.live`: installs signal handlers before slow imports."""

from __future__ import annotations

import sys
import threading
from collections.abc import Sequence

from gazempc.live.process import stopped_by_signals


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; with graceful shutdown on signals, also during imports.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status, see `gazempc.live.session.main`.
    """
    stop = threading.Event()
    with stopped_by_signals(stop):
        from gazempc.live.session import main as run  # noqa: PLC0415

        return run(arguments, stop)


if __name__ == "__main__":
    sys.exit(main())
