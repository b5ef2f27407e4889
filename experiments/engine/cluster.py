"""Workers of a dask.distributed cluster."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from functools import partial
from typing import Any

from experiments.engine.job import Job, Row, carry_out
from experiments.engine.keys import program_hash
from experiments.engine.workers import Outcome
from gazempc.errors import GazempcError, MissingOptionalDependencyError

_ANSWER_WITHIN_S = 10
_LEAVE_WITHIN_S = 1
# Another worker does the job of one that died; a job that ends three workers is given up.
_RETRIES = 2
# Controllers and solvers are not made for threads, of which a worker may have several.
_ONE_AT_A_TIME = threading.Lock()


class ClusterWorkers:
    """Workers that have this package and see the recordings under the same paths; this process alone writes results.

    Args:
        address: Of the scheduler, such as ``tcp://10.0.0.1:8786``.

    Attributes:
        at_once: See `Workers`; the scheduler takes them all.

    Raises:
        MissingOptionalDependencyError: Without dask.distributed.
        GazempcError: If no scheduler answers there.
    """

    def __init__(self, address: str) -> None:
        try:
            import distributed  # noqa: PLC0415
        except ImportError:
            raise MissingOptionalDependencyError("--dask", "distributed", "cluster") from None
        try:
            self._client: Any = distributed.Client(  # type: ignore[no-untyped-call]
                address, timeout=_ANSWER_WITHIN_S
            )
        except (OSError, ValueError) as error:
            raise GazempcError(f"--dask {address}: no scheduler answers there: {error}") from None
        self.at_once = sys.maxsize
        self._futures: dict[str, Any] = {}

    def submit(self, key: str, job: Job, ended: Callable[[str, Outcome], None]) -> None:
        """See `Workers`; whatever a worker or the scheduler says is the reason of a failed job."""
        # The name says what is computed: the scheduler holds one task for it, however often it is asked.
        future = self._client.submit(
            _carry_out_alone, job, key, program_hash(), key=f"gazempc-{key}", pure=True, retries=_RETRIES
        )
        self._futures[key] = future
        future.add_done_callback(lambda _: ended(key, partial(self._outcome, key)))

    def stop(self) -> None:
        """See `Workers`; a job that a worker has begun ends there, unheard."""
        self._client.cancel(list(self._futures.values()))
        self._client.close(timeout=_LEAVE_WITHIN_S)

    def _outcome(self, key: str) -> Row:
        try:
            row: Row = self._futures.pop(key).result()
        except Exception as error:  # of the cluster: jobs themselves do not raise
            return {"left_out": None, "failed": f"{type(error).__name__}: {error}"}
        return row


def _carry_out_alone(job: Job, key: str, program: str) -> Row:
    with _ONE_AT_A_TIME:
        return carry_out(job, key, program)
