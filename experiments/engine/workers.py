"""Who does the jobs: processes of this machine, or a cluster."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from experiments.engine.job import Job, Row

# Gives the result of a job that has ended, or raises what ended it.
Outcome = Callable[[], Row]


class Workers(Protocol):
    """Workers take jobs and tell what came of each.

    Attributes:
        at_once: So many jobs they may have at once, begun or waiting.
    """

    at_once: int

    def submit(self, key: str, job: Job, ended: Callable[[str, Outcome], None]) -> None:
        """Give a job to the workers.

        Args:
            key: Its key.
            job: The job.
            ended: Is told key and outcome when the job has ended; in any thread.
        """
        ...

    def stop(self) -> None:
        """End the workers, in the middle of a job too."""
        ...
