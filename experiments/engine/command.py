"""What all commands over many recordings share: their common settings, exit status and messages."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import tyro
from pydantic import Field, ValidationError

from experiments.engine.signals import Interrupted, ending_on_signals
from gazempc import command
from gazempc.command import TYRO_CONFIG
from gazempc.errors import SettingsError
from gazempc.part_options import take_options
from gazempc.settings import Settings
from gazempc.specfiles import explain

S = TypeVar("S", bound=Settings)


class WorkSettings(Settings):
    """Who does the jobs of a command, and where the results are kept."""

    jobs: int = Field(default=os.cpu_count() or 1, ge=1, description="Worker processes on this machine")
    dask: str | None = Field(
        default=None, description="Scheduler of a dask.distributed cluster that does the jobs, such as tcp://host:8786"
    )
    out: Path = Field(default=Path("out"), description="Where to write; an interrupted command goes on there")


# The same results come of any number of workers, in any place.
NOT_SAVED = frozenset(WorkSettings.model_fields)


def parse(model: type[S], name: str, about: str | None, arguments: Sequence[str] | None) -> S:
    """Settings from a command line; a model with a field ``options`` takes ``--options.KEY VALUE``.

    Args:
        model: The settings.
        name: The command's name.
        about: What it does, for ``--help``.
        arguments: Command line without the program's name; None for the process's.

    Returns:
        The settings.

    Raises:
        SettingsError: If an option has no value.
        SystemExit: If the command line is wrong (status 2) or asks for help (status 0).
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    prog = f"python -m experiments.{name}"
    if "options" not in model.model_fields:
        return tyro.cli(model, config=TYRO_CONFIG, args=words, prog=prog, description=about)
    words, options = take_options(words)
    return tyro.cli(model, config=TYRO_CONFIG, args=words, prog=prog, description=about).model_copy(
        update={"options": options}
    )


def command_of(name: str, arguments: Sequence[str] | None) -> str:
    """What repeats a command, for its report.

    Args:
        name: The command's name.
        arguments: Command line without the program's name; None for the process's.
    """
    return command.command_line(f"experiments.{name}", sys.argv[1:] if arguments is None else arguments)


def call_of(name: str, values: dict[str, Any]) -> str:
    """The same of a call from Python, such as ``experiments.compare.compare(recordings=['synthetic'])``."""
    return f"{name}({', '.join(f'{key}={value!r}' for key, value in values.items())})"


def check(model: type[S], name: str, values: dict[str, Any]) -> S:
    """Settings from Python.

    Args:
        model: The settings.
        name: What takes them, for messages.
        values: Value by field.

    Returns:
        The settings.

    Raises:
        SettingsError: With every unknown field and every wrong value.
    """
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise SettingsError(explain(error, name, model)) from None


def run_command(name: str, work: Callable[[], int]) -> int:
    """Do the work of a command, and turn what a user can cause into a message and an exit status.

    Args:
        name: The command's name, for messages.
        work: Does it, and gives the exit status.

    Returns:
        What `work` gives; 2 on bad input or a file system that refuses; 3 on a fault of the program; 130 after Ctrl-C,
        143 after SIGTERM.
    """
    try:
        with ending_on_signals():
            return command.run_command(name, work)
    except Interrupted as stop:
        what = "".join(f": {note}" for note in getattr(stop, "__notes__", ()))
        print(f"{name}: interrupted{what}; run the same command again to go on", file=sys.stderr)
        return 128 + stop.signum


def exit_status(left_limits: bool, failed: bool) -> int:
    """Exit status of a command whose jobs are done.

    Args:
        left_limits: Whether a limit was left in any of them.
        failed: Whether any of them failed.

    Returns:
        1 if a limit was left, else 4 if any failed, else 0.
    """
    return command.VIOLATION if left_limits else command.INCOMPLETE if failed else 0


def throughput(simulated_s: float, wall_s: float, settings: WorkSettings) -> str:
    """A line on how fast replays were done; empty if none was.

    Args:
        simulated_s: Their length, seconds.
        wall_s: How long they took, seconds.
        settings: Who did them.
    """
    if not simulated_s:
        return ""
    rate = simulated_s / wall_s
    each = "" if settings.dask else f", {rate / settings.jobs:.1f} a second and worker"
    return f"{simulated_s:.0f} simulated seconds in {wall_s:.0f} s: {rate:.1f} a second{each}\n"
