"""Trivial jobs, and a command that runs them, for tests of the engine."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.engine.engine import Engine
from experiments.engine.job import Row, key_of
from gazempc.command import run_interruptible
from gazempc.errors import GazempcError, LeftOutError


@dataclass(frozen=True)
class Tiny:
    """Squares a number, or performs the action `does`.

    Attributes:
        number: The number to square.
        does: ``square``, ``array``, ``sleep`` (until it is killed or a file says that all is over),
            ``leave out``, ``fail``, ``bug``, ``die``, or ``die once`` (the first of all that write to the log).
        log: File that gets a line for each job done.
    """

    number: int
    does: str = "square"
    log: str | None = None

    def key(self) -> str:
        """Everything but the log."""
        return key_of(self, log="")

    def run(self) -> Row:
        """See `Tiny`."""
        first = False
        if self.log is not None:
            with Path(self.log).open("a") as file:
                file.write(f"{self.number} {os.getpid()}\n")
            # Not by the line count: two concurrent writers would both read two.
            with contextlib.suppress(FileExistsError):
                Path(f"{self.log}.first").touch(exist_ok=False)
                first = True
        if self.does == "die" or (self.does == "die once" and first):
            os.kill(os.getpid(), signal.SIGKILL)
        if self.does == "sleep":
            until_s = time.monotonic() + 60.0
            while time.monotonic() < until_s and not Path(f"{self.log}.over").exists():
                time.sleep(0.02)
        elif self.does == "leave out":
            raise LeftOutError("too near")
        elif self.does == "fail":
            raise GazempcError("no such walk")
        elif self.does == "bug":
            raise TypeError("a bug")
        row: Row = {"square": self.number**2, "third": self.number / 3, "pid": os.getpid()}
        return row | ({"array": np.full((2, self.number), 0.1)} if self.does == "array" else {})


def main(folder: str, log: str, finished: int, unfinished: int, *more: str) -> int:
    """Do `finished` squares and `unfinished` endless jobs with two workers."""

    def work() -> int:
        dask = more[0] if more else None
        with Engine(Path(folder), jobs=2, dask=dask, total=finished + unfinished) as engine:
            rows = engine.run([Tiny(n) for n in range(finished)])
            rows += engine.run([Tiny(n, "sleep", log) for n in range(unfinished)])
        print(f"{len(rows)} rows")
        return 0

    return run_interruptible("tiny", work)


if __name__ == "__main__":
    import tiny_jobs  # workers import the jobs by module name

    sys.exit(tiny_jobs.main(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]), *sys.argv[5:]))
