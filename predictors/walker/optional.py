"""Compiled code where numba is installed."""

from __future__ import annotations

import importlib
from types import ModuleType


def _compiled() -> ModuleType | None:
    try:
        return importlib.import_module("predictors.walker.compiled")
    except (ImportError, RuntimeError):  # RuntimeError: numba finds no place for what it compiled
        return None


# `predictors.walker.compiled`, or None: then numpy does the same.
compiled = _compiled()
