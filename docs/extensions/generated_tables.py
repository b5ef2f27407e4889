"""Tables that are made from the code, in place of blocks of a page, before the page is parsed.

`{settings} module.Model` lists the fields of a pydantic model and of its tables; `beside module.Other` leaves out what
the other one has. `{events}` lists the events of a log, `{front_door}` the names of `import gazempc as gz`.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from pkgutil import resolve_name
from typing import Any, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from sphinx.application import Sphinx

import gazempc
from gazempc.loop.events import MEANINGS

_SETTINGS = re.compile(r"^```\{settings\} (\S+)(?: beside (\S+))?\n```$", re.MULTILINE)


def model_within(field: FieldInfo) -> type[BaseModel] | None:
    """The model of a field that is a table of its own."""
    kinds = (field.annotation, *get_args(field.annotation))
    return next((kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)), None)


def tables(model: type[BaseModel], prefix: str = "") -> dict[str, dict[str, FieldInfo]]:
    """Fields of a model and of the models in it: prefix (empty for the model itself) -> dotted name -> field."""
    found: dict[str, dict[str, FieldInfo]] = {prefix: {}}
    for name, field in model.model_fields.items():
        inner = model_within(field)
        if inner is None:
            found[prefix][f"{prefix}{name}"] = field
        else:
            found |= tables(inner, f"{prefix}{name}.")
    return {key: fields for key, fields in found.items() if fields}


def default(field: FieldInfo) -> str:
    """The default as it stands in a cell; empty where there is none, or where the description states it."""
    value = field.get_default(call_default_factory=True)
    if field.is_required() or value is None or value in ((), {}, ""):
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"`{', '.join(map(str, value)) if isinstance(value, tuple) else value}`"


def markdown(model: type[BaseModel], beside: type[BaseModel] | None = None) -> Iterator[str]:
    """Lines of the tables of a model, without the fields that another one has, too."""
    known = tables(beside) if beside else {}
    for prefix, fields in tables(model).items():
        rows = {name: field for name, field in fields.items() if name not in known.get(prefix, {})}
        if rows:
            yield from ["", f"### `{prefix[:-1]}`" if prefix else "", ""]
            yield from ["| setting | default | meaning |", "|---|---|---|"]
            for name, field in rows.items():
                text = re.sub(r"([|<*])", r"\\\1", field.description or "")
                text = re.sub(r"(?<!`)--[a-z][\w.-]*", r"`\g<0>`", text)  # a bare -- would become a dash
                yield f"| `{name}` | {default(field)} | {text} |"


def events() -> Iterator[str]:
    """Lines of the table of events: name, and condition with the reaction."""
    yield from ["| event | meaning |", "|---|---|"]
    yield from (f"| `{name}` | {meaning} |" for name, meaning in MEANINGS.items())


def front_door() -> Iterator[str]:
    """Lines of the table of names of the package: name, first sentence of its docstring, link to its module's page."""
    yield from ["| name | what it is | described at |", "|---|---|---|"]
    for name in gazempc.__all__:
        value = getattr(gazempc, name)
        first = re.split(r"[.;:](?:\s|$)", inspect.getdoc(value) or "")[0]
        role = "class" if isinstance(value, type) else "func"
        yield f"| `gz.{name}` | {first} | {{py:{role}}}`{value.__module__}.{value.__qualname__}` |"


def expand(app: object, name: str, source: list[str]) -> None:
    """Put the tables in place of the blocks of a page."""

    def made(block: re.Match[str]) -> str:
        model, *beside = (resolve_name(":".join(place.rsplit(".", 1))) for place in block.groups() if place)
        return "\n".join(markdown(model, *beside))

    source[0] = _SETTINGS.sub(made, source[0])
    for kind, rows in (("events", events), ("front_door", front_door)):
        source[0] = source[0].replace(f"```{{{kind}}}\n```", "\n".join(rows()))


def setup(app: Sphinx) -> dict[str, Any]:
    """Expand before a page is parsed."""
    app.connect("source-read", expand)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
