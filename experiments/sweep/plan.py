"""Read a sweep file and check everything that can be checked before anything runs."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydantic import ValidationError

from experiments.engine.recordings import find_recordings
from experiments.sweep.designs import Point, case_seed, design_points, point_at
from experiments.sweep.spec import LABELS, Case, SweepSpec, lines_of
from experiments.sweep.variants import resolve
from gazempc.errors import GazempcError, SettingsError, suggest
from gazempc.recordings.load import load
from gazempc.recordings.readers.options import ReadOptions

# An optuna design has no points yet; so many random ones stand for them in the check.
_PROBES = 64


@dataclass(frozen=True)
class Walk:
    """A recording that has been read once.

    Attributes:
        name: Its name in tables.
        path: Synthetic name or absolute path.
        digest: Hash of the file's bytes; empty for a synthetic one.
        subject: Who walks.
        group: Kind of walk.
    """

    name: str
    path: str
    digest: str
    subject: str
    group: str | None

    @property
    def is_synthetic(self) -> bool:
        """Whether it is one of the generated walks."""
        return not self.digest


@dataclass(frozen=True)
class SweepPlan:
    """A checked sweep.

    Attributes:
        spec: What the file says.
        walks: The recordings.
        points: Points of each case by its name; empty for an optuna design, whose points depend on results.
    """

    spec: SweepSpec
    walks: tuple[Walk, ...]
    points: dict[str, list[Point]]


def shipped_studies() -> dict[str, Path]:
    """The studies that ship with the package, by name."""
    folder = Path(str(files("experiments").joinpath("studies")))
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def load_plan(
    name_or_path: str | Path, recordings: Sequence[str] | None = None, fitted: Path | None = None
) -> SweepPlan:
    """Read and check a sweep file.

    Args:
        name_or_path: YAML file or name of a shipped study.
        recordings: Recordings to use in place of the file's.
        fitted: Model or models of the predictor `walker` to use in place of the file's.

    Returns:
        The plan.

    Raises:
        SettingsError: With all that is wrong with the file and its recordings, one line each.
    """
    path = _find(name_or_path)
    data = _read(path)
    if fitted is not None and isinstance(data.get("base", {}), dict):
        data["base"] = {**data.get("base", {}), "walker.fitted": str(fitted)}
    problems = _relations(data)
    spec: SweepSpec | None = None
    try:
        spec = SweepSpec.model_validate(data)
    except ValidationError as error:
        problems = lines_of(error, SweepSpec) + problems
    words = recordings or data.get("recordings", ["synthetic"])
    walks: tuple[Walk, ...] = ()
    if isinstance(words, (list, tuple)) and words and all(isinstance(word, str) for word in words):
        reading = {n.removeprefix("reading."): v for n, v in (spec.base if spec else {}).items() if "reading." in n}
        walks, unreadable = _read_all(words, ReadOptions(**reading))
        problems += [f"recordings: {problem}" for problem in unreadable]
    points: dict[str, list[Point]] = {}
    if spec is not None and not problems:
        spec = spec.model_copy(update={"recordings": tuple(words)})
        for case in spec.all_cases():
            points[case.name] = [] if case.design == "optuna" else design_points(case, spec.seed)
            problems += _unresolvable(case, points[case.name] or _probes(case, spec.seed))
    if problems or spec is None:
        raise SettingsError("\n".join(f"{path}: {problem}" for problem in dict.fromkeys(problems)))
    return SweepPlan(spec, walks, points)


def _find(name_or_path: str | Path) -> Path:
    path, shipped = Path(name_or_path), shipped_studies()
    if path.is_file():
        return path
    if str(name_or_path) in shipped:
        return shipped[str(name_or_path)]
    raise SettingsError(f"{path}: no such sweep file or shipped study; {suggest(path.stem, shipped)}")


def _read(path: Path) -> dict[str, Any]:
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except UnicodeDecodeError:
        raise SettingsError(f"{path}: not a text file") from None
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read: {error.strerror}") from None
    except yaml.YAMLError as error:
        raise SettingsError(f"{path}: not valid YAML: {error}") from None
    if not isinstance(data, dict):
        raise SettingsError(f"{path}: expected a mapping with name, base and vary, got {data!r}")
    return data


def _relations(data: dict[str, Any]) -> list[str]:
    # What depends on several keys; on the raw content, so that it is said together with what is wrong in each.
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


def _read_all(words: Sequence[str], reading: ReadOptions) -> tuple[tuple[Walk, ...], list[str]]:
    problems: list[str] = []
    found: list[str] = []
    for word in words:
        try:
            found += find_recordings([word])
        except GazempcError as error:
            problems += str(error).splitlines()
    walks = []
    for name in dict.fromkeys(found):
        path = Path(name)
        try:
            recording = load(name, reading)
        except GazempcError as error:
            problems.append(str(error))
            continue
        on_disk = path.is_file()
        digest = hashlib.sha256(path.read_bytes()).hexdigest() if on_disk else ""
        place = str(path.resolve()) if on_disk else name
        walks.append(Walk(path.stem, place, digest, recording.labels.subject, recording.labels.group))
    return tuple(walks), problems


def _probes(case: Case, seed: int) -> list[Point]:
    draws = np.random.default_rng(case_seed(case, seed)).random((_PROBES, len(case.vary)))
    return [point_at(case.vary, draw) for draw in draws]


def _unresolvable(case: Case, points: Iterable[Point]) -> list[str]:
    problems = []
    for point in points:
        try:
            resolve({**case.base, **point})
        except SettingsError as error:
            problems += [f"case {case.name}: {line}" for line in str(error).splitlines()]
    return problems
