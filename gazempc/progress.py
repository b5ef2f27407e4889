"""Progress of a job on standard error."""

from __future__ import annotations

import sys
import time

_SILENCE_S = 2.0


class Progress:
    """Reports the present work on standard error once a job has been silent for two seconds."""

    def __init__(self) -> None:
        self._started_s = self._reported_s = time.monotonic()
        self._what = ""
        self._shown = False

    def at(self, share: float) -> None:
        """Report the share of the present work that is done, every few seconds.

        Args:
            share: Done so far, 0 to 1.
        """
        now_s = time.monotonic()
        if now_s - self._reported_s > _SILENCE_S:
            self._reported_s, self._shown = now_s, True
            print(f"... {self._what}, {100 * share:.0f} %", file=sys.stderr, flush=True)

    def begin(self, what: str) -> None:
        """Begin a piece of work.

        Args:
            what: Its name, a few words.
        """
        self._what = what
        if self._shown or time.monotonic() - self._started_s > _SILENCE_S:
            self._shown = True
            print(f"... {what}", file=sys.stderr, flush=True)
