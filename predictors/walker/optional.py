"""Compiled code where numba is installed."""

from __future__ import annotations

import importlib
from functools import cache
from types import ModuleType


@cache
def compiled() -> ModuleType | None:
    """`predictors.walker.compiled`, loaded at the first call: numba takes a third of a second.

    Returns:
        The module, or None without numba: then numpy does the same.
    """
    try:
        return importlib.import_module("predictors.walker.compiled")
    except (ImportError, RuntimeError):  # RuntimeError: numba finds no place for what it compiled
        return None
