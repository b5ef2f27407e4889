"""What a job is, and how a worker does one."""

from __future__ import annotations

import traceback
from pathlib import Path
from typing import Any, Protocol

from experiments.engine.keys import program_hash
from gazempc.errors import GazempcError, LeftOutError
from gazempc.parts import said

# What came of a job, by name: plain data as JSON knows it, or numpy arrays. `failed` and `left_out` are always there:
# the reason, or None.
Row = dict[str, Any]


class Job(Protocol):
    """A job: frozen plain data that can be sent to another process or machine."""

    def key(self) -> str:
        """Name of its result: a hash of all that the result depends on, see `experiments.engine.keys.key_of`."""
        ...

    def run(self) -> Row:
        """Do it, in a worker.

        Returns:
            The result; an entry ``left_out`` gives the reason why there is none.

        Raises:
            LeftOutError: If the experiment cannot be made with this recording.
            GazempcError: If it cannot be done.
        """
        ...


def carry_out(job: Job, key: str, program: str) -> Row:
    """Do a job in a worker; never raises.

    Args:
        job: The job.
        key: Its key where it was made; another one here means that something else would be computed.
        program: `program_hash` where it was made.

    Returns:
        What `job.run` gives, with ``left_out`` and ``failed``.
    """
    try:
        if (here := program_hash()) != program:
            return _failed(f"the worker's program ({here}) is not the one that asks ({program})")
        if job.key() != key:
            return _failed("the worker does not find the same files: one has changed since the start, or is not there")
        return {"left_out": None, "failed": None, **job.run()}
    except LeftOutError as error:
        return {"left_out": str(error), "failed": None}
    except GazempcError as error:
        return _failed(str(error))
    except (Exception, SystemExit) as error:  # a bug, a lack of memory or an exit in one job must not end the others
        last = traceback.extract_tb(error.__traceback__)[-1]
        return _failed(f"{said(error)} ({Path(last.filename).name}, line {last.lineno})")


def _failed(reason: str) -> Row:
    return {"left_out": None, "failed": reason}
