"""Settings as TOML or YAML text from untrusted sources: parsed within bounds, never executed."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import yaml

from gazempc.errors import SettingsError, shown
from gazempc.files.bounds import MOST_SETTINGS_BYTES, read_limited

# Deeper than any settings, and far from where the parsers run out of stack.
_DEEPEST = 30
# Strings and comments are passed over: a key of dots inside them is text.
_TOML_KEY = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
_TOML_TOKENS = re.compile(
    rf"(?P<deep>{_TOML_KEY}(?:[ \t]*+\.[ \t]*+{_TOML_KEY}){{{_DEEPEST},}})"
    r'|"{3}(?:\\.|[^\\])*?"{3}'
    r"|'{3}.*?'{3}|#[^\n]*+|" + _TOML_KEY,
    re.DOTALL,
)
_TOO_DEEP = f"nested deeper than {_DEEPEST} levels"


def read_settings(path: Path) -> str:
    """Text of a file with settings.

    Args:
        path: The file.

    Returns:
        Its text.

    Raises:
        SettingsError: If it cannot be read, is no regular file, is too large or is not text.
    """
    try:
        return read_limited(path, MOST_SETTINGS_BYTES).decode("utf-8")
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise SettingsError(f"{path}: not a text file ({error.reason} at byte {error.start})") from None


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """Parse TOML.

    Args:
        text: TOML.
        source: Where it is from, for messages.

    Returns:
        Its tables.

    Raises:
        SettingsError: If it is not TOML, holds a number of thousands of digits or is nested too deeply.
    """
    try:
        if len(text) > MOST_SETTINGS_BYTES:
            raise ValueError(f"{len(text)} characters; accepted are {MOST_SETTINGS_BYTES} at most")
        # The parser's time and memory grow with the square of the parts of a key.
        if any(found.lastgroup for found in _TOML_TOKENS.finditer(text)):
            raise ValueError(_TOO_DEEP)
        found = tomllib.loads(text)
        _check(found)
    except (ValueError, RecursionError) as error:
        raise SettingsError(f"{source}: not valid TOML: {_reason(error)}") from None
    return found


def parse_yaml(text: str, source: str) -> Any:
    """Parse YAML without aliases: a few lines of them stand for gigabytes.

    Args:
        text: YAML.
        source: Where it is from, for messages.

    Returns:
        Its content.

    Raises:
        SettingsError: If it is not YAML, has aliases, holds a number of thousands of digits or is nested too deeply.
    """
    try:
        check_yaml(text, source)
        found = yaml.safe_load(text)
        _check(found)
    # Dates that do not exist and keys that are lists make the parser raise other errors than its own.
    except (yaml.YAMLError, ValueError, TypeError, OverflowError) as error:
        raise SettingsError(f"{source}: not valid YAML: {_reason(error)}") from None
    return found


def check_yaml(text: str, source: str) -> None:
    """Refuse YAML that another parser must not be given.

    Args:
        text: YAML.
        source: Where it is from, for messages.

    Raises:
        SettingsError: If it is not YAML, has aliases or is nested too deeply.
    """
    depth = 0
    try:
        for event in yaml.parse(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
            if isinstance(event, yaml.AliasEvent):
                raise SettingsError(f"{source}: {_line(event)}: aliases (*{event.anchor}) are not accepted")
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > _DEEPEST:
                raise SettingsError(f"{source}: {_line(event)}: {_TOO_DEEP}")
    except (yaml.YAMLError, ValueError) as error:
        raise SettingsError(f"{source}: not valid YAML: {_reason(error)}") from None


def _line(event: yaml.Event) -> str:
    return "" if event.start_mark is None else f"line {event.start_mark.line + 1}"


def _check(value: Any, depth: int = 0) -> None:
    """Refuse values that cannot be computed with, or printed.

    Raises:
        ValueError: Says what it is.
    """
    if depth > _DEEPEST:
        raise ValueError(_TOO_DEEP)
    if isinstance(value, dict):
        for key, item in value.items():
            _check(key, depth + 1)
            _check(item, depth + 1)
    elif isinstance(value, list | tuple | set):
        for item in value:
            _check(item, depth + 1)
    elif isinstance(value, int) and abs(value) > 2**63:
        raise ValueError(f"{shown(value)} is too large a whole number; accepted: 64 bits")
    elif isinstance(value, str) and any("\ud800" <= character <= "\udfff" for character in value):
        raise ValueError(f"{shown(value)} is no text: half of a surrogate pair")


def _reason(error: Exception) -> str:
    if isinstance(error, RecursionError):
        return _TOO_DEEP
    text = str(error)
    if "digits" in text and "limit" in text:  # Python's own words advise programmers
        return "a whole number of thousands of digits"
    return text if len(text) <= 300 else f"{text[:300]}..."
