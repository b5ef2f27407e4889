"""Ctrl-C and SIGTERM: the first ends a command gracefully, the second at once."""

from __future__ import annotations

import _thread
import importlib
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

# A command ends within 3 s of Ctrl-C; half a second is left for the end of the interpreter.
_GRACE_S = 2.5
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupted(KeyboardInterrupt):
    """A signal requests the end of the command.

    Attributes:
        signum: Number of the signal; a shell expects the exit status 128 + signum.
    """

    def __init__(self, signum: int) -> None:
        super().__init__(f"signal {signum}")
        self.signum = signum


class _State:
    """State of the signal handlers, of which a process has one set."""

    received: int | None = None
    pending = False
    deferring = 0
    grace_s = 0.0


def end_during_imports(name: str) -> None:
    """Let SIGINT and SIGTERM end a command during its imports, which take a second or two.

    Args:
        name: The command's name, for the message.
    """

    def end(signum: int, _: FrameType | None) -> None:
        os.write(2, f"{name}: interrupted during start-up\n".encode())
        os._exit(128 + signum)

    for signum in _SIGNALS:
        signal.signal(signum, end)


def start(name: str, module: str) -> NoReturn:
    """Run the ``main`` of a command's module; see `end_during_imports`."""
    end_during_imports(name)
    sys.exit(importlib.import_module(module).main())


@contextmanager
def ending_on_signals(grace_s: float | None = None) -> Iterator[None]:
    """Let SIGINT and SIGTERM raise `Interrupted` in this context; a second signal ends the process at once.

    A process that still runs some time after the first signal is ended, too, so that no library can block it: for
    command lines only. Without effect outside the main thread, as Python delivers signals there alone.

    Args:
        grace_s: That time, seconds; default: 2.5.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _State.received, _State.pending, _State.grace_s = None, False, _GRACE_S if grace_s is None else grace_s
    before = {signum: signal.signal(signum, _receive) for signum in _SIGNALS}
    try:
        yield
    finally:
        if _State.received is None:  # else shutdown is in progress, and a second signal ends it
            for signum, handler in before.items():
                signal.signal(signum, handler)


@contextmanager
def deferred() -> Iterator[None]:
    """Defer `Interrupted` until `raise_if_received` or the end of this context: no signal interrupts a step."""
    _State.deferring += 1
    try:
        yield
    finally:
        _State.deferring -= 1
    raise_if_received()


def raise_if_received() -> None:
    """Raise `Interrupted` if a signal was deferred."""
    if _State.pending and _State.received is not None:
        _State.pending = False
        raise Interrupted(_State.received)


@contextmanager
def kept_from_children() -> Iterator[None]:
    """Block both signals in child processes started in this context: Ctrl-C reaches all processes of a terminal."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_after(grace_s: float, status: int) -> None:
    time.sleep(grace_s)
    os._exit(status)


def _receive(signum: int, _: FrameType | None) -> None:
    if _State.received is not None:
        os._exit(128 + signum)
    _State.received = signum
    # No `threading.Timer`: its start takes a lock that the interrupted code may hold.
    _thread.start_new_thread(_end_after, (_State.grace_s, 128 + signum))
    _State.pending = bool(_State.deferring)
    if not _State.pending:
        raise Interrupted(signum)
