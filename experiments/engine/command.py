"""What all commands over many recordings share: their common settings, exit status and messages."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from experiments.engine.signals import Interrupted, ending_on_signals
from gazempc.errors import GazempcError

_BAD_INPUT = 2


class WorkSettings(BaseModel):
    """Who does the jobs of a command, and where the results are kept."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    jobs: int = Field(default=os.cpu_count() or 1, ge=1, description="Worker processes on this machine")
    dask: str | None = Field(
        default=None, description="Scheduler of a dask.distributed cluster that does the jobs, such as tcp://host:8786"
    )
    out: Path = Field(default=Path("out"), description="Where to write; an interrupted command goes on there")


# The same results come of any number of workers, in any place.
NOT_SAVED = frozenset(WorkSettings.model_fields)


def run_command(name: str, work: Callable[[], int]) -> int:
    """Do the work of a command, and turn what a user can cause into a message and an exit status.

    Args:
        name: The command's name, for messages.
        work: Does it, and gives the exit status.

    Returns:
        What `work` gives; 2 on bad input or a file system that refuses; 130 after Ctrl-C, 143 after SIGTERM.
    """
    try:
        with ending_on_signals():
            return work()
    except (GazempcError, OSError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return _BAD_INPUT
    except Interrupted as stop:
        what = "".join(f": {note}" for note in getattr(stop, "__notes__", ()))
        print(f"{name}: interrupted{what}; run the same command again to go on", file=sys.stderr)
        return 128 + stop.signum


def throughput(simulated_s: float, wall_s: float, settings: WorkSettings) -> str:
    """A line on how fast replays were done; empty if none was.

    Args:
        simulated_s: Their length, seconds.
        wall_s: How long they took, seconds.
        settings: Who did them.
    """
    if not simulated_s:
        return ""
    rate = simulated_s / wall_s
    each = "" if settings.dask else f", {rate / settings.jobs:.1f} a second and worker"
    return f"{simulated_s:.0f} simulated seconds in {wall_s:.0f} s: {rate:.1f} a second{each}\n"
