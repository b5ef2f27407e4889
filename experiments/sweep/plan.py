"""Load and validate a sweep file before any run."""

from __future__ import annotations

import itertools
import math
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from experiments.engine.command import check_parts, find_recordings, in_place, labels_of
from experiments.sweep.names import OPTION, resolve, setting_fields
from experiments.sweep.spec import Case, Range, SweepSpec
from gazempc.errors import GazempcError, SettingsError, shown, suggest
from gazempc.files.bounds import is_there
from gazempc.files.documents import parse_yaml, read_settings
from gazempc.recordings.load import load
from gazempc.recordings.readers.options import ReadOptions
from gazempc.settings import DEFAULT_PREDICTOR
from gazempc.specfiles import explain
from gazempc.types import FloatArray


@dataclass(frozen=True)
class Walk:
    """Labels of a recording.

    Attributes:
        name: Name in tables.
        path: Synthetic name or absolute path.
        subject: Name of the person.
        group: Kind of walk.
        is_synthetic: Whether the walk is synthetic.
    """

    name: str
    path: str
    subject: str
    group: str | None
    is_synthetic: bool


def read_walks(words: Sequence[str], reading: ReadOptions) -> tuple[tuple[Walk, ...], list[str]]:
    """Load the labels of recordings.

    Args:
        words: See `experiments.engine.command.find_recordings`.
        reading: Options for reading the files.

    Returns:
        The walks, and one error message for each other recording.
    """
    problems, walks, names = list[str](), [], list[str]()
    try:
        names = find_recordings(words)
    except GazempcError as error:
        problems = str(error).splitlines()
    for name, label in zip(names, labels_of(names), strict=True):
        try:
            recording = load(name, reading)
        except GazempcError as error:
            problems.append(str(error))
            continue
        labels = recording.labels
        walks.append(Walk(label, in_place(name), labels.subject, labels.group, recording.kind == "synthetic"))
    return tuple(walks), problems


Point = dict[str, Any]


def design_points(case: Case, seed: int) -> list[Point]:
    """Points of a grid, random or sobol design.

    Args:
        case: A complete case (`experiments.sweep.spec.SweepSpec.all_cases`).
        seed: Seed of the design, combined with the case's name.

    Returns:
        Values of the varied settings, by dotted name; deterministic, and nested: a larger ``n`` only adds points.
    """
    if case.design == "grid":
        return [dict(zip(case.vary, values, strict=True)) for values in itertools.product(*case.vary.values())]
    rng = np.random.default_rng(case_seed(case, seed))
    size = (case.n or 0, len(case.vary))
    if case.design == "random":
        draws = rng.random(size)
    else:
        from scipy.stats import qmc  # noqa: PLC0415  (slow to import, and no other design needs it)

        # A power of two, for which the sequence is balanced, truncated to n.
        draws = qmc.Sobol(size[1], rng=rng).random_base2(math.ceil(math.log2(max(size[0], 1))))[: size[0]]
    return [point_at(case.vary, row) for row in draws]


def case_seed(case: Case, seed: int) -> list[int]:
    """Seed of a case's design."""
    return [seed, zlib.crc32(case.name.encode())]


def point_at(vary: Mapping[str, Any], draw: FloatArray) -> Point:
    """Map the unit cube to a point of the design.

    Args:
        vary: Range or choices of each setting.
        draw: Coordinates, shape (len(vary),), each in [0, 1).

    Returns:
        Value by dotted name.
    """
    return {name: _value(name, entry, float(u)) for (name, entry), u in zip(vary.items(), draw, strict=True)}


def is_whole(name: str, entry: Range) -> bool:
    """Whether a range is integer-valued."""
    return entry.integer or setting_fields()[name].annotation is int


def _value(name: str, entry: Any, u: float) -> Any:
    if not isinstance(entry, Range):
        return entry[int(u * len(entry))]
    whole = is_whole(name, entry)
    # Equal probability of all integers, the ends included.
    low, high = (entry.low, entry.high + 1.0) if whole else (entry.low, entry.high)
    value = low * (high / low) ** u if entry.log else low + u * (high - low)
    return min(math.floor(value), int(entry.high)) if whole else min(value, entry.high)


# Number of random points by which an Optuna design is validated.
_PROBES = 64
# Maximum number of points, as for a random design.
_MOST_POINTS = 100_000


