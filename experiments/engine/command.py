"""What all commands over many recordings do around their work: exit status and messages."""

from __future__ import annotations

import sys
from collections.abc import Callable

from gazempc.errors import GazempcError

_BAD_INPUT = 2
_INTERRUPTED = 130


def run_command(name: str, work: Callable[[], int]) -> int:
    """Do the work of a command, and turn what a user can cause into a message and an exit status.

    Args:
        name: The command's name, for messages.
        work: Does it, and gives the exit status.

    Returns:
        What `work` gives; 2 on bad input or a file system that refuses; 130 if interrupted.
    """
    try:
        return work()
    except (GazempcError, OSError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return _BAD_INPUT
    except KeyboardInterrupt:
        print(f"{name}: interrupted; run the same command again to go on", file=sys.stderr)
        return _INTERRUPTED
