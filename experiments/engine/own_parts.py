"""Parts of the user's own in experiments: the program that does them, and their names in tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from experiments.engine.job import Row
from experiments.engine.keys import module_hash
from gazempc.part_options import check_options, options_for
from gazempc.parts import CONTROLLER, PREDICTOR, Kind, find, is_own


def parts_hash(controller: str, predictor: str) -> list[str]:
    """What the user's own parts of a run depend on.

    Args:
        controller: A shipped name, or ``module:Class``.
        predictor: The same.

    Returns:
        A hash for each that is the user's own: of its module, or of its whole package.

    Raises:
        SettingsError: If one cannot be imported.
    """
    return [_hash(kind, part) for kind, part in ((CONTROLLER, controller), (PREDICTOR, predictor)) if is_own(part)]


def check_parts(controllers: Iterable[str], predictors: Iterable[str], options: Mapping[str, Any]) -> None:
    """Check before anything runs that parts of the user's own can be imported, and that each option is for one.

    Args:
        controllers: Shipped names, or ``module:Class``.
        predictors: The same.
        options: Values by parameter, see `gazempc.part_options.options_for`.

    Raises:
        SettingsError: If not.
    """
    parts = [*((CONTROLLER, choice) for choice in controllers), *((PREDICTOR, choice) for choice in predictors)]
    for kind, choice in parts:
        if is_own(choice):
            find(kind, choice)
    check_options(parts, options)


def options_of(controller: str, predictor: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """The options that are for one of two parts: no other option makes it another run.

    Args:
        controller: A shipped name, or ``module:Class``.
        predictor: The same.
        options: Options of all parts.

    Returns:
        Values by ``kind.parameter``.
    """
    return {
        f"{kind.name}.{name}": value
        for kind, choice in ((CONTROLLER, controller), (PREDICTOR, predictor))
        for name, value in options_for(kind, choice, options).items()
    }


def name_parts(rows: Iterable[Row], part: str) -> None:
    """Put the names that parts have into rows, in place of ``module:Class``.

    Two parts of the same name keep ``module:Class``, to be told apart.

    Args:
        rows: Rows with a choice under `part` if it matters, and the part's name under ``<part>_name`` if the run is
            done; the latter is taken out.
        part: ``controller`` or ``predictor``.
    """
    rows = list(rows)
    given = [(row, row.pop(f"{part}_name", None)) for row in rows]
    names = {row[part]: name for row, name in given if name is not None and part in row}
    taken = Counter(names.values())
    for row in (row for row in rows if part in row):
        name = names.get(row[part], row[part])
        if taken[name] == 1:
            row[part] = name


def _hash(kind: Kind, choice: str) -> str:
    find(kind, choice)
    module = choice.partition(":")[0]
    # A package may do its work in any of its modules. What they import from elsewhere is not seen.
    return module_hash(module.partition(".")[0])
