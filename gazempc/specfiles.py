"""Read a shipped specification by name, or a user-defined one by path."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic.fields import FieldInfo

from gazempc.errors import SettingsError, shown, suggest
from gazempc.files.bounds import is_there
from gazempc.files.documents import parse_toml, read_settings

# Maximum number of errors shown for one file.
_ERRORS_SHOWN = 20
_FIELD_SHOWN = 100

Spec = TypeVar("Spec", bound=BaseModel)


class Strict(BaseModel):
    """Base of settings and of tables in files: frozen; refuses unknown fields and infinite numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def shipped_names(folder: str) -> tuple[str, ...]:
    """Names of the specifications that ship in a folder of the package.

    Args:
        folder: Folder inside the package, ``"neck"`` or ``"sim/sensors"``.

    Returns:
        The file names without their ending, sorted.
    """
    names = (Path(entry.name) for entry in files("gazempc").joinpath(folder).iterdir())
    return tuple(sorted(path.stem for path in names if path.suffix == ".toml"))


def load_spec(model: type[Spec], folder: str, name_or_path: str | Path) -> Spec:
    """Load and check a specification.

    Args:
        model: Model of the file.
        folder: Folder of the package with the shipped files.
        name_or_path: Name of a shipped file, or path to a TOML file.

    Returns:
        The checked specification.

    Raises:
        SettingsError: If the file is missing or invalid; lists all errors, each with its field.
    """
    shipped = shipped_names(folder)
    if str(name_or_path) in shipped:
        text = files("gazempc").joinpath(folder, f"{name_or_path}.toml").read_text(encoding="utf-8")
        return parse_spec(model, text, f"{folder}/{name_or_path}.toml")
    path = Path(name_or_path)
    if not is_there(path):
        raise SettingsError(
            f"no {Path(folder).name.removesuffix('s')} file {shown(str(name_or_path), 200)}: give the path of a .toml "
            f"file or a shipped name; {suggest(str(name_or_path), shipped)}"
        )
    return parse_spec(model, read_settings(path), str(path))


def parse_spec(model: type[Spec], text: str, source: str) -> Spec:
    """Parse the TOML text of a specification.

    Args:
        model: Model of the text.
        text: TOML.
        source: Origin of the text, for messages.

    Returns:
        The checked specification.

    Raises:
        SettingsError: If the text is not TOML or does not describe a valid specification.
    """
    return checked(model, parse_toml(text, source), source)


def checked(model: type[Spec], data: Any, source: str) -> Spec:
    """Validate data by a model.

    Args:
        model: The model.
        data: The data.
        source: Origin of the data, for messages.

    Returns:
        The checked values.

    Raises:
        SettingsError: If the data are invalid; lists all errors, each with its field.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise SettingsError(explain(error, source, model)) from None


def explain(error: ValidationError, source: str, model: type[BaseModel]) -> str:
    """Format all errors of a validation for the user.

    Args:
        error: The error of pydantic.
        source: Origin of the data.
        model: The model, for suggestions.

    Returns:
        One line per error: source, field, problem, given value.
    """
    lines = []
    found = error.errors()
    for item in found[:_ERRORS_SHOWN]:
        field = ".".join(str(part)[:_FIELD_SHOWN] for part in item["loc"]) or "(whole file)"
        message = item["msg"].removeprefix("Value error, ")
        fields = _fields_at(model, item["loc"][:-1])
        if item["type"] == "extra_forbidden":
            message = f"unknown field; {suggest(str(item['loc'][-1]), fields)}"
        elif item["type"] == "missing" and (missing := fields.get(str(item["loc"][-1]))) is not None:
            message += f"; {missing.description}" if missing.description else ""
        elif item["type"] != "value_error":
            message += f" (given: {shown(item['input'], _FIELD_SHOWN)})"
        lines += [f"{source}: {field}: {line}" for line in message.splitlines()]
    if len(found) > _ERRORS_SHOWN:
        lines.append(f"{source}: and {len(found) - _ERRORS_SHOWN} errors more")
    return "\n".join(lines)


def _fields_at(model: type[BaseModel], location: tuple[int | str, ...]) -> dict[str, FieldInfo]:
    """Fields of the nested model at a location; empty if there is none."""
    fields = model.model_fields
    for part in location:
        if isinstance(part, int):  # an entry of a tuple
            continue
        kind = fields[part].annotation if part in fields else None
        kind = next(iter(get_args(kind)), kind)
        if not (isinstance(kind, type) and issubclass(kind, BaseModel)):
            return {}
        fields = kind.model_fields
    return fields