@dataclass(frozen=True)
class SweepPlan:
    """A validated sweep.

    Attributes:
        spec: Content of the file.
        walks: The recordings.
        points: Points by name of the case; empty for an Optuna design, whose points depend on results.
    """

    spec: SweepSpec
    walks: tuple[Walk, ...]
    points: dict[str, list[Point]]


def shipped_studies() -> dict[str, Path]:
    """Files of the shipped studies, by name."""
    folder = Path(str(files("experiments").joinpath("studies")))
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def load_plan(
    name_or_path: str | Path, recordings: Sequence[str] | None = None, fitted: Path | None = None
) -> SweepPlan:
    """Load and validate a sweep file.

    Args:
        name_or_path: YAML file or name of a shipped study.
        recordings: Recordings that override the file's.
        fitted: Model or models of the predictor `walker` that override the file's.

    Returns:
        The plan.

    Raises:
        SettingsError: With all errors of the file and its recordings, one line each.
    """
    path = _find(name_or_path)
    data = _read(path)
    if fitted is not None and isinstance(data.get("base", {}), dict):
        data["base"] = {**data.get("base", {}), "walker.fitted": str(fitted)}
    problems: list[str] = []
    spec: SweepSpec | None = None
    try:
        spec = SweepSpec.model_validate(data)
    except ValidationError as error:
        problems = [line.removeprefix(f"{path}: ") for line in explain(error, str(path), SweepSpec).splitlines()]
    words = recordings or data.get("recordings", ["synthetic"])
    walks: tuple[Walk, ...] = ()
    if isinstance(words, (list, tuple)) and words and all(isinstance(word, str) for word in words):
        reading = {n.removeprefix("reading."): v for n, v in (spec.base if spec else {}).items() if "reading." in n}
        walks, unreadable = read_walks(words, ReadOptions(**reading))
        problems += [f"recordings: {problem}" for problem in unreadable]
    points: dict[str, list[Point]] = {}
    if spec is not None and not problems:
        spec = spec.model_copy(update={"recordings": tuple(words)})
        for case in spec.all_cases():
            if case.design == "grid" and (count := math.prod(map(len, case.vary.values()))) > _MOST_POINTS:
                problems.append(f"case {case.name}: a grid of {count} points; at most {_MOST_POINTS} are accepted")
                continue
            points[case.name] = [] if case.design == "optuna" else design_points(case, spec.seed)
            problems += _unresolvable(case, points[case.name] or _probes(case, spec.seed))
    if problems or spec is None:
        raise SettingsError("\n".join(f"{path}: {problem}" for problem in dict.fromkeys(problems)))
    return SweepPlan(spec, walks, points)


def _find(name_or_path: str | Path) -> Path:
    path, shipped = Path(name_or_path), shipped_studies()
    if is_there(path):
        return path
    if str(name_or_path) in shipped:
        return shipped[str(name_or_path)]
    raise SettingsError(f"{path}: no such sweep file or shipped study; {suggest(path.stem, shipped)}")


def _read(path: Path) -> dict[str, Any]:
    data = parse_yaml(read_settings(path), str(path))
    if not isinstance(data, dict):
        raise SettingsError(f"{path}: expected a mapping with name, base and vary, got {shown(data)}")
    return data


def _probes(case: Case, seed: int) -> list[Point]:
    draws = np.random.default_rng(case_seed(case, seed)).random((_PROBES, len(case.vary)))
    return [point_at(case.vary, draw) for draw in draws]


def _unresolvable(case: Case, points: Iterable[Point]) -> list[str]:
    problems = []
    values = [{**case.base, **point} for point in points]
    for each in values:
        try:
            resolve(each)
        except SettingsError as error:
            problems += [f"case {case.name}: {line}" for line in str(error).splitlines()]
    try:
        # An option has to apply to at least one point.
        options = {name.removeprefix(OPTION): 0 for each in values for name in each if name.startswith(OPTION)}
        predictors = {each.get("predictor", DEFAULT_PREDICTOR) for each in values}
        check_parts({each["controller"] for each in values if "controller" in each}, predictors, options)
    except SettingsError as error:
        problems += [f"case {case.name}: {line}" for line in str(error).splitlines()]
    return problems
