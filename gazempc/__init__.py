"""Predictive gaze for robots: forecast a head, plan the neck over it, measure the gaze. May import predictors.

    import gazempc as gz

    log = gz.replay("subject03_R4", controller="mpc", predictor="walker")
    print(gz.measure(log).gaze_error_rms_deg)

Each name below is imported when it is first used, so that `import gazempc` is fast.
"""

from __future__ import annotations

import importlib
import logging
import pkgutil
import re
from typing import Any

# Module and attribute of each public name. The stub is the only list, and type checkers read it, too.
_STUB = (pkgutil.get_data(__name__, "__init__.pyi") or b"").decode()
_PLACES = {
    name: (module, there) for module, there, name in re.findall(r"^from (\S+) import (\w+) as (\w+)", _STUB, re.M)
}

__all__ = list(_PLACES)

# A library does not print: log lines go where the program configures logging.
logging.getLogger("gazempc").addHandler(logging.NullHandler())


def __getattr__(name: str) -> Any:
    """Import a public name on first use."""
    if name not in _PLACES:
        raise AttributeError(f"module 'gazempc' has no attribute {name!r}; it offers {', '.join(__all__)}")
    module, there = _PLACES[name]
    value = getattr(importlib.import_module(module), there)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names."""
    return sorted(__all__)
