"""Checks of a sweep file that depend on several of its keys."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from experiments.sweep.spec import LABELS
from gazempc.errors import suggest


def check_relations(data: dict[str, Any]) -> list[str]:
    """Say what is wrong between the keys of a sweep file.

    Args:
        data: The raw content, so that this is said together with what is wrong in each key.

    Returns:
        What is wrong, a line each.
    """
    problems: list[str] = []
    listed = data.get("cases")
    cases = [case for case in listed if isinstance(case, dict)] if isinstance(listed, list) else []
    if not cases and not _mapping(data.get("vary")):
        problems.append("vary: nothing varies; give vary or cases")
    names = [str(case.get("name")) for case in cases]
    problems += [f"cases: the name {name!r} is used twice" for name in {n for n in names if names.count(n) > 1}]
    varied = set(LABELS)
    for where, part in (("", data), *((f"cases.{i}.", case) for i, case in enumerate(cases))):
        twice = set(_mapping(part.get("base"))) & set(_mapping(part.get("vary")))
        problems += [f"{where}vary: {name} is in base too" for name in sorted(map(str, twice))]
        varied |= set(_mapping(part.get("vary")))
    for i, case in enumerate(cases or [{}]):
        problems += _case_relations(data, case, f"cases.{i}." if cases else "")
    for kind, axes in {"response": (0, 2), "heatmap": (0, 1), "pareto": (2,)}.items():
        drawn = _mapping(data.get("figures")).get(kind)
        for figure in drawn if isinstance(drawn, list) and drawn and isinstance(drawn[0], list) else [drawn]:
            given = [figure[i] for i in axes if i < len(figure)] if isinstance(figure, list) else []
            for name in (str(n) for n in given if n not in varied):
                problems.append(f"figures.{kind}: {name} does not vary; {suggest(name, map(str, varied))}")
    return problems


def _case_relations(data: dict[str, Any], case: dict[str, Any], where: str) -> Iterable[str]:
    base = {**_mapping(data.get("base")), **_mapping(case.get("base"))}
    vary = {**_mapping(data.get("vary")), **_mapping(case.get("vary"))}
    design = case.get("design") or data.get("design", "grid")
    if "controller" not in {**base, **vary}:
        yield f"{where}base: no controller; give it in base or in vary"
    if design == "grid":
        for name in (n for n, entry in vary.items() if isinstance(entry, dict)):
            yield f"{where}vary: {name}: a grid needs a list of values (designs with ranges: random, sobol, optuna)"
    elif design in {"random", "sobol", "optuna"}:
        if (case.get("n") or data.get("n")) is None:
            yield f"{where}n: missing; design {design} needs the number of points"
        if not vary:
            yield f"{where}vary: nothing varies; design {design} needs a setting to vary"


def _mapping(value: Any) -> dict[Any, Any]:
    return value if isinstance(value, dict) else {}
