"""Write specifications as TOML."""

from __future__ import annotations

import json
from collections.abc import Mapping


def as_toml(values: Mapping[str, object]) -> str:
    """Text that `gazempc.specfiles` reads.

    Args:
        values: Numbers, texts, truths and lists; a mapping is a table.

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
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # JSON's escapes are TOML's, but for one character that JSON leaves as it is.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return repr(value)
