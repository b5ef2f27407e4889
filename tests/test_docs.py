"""The documentation stays true: its code runs, and what exists is described where it belongs."""

import ast
import contextlib
import io
import re
import tomllib
from dataclasses import fields
from itertools import pairwise
from pathlib import Path
from typing import get_args

import pytest
import yaml

from gazempc.loop import gaze_loop as loop
from gazempc.loop.smoother import Intervention
from gazempc.neck.spec import Axis, Geometry, NeckSpec, neck_names
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.readers.table import COLUMNS
from gazempc.results.compute import ComputeMetrics
from gazempc.results.log import Log
from gazempc.results.metrics import Metrics
from gazempc.settings import (
    ConstantAccelerationSettings,
    ConstantVelocitySettings,
    CoordinatedTurnSettings,
    HeadPoseSettings,
    InteractingModelsSettings,
    LookAheadSettings,
    LoopSettings,
    MpcSettings,
    ParticleSettings,
    PelvisPursuitSettings,
    PredictorName,
    ReplaySettings,
)
from gazempc.sim.sensor import SensorSpec, sensor_names

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(path.stem for path in DOCS.glob("*.md"))
_FENCE = re.compile(r"^```(\S*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def page(name):
    return (DOCS / f"{name}.md").read_text(encoding="utf-8")


def code_blocks(text):
    """Each Python block with its line and, where a text block follows at once, what it must print."""
    fences = [*_FENCE.finditer(text), None]
    for fence, after in pairwise(fences):
        if fence[1] != "python":
            continue
        follows = after is not None and after[1] == "text" and not text[fence.end() : after.start()].strip()
        yield text.count("\n", 0, fence.start()) + 1, fence[2], after[2] if follows else None


@pytest.mark.parametrize("name", [name for name in PAGES if any(code_blocks(page(name)))])
def test_python_blocks_run_and_print_what_the_page_says(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    namespace = {"__name__": "__main__"}
    for line, code, expected in code_blocks(page(name)):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            # Blank lines put an error at its line in the page.
            exec(compile("\n" * line + code, f"docs/{name}.md", "exec"), namespace)
        if expected is not None:
            assert printed.getvalue().strip() == expected.strip(), f"docs/{name}.md, line {line}"


def test_there_is_code_to_run():
    assert sum(1 for name in PAGES for _ in code_blocks(page(name))) >= 15


def test_every_page_is_in_the_toctree():
    entries = [
        line.strip()
        for kind, body in _FENCE.findall(page("index"))
        if kind == "{toctree}"
        for line in body.splitlines()
        if line.strip() and not line.startswith(":")
    ]
    assert sorted(entries) == [name for name in PAGES if name != "index"]


@pytest.mark.parametrize("name", PAGES)
def test_links_between_pages_lead_somewhere(name):
    for target in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", page(name)):
        assert (DOCS / target).is_file(), target


def event_names():
    """Names in the loop's table, in its calls of the recorder, and those that the smoother gives."""
    listed = set(re.findall(r"^``(\w+)``", loop.__doc__, re.MULTILINE))
    source = ast.parse(Path(loop.__file__).read_text(encoding="utf-8"))
    written = {
        node.args[1].value
        for node in ast.walk(source)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr == "event"
        and isinstance(node.args[1], ast.Constant)
    }
    assert written
    return listed | written | {name for name in get_args(Intervention) if name}


def settings_of(*models, prefix=""):
    return [f"{prefix}{name}" for model in models for name in model.model_fields]


DESCRIBED = {
    "quickstart": settings_of(ReplaySettings),
    "recordings": [*settings_of(ReadOptions), *COLUMNS, "index.csv"],
    "necks": [*neck_names(), *sensor_names(), *settings_of(NeckSpec, Geometry, Axis, SensorSpec)],
    "controllers": [*settings_of(MpcSettings, prefix="mpc."), *settings_of(LookAheadSettings, prefix="lookahead.")],
    "predictors": [
        *get_args(PredictorName),
        *settings_of(ConstantVelocitySettings, prefix="constant_velocity."),
        *settings_of(HeadPoseSettings, prefix="head_pose."),
        *settings_of(PelvisPursuitSettings, prefix="pelvis_pursuit."),
        *settings_of(ConstantAccelerationSettings, prefix="constant_acceleration."),
        *settings_of(CoordinatedTurnSettings, prefix="coordinated_turn."),
        *settings_of(InteractingModelsSettings, prefix="interacting_models."),
        *settings_of(ParticleSettings, prefix="particle."),
    ],
    "metrics": [f.name for model in (Metrics, ComputeMetrics, Log) for f in fields(model)] + ["gap_closed"],
    "safety": [*sorted(event_names()), *settings_of(LoopSettings)],
}


@pytest.mark.parametrize("name", sorted(DESCRIBED))
def test_what_exists_is_described(name):
    described = set(re.findall(r"`\[?([^`\n]+?)\]?`", page(name)))
    if name == "necks":
        described |= {"pan", "tilt", "geometry"}
        assert "`[pan]` and `[tilt]`" in page(name)
    assert set(DESCRIBED[name]) - described == set()


def test_modules_that_the_architecture_names_exist():
    named = re.findall(r"`((?:gazempc|predictors)/[\w/]+\.py)`", page("architecture"))
    assert len(named) > 30
    assert [path for path in named if not (ROOT / path).is_file()] == []


def test_public_modules_are_in_the_api():
    for path in re.findall(r"automodule:: (\S+)", page("api")):
        assert (ROOT / f"{path.replace('.', '/')}.py").is_file(), path
    stages = ("recording", "placement", "sensor", "neck", "kinematics", "servo", "smoother", "loop", "replay")
    for name in (*stages, "log", "metrics", "config"):
        assert f"automodule:: gazempc.{name}\n" in page("api")


def test_citation_is_valid_and_of_this_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert citation["cff-version"] == "1.2.0"
    assert citation["title"] == project["name"]
    assert citation["version"] == project["version"]
    assert citation["license"] == project["license"]
    assert {"message", "authors"} <= set(citation)
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## {project['version']} - {citation['date-released']}" in changes
