"""Errors of the package; each message has the fault and the accepted values."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

# A longer list would hide the message; its first and last name show the pattern.
_NAMES_SHOWN = 30
# A message about a file is a few lines long, whatever the file contains.
_PLACE_SHOWN, _PROBLEM_SHOWN = 200, 1000


class GazempcError(Exception):
    """Base of all errors a user can cause; command lines print its text and exit with status 2."""


class RecordingError(GazempcError):
    """A recording cannot be read: names the file, the place in it and what was expected."""

    def __init__(self, source: str | Path, where: str, problem: str, expected: str) -> None:
        self.source = str(source)
        self.where = where
        self.problem = problem
        self.expected = expected
        place = f"{source}: {_cut(where, _PLACE_SHOWN)}" if where else f"{source}"
        super().__init__(f"{place}: {_cut(problem, _PROBLEM_SHOWN)}. Expected: {expected}.")


class LeftOutError(GazempcError):
    """A recording is sound but this experiment cannot be made with it; comparisons leave it out and count it."""


class PlacementError(LeftOutError):
    """The robot cannot be placed beside this recording (for example, the person comes too near)."""


class SettingsError(GazempcError):
    """A setting, neck or sensor file is wrong: names the file, the field and the accepted values."""


class RobotError(GazempcError):
    """A robot does not answer or refuses what was asked."""


class LimitViolationError(GazempcError):
    """A command or joint left the limits of the neck; never expected, always fatal to a run."""


class MissingOptionalDependencyError(GazempcError):
    """A feature needs an extra that is not installed: names the extra and the command."""

    def __init__(self, feature: str, package: str, extra: str) -> None:
        super().__init__(f"{feature} needs the package {package!r}: pip install {package} (extra {extra!r} of gazempc)")


@contextmanager
def importing(feature: str, package: str, extra: str) -> Iterator[None]:
    """Imports of an optional package stand in here.

    Args:
        feature: What needs it, for the message.
        package: Its name, as pip takes it.
        extra: The extra that has it.

    Raises:
        MissingOptionalDependencyError: If an import fails.
    """
    try:
        yield
    except ImportError:
        raise MissingOptionalDependencyError(feature, package, extra) from None


def shown(value: object, limit: int = 40) -> str:
    """Quote a piece of a file in a message, cut to a length that fits on a line.

    Args:
        value: What stands in the file.
        limit: Characters to show at most.

    Returns:
        The quoted text.
    """
    if isinstance(value, str):
        return repr(_cut(value, limit))
    try:
        return _cut(repr(value), limit)
    except ValueError:  # Python does not write whole numbers of thousands of digits
        return "a number of thousands of digits"


def _cut(text: str, limit: int) -> str:
    return text if len(text) <= limit else text[:limit] + "..."


def suggest(name: str, accepted: Iterable[str]) -> str:
    """Say which accepted name a misspelt one most likely meant, and list them all (a long list by its ends).

    Args:
        name: What the user wrote.
        accepted: All valid names.

    Returns:
        A sentence fragment such as ``"perhaps you meant 'mpc'; accepted: lookahead, mpc"``.
    """
    names = sorted(accepted)
    # Numbers differ by leading zeros more often than by digits.
    near = [each for each in names if _without_zeros(each) == _without_zeros(name)]
    near = near or difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    hint = f"perhaps you meant {near[0]!r}; " if near else ""
    shown = names if len(names) <= _NAMES_SHOWN else [names[0], "...", names[-1]]
    return f"{hint}accepted: {', '.join(shown)}"


def _without_zeros(name: str) -> str:
    return re.sub(r"(?<!\d)0+(?=\d)", "", name.lower())
