"""The process for viewers, as the run sees it."""

from __future__ import annotations

import multiprocessing
import pickle
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess

from gazempc.errors import SettingsError
from gazempc.live.view.orders import Ended, ViewFailed, ViewOrders, ViewReady
from gazempc.live.view.process import serve

# It imports what it needs, which takes a while on a busy computer.
_READY_WITHIN_S = 60.0
_ENDS_WITHIN_S = 20.0


class ViewProcess:
    """Starts the process, sends it what happens, and ends it.

    Args:
        orders: What it does.

    Attributes:
        problem: Why something of it does not go on; empty while all is well.
    """

    def __init__(self, orders: ViewOrders) -> None:
        self._orders = orders
        self._process: SpawnProcess | None = None
        self._pipe: Connection | None = None
        self.problem = ""

    def start(self) -> tuple[str, ...]:
        """Start it, and wait until it is ready.

        Returns:
            What the user is told.

        Raises:
            SettingsError: If it cannot do what it is told to.
        """
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(self._orders, theirs), name="view", daemon=True)
        self._process.start()
        theirs.close()
        answer: object = None
        try:
            if self._pipe.poll(_READY_WITHIN_S):
                answer = self._pipe.recv()
        except (EOFError, OSError):
            pass
        if isinstance(answer, ViewReady):
            return answer.said
        self._process.kill()
        self._process.join()
        raise SettingsError(answer.why if isinstance(answer, ViewFailed) else "the process for viewers did not start")

    def send(self, batch: list[object]) -> None:
        """Send it something; what cannot be sent any more is left out, and `problem` says why.

        Args:
            batch: Moments and orders.
        """
        if self._pipe is None or self._process is None:
            return
        try:
            self._pipe.send_bytes(pickle.dumps(batch, protocol=pickle.HIGHEST_PROTOCOL))
        except OSError:
            self._hear()
            self.problem = self.problem or "the process for viewers has gone"

    def close(self) -> None:
        """Wait until it has finished its files, and end it."""
        if self._process is None:
            return
        self.send([Ended()])
        self._process.join(_ENDS_WITHIN_S)
        self._hear()
        if self._process.is_alive():
            self.problem = self.problem or "the process for viewers did not end: its files may not be complete"
            self._process.kill()
            self._process.join()

    def _hear(self) -> None:
        try:
            while self._pipe is not None and self._pipe.poll():
                answer = self._pipe.recv()
                if isinstance(answer, ViewFailed):
                    self.problem = self.problem or answer.why
        except (EOFError, OSError):
            return
