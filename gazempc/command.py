"""What all command lines share: messages and exit statuses."""

from __future__ import annotations

import os
import shlex
import sys
import traceback
from collections.abc import Callable, Sequence

from tyro.conf import HelptextFromCommentsOff

from gazempc.errors import GazempcError, LimitViolationError

# 1 means a limit violation only. Python's own status after an exception is 1, too, so all exceptions are caught.
VIOLATION, BAD_INPUT, UNEXPECTED, INCOMPLETE = 1, 2, 3, 4
# For `tyro.cli`: help texts are descriptions and docstrings. To look for comments, too, takes a quarter of a second.
TYRO_CONFIG = (HelptextFromCommentsOff,)


def run_command(name: str, work: Callable[[], int]) -> int:
    """Do the work of a command. What a user can cause becomes a message and an exit status.

    Args:
        name: The command's name, for messages.
        work: Does it, and gives the exit status.

    Returns:
        The status of `work`. 1: a limit violation. 2: bad input, or an error of the file system. 3: any other
        exception, a fault of the program. 0: also if the reader of the output has closed it, as in ``... --list |
        head``.
    """
    try:
        return work()
    except BrokenPipeError:
        # The reader is gone.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (GazempcError, OSError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return VIOLATION if isinstance(error, LimitViolationError) else BAD_INPUT
    except Exception:
        traceback.print_exc()
        print(f"{name}: a fault of this program, not of your input: please report the lines above", file=sys.stderr)
        return UNEXPECTED


def command_line(module: str, words: Sequence[str]) -> str:
    """A command as a shell takes it, to be repeated.

    Args:
        module: What Python runs.
        words: Its arguments.

    Returns:
        Such as ``python -m gazempc.run --replay subject03_R4``.
    """
    return shlex.join(["python", "-m", module, *words])
