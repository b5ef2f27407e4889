"""Forecasts of a walking person's head: one method a file. May import nothing of gazempc.

Each name is imported when it is first used: SciPy, which most of them need, takes a third of a second.
"""

from __future__ import annotations

import importlib
import pkgutil
import re
from typing import Any

# Module of each name. The stub is the only list, and type checkers read it, too.
_STUB = (pkgutil.get_data(__name__, "__init__.pyi") or b"").decode()
_PLACES = {name: module for module, name in re.findall(r"^from (\S+) import (\w+)", _STUB, re.M)}

__all__ = list(_PLACES)


def __getattr__(name: str) -> Any:
    """Import a name when it is first used."""
    if name not in _PLACES:
        raise AttributeError(f"module 'predictors' has no attribute {name!r}; it offers {', '.join(__all__)}")
    value = getattr(importlib.import_module(_PLACES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The names of the package."""
    return sorted(__all__)
