"""Common functions of all command lines: messages, exit statuses and progress."""

from __future__ import annotations

import io
import os
import shlex
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path

from tyro.conf import HelptextFromCommentsOff

from gazempc.errors import GazempcError, LimitViolationError
from gazempc.signals import Interrupted, ending_on_signals

# 1 means a limit violation only. Python's own status after an exception is 1, too, so all exceptions are caught.
VIOLATION, BAD_INPUT, UNEXPECTED, INCOMPLETE = 1, 2, 3, 4
# For `tyro.cli`: help texts are descriptions and docstrings. Parsing comments takes a quarter of a second.
TYRO_CONFIG = (HelptextFromCommentsOff,)
_SILENCE_S = 2.0


def run_command(name: str, work: Callable[[], int]) -> int:
    """Run a command; errors become a message and an exit status.

    Args:
        name: The command's name, for messages.
        work: Function of the command; returns the exit status.

    Returns:
        The status of `work`. 1: a limit violation. 2: bad input, or an error of the file system. 3: any other
        exception, a fault of the program. 0: also if the output is a closed pipe, as in ``... --list | head``.
    """
    _prepare_streams()
    try:
        status = work()
        sys.stdout.flush()
        return status
    except BrokenPipeError:
        # The reading process has ended.
        _discard_output()
        return 0
    except (GazempcError, OSError) as error:
        try:
            sys.stdout.flush()
        except OSError:  # such as a full disk, which Python's own flush at the end would report again
            _discard_output()
        print(f"{name}: {error}", file=sys.stderr)
        return VIOLATION if isinstance(error, LimitViolationError) else BAD_INPUT
    except Exception:
        traceback.print_exc()
        print(f"{name}: a fault of this program, not of your input: please report the lines above", file=sys.stderr)
        return UNEXPECTED


def run_interruptible(
    name: str, work: Callable[[], int], then: str = "run the same command again to resume", grace_s: float | None = None
) -> int:
    """`run_command` with a message and a status for signals.

    Args:
        name: The command's name, for messages.
        work: Function of the command; returns the exit status.
        then: Advice after an interruption, for the message.
        grace_s: Time from a signal to the forced end of the process, seconds; see `gazempc.signals.ending_on_signals`.

    Returns:
        The status of `run_command`; 130 after Ctrl-C, 143 after SIGTERM.
    """
    try:
        with ending_on_signals(grace_s):
            return run_command(name, work)
    except Interrupted as stop:
        what = "".join(f": {note}" for note in getattr(stop, "__notes__", ()))
        print("; ".join(filter(None, (f"{name}: interrupted{what}", then))), file=sys.stderr)
        return 128 + stop.signum


def _prepare_streams() -> None:
    """Replace closed standard streams, and characters that their encoding lacks."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, Path(os.devnull).open(mode))  # noqa: SIM115  (open to the end of the process)
        elif mode == "w" and isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _discard_output() -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def command_line(module: str, words: Sequence[str]) -> str:
    """A command line, quoted for a shell.

    Args:
        module: Module that Python runs.
        words: Arguments.

    Returns:
        Such as ``python -m gazempc.run --replay subject03_R4``.
    """
    return shlex.join(["python", "-m", module, *words])


class Progress:
    """Reports the present work on standard error once a job has been silent for two seconds."""

    def __init__(self) -> None:
        self._started_s = self._reported_s = time.monotonic()
        self._what = ""
        self._shown = False

    def at(self, share: float) -> None:
        """Report the progress of the present work every few seconds.

        Args:
            share: Completed share, 0 to 1.
        """
        now_s = time.monotonic()
        if now_s - self._reported_s > _SILENCE_S:
            self._reported_s, self._shown = now_s, True
            print(f"... {self._what}, {100 * share:.0f} %", file=sys.stderr, flush=True)

    def begin(self, what: str) -> None:
        """Begin a piece of work.

        Args:
            what: Short name.
        """
        self._what = what
        if self._shown or time.monotonic() - self._started_s > _SILENCE_S:
            self._shown = True
            print(f"... {what}", file=sys.stderr, flush=True)
