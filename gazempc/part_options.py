"""Construction of parts: constructor arguments by injection, or from options."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Any, get_type_hints

from pydantic import ConfigDict, ValidationError, create_model

from gazempc.errors import SettingsError, shown, suggest
from gazempc.files.documents import parse_yaml
from gazempc.parts import Kind, check_members, error_line, find, is_own

_ANY_TYPE = ConfigDict(arbitrary_types_allowed=True)


def make(kind: Kind, choice: str, given: Mapping[str, Any], options: Mapping[str, Any]) -> Any:
    """Make a part.

    Args:
        kind: The kind of part.
        choice: A shipped name or ``module:Class``.
        given: Arguments injected by parameter name, such as ``neck``; others are ignored.
        options: Values for other parameters, in their types or as text; checked by the constructor's annotations.

    Returns:
        The part, with all required methods.

    Raises:
        SettingsError: If a value is missing or wrong, the constructor raises, or a method is missing.
    """
    factory = find(kind, choice)
    wanted = parameters(factory)
    known = {name: value for name, value in given.items() if name in wanted}
    known |= {name: _checked(kind, choice, wanted[name], options[name]) for name in options if name in wanted}
    for name, parameter in wanted.items():
        if name not in known and parameter.default is inspect.Parameter.empty:
            raise SettingsError(
                f"{kind.name} {choice}: its constructor needs {name!r}: set --options.{name} VALUE; "
                f"injected into each {kind.name}: {', '.join(given) or 'nothing'}"
            )
    try:
        part = factory(**known)
    except (SettingsError, MemoryError):
        raise
    except Exception as error:
        raise SettingsError(f"{kind.name} {choice}: its constructor raised {error_line(error)}") from error
    check_members(kind, part, choice)
    return part


def parameters(factory: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    """Keyword parameters of a class or function, with annotations resolved where possible."""
    try:
        signature = inspect.signature(factory)
    except (TypeError, ValueError):  # built in: no signature
        return {}
    try:
        hints = get_type_hints(factory.__init__ if inspect.isclass(factory) else factory)
    except Exception:  # an annotation that does not resolve is no reason to refuse the part
        hints = {}
    by_name = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    return {
        name: parameter.replace(annotation=hints.get(name, inspect.Parameter.empty))
        for name, parameter in signature.parameters.items()
        if parameter.kind in by_name
    }


def options_for(kind: Kind, choice: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Select the options of one part.

    Args:
        kind: The kind of part.
        choice: A shipped name, which takes no options, or ``module:Class``.
        options: Values by ``key``, or by ``kind.key`` for one kind of part.

    Returns:
        Values by name of the constructor's parameter.
    """
    if not is_own(choice):
        return {}
    wanted = parameters(find(kind, choice))
    plain = {key: value for key, value in options.items() if key in wanted}
    prefix = f"{kind.name}."
    return plain | {k.removeprefix(prefix): v for k, v in options.items() if k.startswith(prefix)}


def check_options(choices: Iterable[tuple[Kind, str]], options: Mapping[str, Any]) -> None:
    """Refuse options that no chosen part accepts.

    Args:
        choices: All parts of a run.
        options: As in `options_for`.

    Raises:
        SettingsError: If there are any; names each, and the accepted options.
    """
    if not options:
        return
    own = [(kind, parameters(find(kind, choice))) for kind, choice in choices if is_own(choice)]
    accepted = {key for kind, names in own for name in names for key in (name, f"{kind.name}.{name}")}
    if not accepted:
        raise SettingsError(
            f"options.{next(iter(options))}: accepted for user-defined parts (module:Class), and none is chosen; "
            "shipped parts have settings of their own names, see --help"
        )
    if wrong := [key for key in options if key not in accepted]:
        raise SettingsError(
            "\n".join(f"options.{key}: no chosen part accepts it; {suggest(key, accepted)}" for key in wrong)
        )


def take_options(words: Iterable[str], not_own: Iterable[str] = ()) -> tuple[list[str], dict[str, str]]:
    """Extract ``--options.key value`` from a command line; hyphens in a key mean underscores.

    Args:
        words: The command line.
        not_own: First names after ``options.`` that are fields of the command line.

    Returns:
        The remaining words, and the values by key.

    Raises:
        SettingsError: If a value is missing.
    """
    rest: list[str] = []
    options: dict[str, str] = {}
    known = tuple(f"--options.{name}." for name in not_own)
    waiting = iter(words)
    for word in waiting:
        if not word.startswith("--options.") or word.startswith(known):
            rest.append(word)
            continue
        key, mark, value = word.removeprefix("--options.").partition("=")
        if not mark:
            value = next(waiting, "--")
            if value.startswith("--"):
                raise SettingsError(f"--options.{key}: needs a value")
        options[key.replace("-", "_")] = value
    return rest, options


def _checked(kind: Kind, choice: str, parameter: inspect.Parameter, value: Any) -> Any:
    if parameter.annotation is inspect.Parameter.empty:
        return parse_yaml(value, f"options.{parameter.name}") if isinstance(value, str) else value
    # As a field, as a type with its own configuration accepts no other.
    model: Any = create_model("Option", __config__=_ANY_TYPE, value=(parameter.annotation, ...))
    try:
        # Text of a command line is parsed as YAML, unless the type is a text: "[1, 2]", "true".
        try:
            return model(value=value).value
        except ValidationError:
            if not isinstance(value, str):
                raise
            return model(value=parse_yaml(value, f"options.{parameter.name}")).value
    except (ValidationError, SettingsError) as error:
        problem = error.errors()[0]["msg"] if isinstance(error, ValidationError) else "not valid YAML"
        given = shown(value, 100)
        raise SettingsError(f"{kind.name} {choice}: options.{parameter.name}: {problem} (given: {given})") from None
