"""Parsers of TOML and YAML settings from untrusted sources, bounded and without code execution; writer of TOML."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import yaml

from gazempc.errors import SettingsError, shown
from gazempc.files.bounds import MOST_SETTINGS_BYTES, read_limited

# Nesting limit: deeper than any settings, and far below the stack limit of the parsers.
_DEEPEST = 30
# Strings and comments are skipped: dotted keys inside them are text.
_TOML_KEY = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
_TOML_TOKENS = re.compile(
    rf"(?P<deep>{_TOML_KEY}(?:[ \t]*+\.[ \t]*+{_TOML_KEY}){{{_DEEPEST},}})"
    r'|"{3}(?:\\.|[^\\])*?"{3}'
    r"|'{3}.*?'{3}|#[^\n]*+|" + _TOML_KEY,
    re.DOTALL,
)
_LONGEST_REASON = 300
_Value = TypeVar("_Value")
_TOO_DEEP = f"nested deeper than {_DEEPEST} levels"


def read_settings(path: Path) -> str:
    """Read the text of a settings file.

    Args:
        path: The file.

    Returns:
        Its text.

    Raises:
        SettingsError: If it cannot be read, is not a regular file, is too large or is not text.
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
        source: Origin of the text, for messages.

    Returns:
        Its tables.

    Raises:
        SettingsError: If it is not TOML, has a number with thousands of digits or is nested too deeply.
    """
    with _parser_errors(source, "TOML"):
        if len(text) > MOST_SETTINGS_BYTES:
            raise ValueError(f"{len(text)} characters; at most {MOST_SETTINGS_BYTES} are accepted")
        # The parser's time and memory grow with the square of the parts of a key.
        if any(found.lastgroup for found in _TOML_TOKENS.finditer(text)):
            raise ValueError(_TOO_DEEP)
        return _checked(tomllib.loads(text))


def parse_yaml(text: str, source: str) -> Any:
    """Parse YAML without aliases, a few lines of which may expand to gigabytes.

    Args:
        text: YAML.
        source: Origin of the text, for messages.

    Returns:
        Its content.

    Raises:
        SettingsError: If it is not YAML, has aliases, has a number with thousands of digits or is nested too deeply.
    """
    check_yaml(text, source)
    with _parser_errors(source, "YAML"):
        return _checked(yaml.safe_load(text))


def check_yaml(text: str, source: str) -> None:
    """Reject YAML that is unsafe for other parsers.

    Args:
        text: YAML.
        source: Origin of the text, for messages.

    Raises:
        SettingsError: If it is not YAML, has aliases or is nested too deeply.
    """
    depth = 0
    with _parser_errors(source, "YAML"):
        for event in yaml.parse(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
            line = "" if event.start_mark is None else f"line {event.start_mark.line + 1}: "
            if isinstance(event, yaml.AliasEvent):
                raise ValueError(f"{line}aliases (*{event.anchor}) are not accepted")
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > _DEEPEST:
                raise ValueError(f"{line}{_TOO_DEEP}")


def as_toml(values: Mapping[str, object]) -> str:
    """TOML text for `gazempc.specfiles`.

    Args:
        values: Numbers, strings, Booleans and lists; mappings become tables.

    Returns:
        TOML, tables last.
    """
    return "\n".join(_lines(values, "")) + "\n"


def _lines(values: Mapping[str, object], within: str) -> list[str]:
    lines = [f"{key} = {_toml(value)}" for key, value in values.items() if not isinstance(value, Mapping)]
    for key, fields in values.items():
        if isinstance(fields, Mapping):
            plain = any(not isinstance(field, Mapping) for field in fields.values())
            lines += ["", f"[{within}{key}]"] if plain else []
            lines += _lines(fields, f"{within}{key}.")
    return lines


def _toml(value: object) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    # JSON's Booleans, integers and escapes are valid TOML; it leaves only DEL unescaped.
    return repr(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


@contextmanager
def _parser_errors(source: str, language: str) -> Iterator[None]:
    try:
        yield
    except RecursionError:
        raise SettingsError(f"{source}: not valid {language}: {_TOO_DEEP}") from None
    # Invalid dates and lists as keys make the YAML parser raise other errors than its own.
    except (yaml.YAMLError, ValueError, TypeError, OverflowError) as error:
        text = str(error)
        if "digits" in text and "limit" in text:  # Python's message is advice to programmers
            text = "an integer with thousands of digits"
        elif "maximum nesting depth" in text:  # newer libyaml has a nesting limit, too
            text = _TOO_DEEP
        text = text if len(text) <= _LONGEST_REASON else f"{text[:_LONGEST_REASON]}..."
        raise SettingsError(f"{source}: not valid {language}: {text}") from None


def _checked(value: _Value, depth: int = 0) -> _Value:
    """The value; rejects integers beyond 64 bits, invalid strings and deep nesting.

    Raises:
        ValueError: Names the part.
    """
    if depth > _DEEPEST:
        raise ValueError(_TOO_DEEP)
    keys = value if isinstance(value, dict | list | tuple | set) else ()
    for part in (*keys, *(value.values() if isinstance(value, dict) else ())):
        _checked(part, depth + 1)
    if isinstance(value, int) and abs(value) > 2**63:
        raise ValueError(f"{shown(value)} is too large an integer; accepted: 64 bits")
    if isinstance(value, str) and any("\ud800" <= character <= "\udfff" for character in value):
        raise ValueError(f"{shown(value)} is not valid text: it has half of a surrogate pair")
    return value
