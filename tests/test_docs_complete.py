"""Parts are documented on their pages, and names on the pages exist."""

import contextlib
import functools
import importlib
import re
from dataclasses import fields

import pytest
from builders.pages import DOCS, ROOT, page
from pydantic import BaseModel

import gazempc
from gazempc.neck.spec import Axis, Eyes, Geometry, NeckSpec, neck_names
from gazempc.parts import CONTROLLER, PREDICTOR, ROBOT, SOURCE
from gazempc.recordings.readers.table import shipped_mappings
from gazempc.recordings.readers.tables.body_poses import AXES
from gazempc.recordings.readers.tables.mapping import COLUMNS, ColumnMapping
from gazempc.recordings.readers.tables.values import TIMES_S
from gazempc.results.attention import AttentionMetrics
from gazempc.results.log import Fault, Log, RunInfo
from gazempc.results.metrics import Metrics
from gazempc.results.run_summary import ComputeMetrics
from gazempc.sim.sensor import SensorSpec, sensor_names


def settings_of(*models, prefix=""):
    return [f"{prefix}{name}" for model in models for name in model.model_fields]


def setting_names(model, prefix=""):
    """Dotted names of the fields, those of tables within."""
    for name, field in model.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from setting_names(field.annotation, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}"


# Settings, events and public names are generated from the code: see test_generated_tables.py.
DESCRIBED = {
    "recordings": [*COLUMNS, "index.csv"],
    "formats": [*shipped_mappings(), *ColumnMapping.model_fields, *AXES, *TIMES_S],
    "necks": [*neck_names(), *settings_of(NeckSpec, Geometry, Axis, Eyes)],
    "trackers": [*sensor_names(), *setting_names(SensorSpec)],
    "predictors": PREDICTOR.shipped,
    "metrics": [f.name for model in (Metrics, AttentionMetrics, ComputeMetrics, Log, Fault) for f in fields(model)]
    + ["gap_closed", *RunInfo.model_fields],
    "own_parts": [name for kind in (PREDICTOR, CONTROLLER, ROBOT, SOURCE) for name in kind.members],
}


@pytest.mark.parametrize("name", sorted(DESCRIBED))
def test_every_part_and_file_is_documented(name):
    described = set(re.findall(r"`\[?([^`\n]+?)\]?`", page(name)))
    if name == "necks":
        described |= {"pan", "tilt", "geometry", "eyes", "body"}
        assert "`[pan]` and `[tilt]`" in page(name)
    assert set(DESCRIBED[name]) - described == set()


def test_the_architecture_page_lists_existing_modules():
    """Each listed folder and module exists, and each folder and module of the root is listed."""
    named = set(re.findall(r"`((?:gazempc|predictors|experiments)/[\w/]*(?:\.py)?)`", page("architecture")))
    assert [path for path in named if not (ROOT / path).exists()] == []
    for package in ("gazempc", "predictors"):
        inside = [path for path in (ROOT / package).iterdir() if path.is_dir() or path.suffix == ".py"]
        existing = {f"{package}/{path.name}/" if path.is_dir() else f"{package}/{path.name}" for path in inside}
        assert existing - named - {f"{package}/__init__.py", f"{package}/__pycache__/"} == set()


def names_of_code(text):
    """Files, and dotted names of modules and their attributes, in inline code."""
    files = re.findall(r"`((?:gazempc|predictors|experiments|benchmarks|tests|examples)(?:/[\w.]+)+/?)`", text)
    return files, re.findall(r"`((?:gazempc|predictors|experiments|benchmarks)(?:\.\w+)+)", text)


def exists(dotted):
    """Whether a dotted name is a module, or an attribute of one."""
    parts = dotted.split(".")
    for count in range(len(parts), 0, -1):
        path = ROOT.joinpath(*parts[:count])
        if path.is_dir() or path.with_suffix(".py").is_file():
            found = importlib.import_module(".".join(parts[:count]))
            with contextlib.suppress(AttributeError):
                return functools.reduce(getattr, parts[count:], found) is not None
            return False
    return False


def test_names_of_code_on_the_pages_exist():
    paths = [*sorted(DOCS.rglob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
    named = [(path.name, names_of_code(path.read_text(encoding="utf-8"))) for path in paths]
    assert [(where, file) for where, (files, _) in named for file in files if not (ROOT / file).exists()] == []
    assert [(where, name) for where, (_, names) in named for name in names if not exists(name)] == []


def test_public_modules_are_in_the_api():
    pages = [path.read_text(encoding="utf-8") for path in sorted((DOCS / "api").glob("*.md"))]
    described = re.findall(r"^   ([\w.]+)$", "\n".join(pages), re.MULTILINE)
    assert len(described) == len(set(described))
    for path in described:
        assert (ROOT / f"{path.replace('.', '/')}.py").is_file(), path
    places = {
        place.partition(":")[0] for kind in (PREDICTOR, CONTROLLER, ROBOT, SOURCE) for place in kind.shipped.values()
    }
    places |= {"gazempc.errors"} | {module for module, _ in gazempc._PLACES.values()} - {"predictors"}
    assert places - set(described) == set()
