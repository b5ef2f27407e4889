"""Warnings of a run, written by a thread of their own: whoever reads them slowly holds up nobody."""

from __future__ import annotations

import contextlib
import logging
import queue
from collections.abc import Iterator
from contextlib import contextmanager
from logging.handlers import QueueHandler, QueueListener

# Each kind is said once; of what else comes the newest are kept.
_WAITING_MAX = 100
_LOGGERS = ("gazempc.live", "gazempc.loop")


class _Aside(QueueHandler):
    """Hands records over as they are, so that the thread of the run does not even format them."""

    def __init__(self, waiting: queue.Queue[logging.LogRecord]) -> None:
        super().__init__(waiting)
        self._waiting = waiting

    def prepare(self, record: logging.LogRecord) -> logging.LogRecord:
        return record

    def enqueue(self, record: logging.LogRecord) -> None:
        while True:
            try:
                return self._waiting.put_nowait(record)
            except queue.Full:
                with contextlib.suppress(queue.Empty):
                    self._waiting.get_nowait()


@contextmanager
def said_aside() -> Iterator[None]:
    """What looks wrong is said at once on standard error, not only at the end."""
    written = logging.StreamHandler()
    written.setFormatter(logging.Formatter("gazempc.live: WARNING %(message)s"))
    waiting: queue.Queue[logging.LogRecord] = queue.Queue(_WAITING_MAX)
    listener, aside = QueueListener(waiting, written), _Aside(waiting)
    listener.start()
    loggers = [logging.getLogger(name) for name in _LOGGERS]
    for logger in loggers:
        logger.addHandler(aside)
    try:
        yield
    finally:
        for logger in loggers:
            logger.removeHandler(aside)
        listener.stop()
