"""Common settings, command line, exit status and messages of all commands."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Generic, TypeVar

import tyro
from pydantic import BaseModel, Field, ValidationError

from gazempc import command
from gazempc.errors import MissingOptionalDependencyError, SettingsError
from gazempc.part_options import take_options
from gazempc.settings import Settings
from gazempc.specfiles import explain

S = TypeVar("S", bound=BaseModel)


class WorkSettings(Settings):
    """Workers of a command, and the folder of its results."""

    jobs: int = Field(default=os.cpu_count() or 1, ge=1, description="Worker processes on this machine")
    dask: str | None = Field(
        default=None, description="Scheduler of a dask.distributed cluster that does the jobs, such as tcp://host:8786"
    )
    out: Path = Field(default=Path("out"), description="Where to write; an interrupted command goes on there")

    def saved(self, *also: str) -> dict[str, Any]:
        """The settings for a summary, without these: results do not depend on the workers.

        Args:
            also: Other fields to leave out.
        """
        return self.model_dump(mode="json", exclude={*WorkSettings.model_fields, *also})


@dataclass(frozen=True)
class Command(Generic[S]):
    """A command line.

    Attributes:
        name: Python runs ``experiments.<name>``.
        model: The settings; a model with a field ``options`` takes ``--options.KEY VALUE``.
        about: What it does, for ``--help``.
        work: Executes it with the settings and the command line, and returns the exit status.
    """

    name: str
    model: type[S]
    about: str | None
    work: Callable[[S, str], int]

    def main(self, arguments: Sequence[str] | None = None) -> int:
        """Run the command line.

        Args:
            arguments: Command line without the program's name; default: the process's.

        Returns:
            Exit status: 0; 1 if a limit was left; 4 if a job failed; else as of `run_interruptible`.
        """
        words = list(sys.argv[1:] if arguments is None else arguments)
        line = command.command_line(f"experiments.{self.name}", words)
        return command.run_interruptible(self.name, lambda: self.work(self.parse(words), line))

    def parse(self, words: list[str]) -> S:
        """Settings from a command line.

        Args:
            words: Command line without the program's name.

        Returns:
            The settings.

        Raises:
            SettingsError: If an option has no value.
            SystemExit: If the command line is wrong (status 2) or asks for help (status 0).
        """
        own: dict[str, Any] = {}
        if "options" in self.model.model_fields:
            words, own["options"] = take_options(words)
        prog = f"python -m experiments.{self.name}"
        found = tyro.cli(self.model, config=command.TYRO_CONFIG, args=words, prog=prog, description=self.about)
        return found.model_copy(update=own)


def check_optuna(what: str) -> None:
    """Raise MissingOptionalDependencyError, which names what needs it, unless Optuna is installed."""
    if find_spec("optuna") is None:
        raise MissingOptionalDependencyError(what, "optuna", "tune")


def call_of(name: str, values: dict[str, Any]) -> str:
    """The text of a call from Python, such as ``experiments.compare.compare(recordings=['synthetic'])``."""
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


def exit_status(left_limits: bool, failed: bool) -> int:
    """Exit status of a command whose jobs are done.

    Args:
        left_limits: Whether a limit was left in any of them.
        failed: Whether any of them failed.

    Returns:
        1 if a limit was left, else 4 if any failed, else 0.
    """
    return command.VIOLATION if left_limits else command.INCOMPLETE if failed else 0
