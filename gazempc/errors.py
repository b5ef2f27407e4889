"""Errors of the package; each message states the fault and the accepted values."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

# Maximum number of names in a message; of a longer list the first and last name show the pattern.
_NAMES_SHOWN = 30
# Length limits of quotations from files.
_PLACE_SHOWN, _PROBLEM_SHOWN = 200, 1000


class GazempcError(Exception):
    """Base of all errors a user can cause; command lines print its text and exit with status 2."""


class RecordingError(GazempcError):
    """An unreadable recording; the message names file, location and expected content."""

    def __init__(self, source: str | Path, where: str, problem: str, expected: str) -> None:
        self.where = where
        place = f"{source}: {_cut(where, _PLACE_SHOWN)}" if where else f"{source}"
        super().__init__(f"{place}: {_cut(problem, _PROBLEM_SHOWN)}. Expected: {expected}.")


class LeftOutError(GazempcError):
    """A valid recording that is unsuitable for this experiment; comparisons exclude and count it."""


class PlacementError(LeftOutError):
    """No valid pose of the robot beside this recording (for example, the person is too near)."""


class SettingsError(GazempcError):
    """An invalid setting, neck or sensor file; the message names file, field and accepted values."""


class RobotError(GazempcError):
    """A robot does not reply or refuses a request."""


class LimitViolationError(GazempcError):
    """A command or joint exceeded the limits of the neck; always fatal to a run."""


class MissingOptionalDependencyError(GazempcError):
    """A missing optional package; the message names the extra and the command to install it."""

    def __init__(self, feature: str, package: str, extra: str) -> None:
        super().__init__(f"{feature} needs the package {package!r}: pip install {package} (extra {extra!r} of gazempc)")


@contextmanager
def importing(feature: str, package: str, extra: str) -> Iterator[None]:
    """Context for the import of an optional package.

    Args:
        feature: Feature that needs it, for the message.
        package: Its name for pip.
        extra: The extra that contains it.

    Raises:
        MissingOptionalDependencyError: If an import fails.
    """
    try:
        yield
    except ImportError:
        raise MissingOptionalDependencyError(feature, package, extra) from None


def shown(value: object, limit: int = 40) -> str:
    """Quote a value of a file for a message, cut to a length.

    Args:
        value: Value in the file.
        limit: Maximum number of characters.

    Returns:
        The quoted text.
    """
    if isinstance(value, str):
        return repr(_cut(value, limit))
    try:
        return _cut(repr(value), limit)
    except ValueError:  # Python formats no integers of thousands of digits
        return "a number of thousands of digits"


def _cut(text: str, limit: int) -> str:
    return text if len(text) <= limit else text[:limit] + "..."


def suggest(name: str, accepted: Iterable[str]) -> str:
    """Suggest the most similar accepted name, and list all (of a long list both ends).

    Args:
        name: Name given by the user.
        accepted: All valid names.

    Returns:
        A sentence fragment such as ``"perhaps you meant 'mpc'; accepted: lookahead, mpc"``.
    """
    names = sorted(accepted)
    # Misspelt numbers differ by leading zeros more often than by digits.
    near = [each for each in names if _without_zeros(each) == _without_zeros(name)]
    near = near or difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    hint = f"perhaps you meant {near[0]!r}; " if near else ""
    shown = names if len(names) <= _NAMES_SHOWN else [names[0], "...", names[-1]]
    return f"{hint}accepted: {', '.join(shown)}"


def _without_zeros(name: str) -> str:
    return re.sub(r"(?<!\d)0+(?=\d)", "", name.lower())
