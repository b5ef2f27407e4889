"""Each example runs from any folder and prints the output in its last comment."""

import json
import re
import runpy
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

from experiments.forecast.command import main as forecast

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
ROBOTS = sorted((ROOT / "examples" / "robots").glob("*.py"))
_MARK = "# It prints:\n"


def promised(text):
    """The output stated in the last comment of an example."""
    assert text.count(_MARK) == 1
    return "".join(f"{line[2:]}\n" for line in text.split(_MARK)[1].splitlines())


@contextmanager
def suppress_exit_0():
    """A program may end by `sys.exit(0)`."""
    try:
        yield
    except SystemExit as end:
        if end.code != 0:
            raise


@pytest.mark.slow
@pytest.mark.parametrize("path", [*EXAMPLES, *ROBOTS], ids=lambda path: path.stem)
def test_the_output_of_an_example_is_that_in_its_last_comment(path, tmp_path, monkeypatch, capsys, in_this_process):
    """Run as a program from its folder, but in this process, so that libraries are loaded once."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(path)])
    monkeypatch.syspath_prepend(path.parent)
    monkeypatch.setitem(sys.modules, path.stem, None)  # removed after the test, as an example may import itself
    del sys.modules[path.stem]
    with suppress_exit_0():
        runpy.run_path(str(path), run_name="__main__")
    printed = capsys.readouterr()
    assert printed.err == ""
    assert printed.out == promised(path.read_text(encoding="utf-8"))


def test_the_examples_are_few_and_short():
    assert 6 <= len(EXAMPLES) <= 12
    for path, most in [*((path, 60) for path in EXAMPLES), *((path, 25) for path in ROBOTS)]:
        assert len(path.read_text(encoding="utf-8").split(_MARK)[0].splitlines()) <= most, path.name


def test_the_readme_shows_the_numbers_that_each_robot_prints():
    """A row for each script, with numbers of its output."""
    rows = [
        line for line in (ROOT / "README.md").read_text(encoding="utf-8").splitlines() if "examples/robots/" in line
    ]
    assert len(rows) == len(ROBOTS)
    for path in ROBOTS:
        (row,) = (row for row in rows if f"(examples/robots/{path.name})" in row)
        numbers = re.findall(r"\d+\.\d+ deg|\d+ ?%", row)
        printed = promised(path.read_text(encoding="utf-8")).replace(" %", "%")
        assert numbers
        assert [number for number in numbers if number.replace(" %", "%") not in printed] == [], path.name


@pytest.mark.slow
def test_a_user_defined_predictor_is_benchmarked(tmp_path, monkeypatch, in_this_process):
    """By the command of the page on few people: a module in the working directory, ten lines in its methods."""
    monkeypatch.chdir(ROOT / "examples")
    monkeypatch.syspath_prepend(ROOT / "examples")
    words = ["--recordings", "subject03_R1", "subject03_stand", "--horizons", "0.5", "--jobs", "1"]
    entries = ["--predictors", "last_position", "constant_velocity", "outside_predictor:FadingVelocity"]
    assert forecast([*words, *entries, "--out", str(tmp_path)]) == 0
    rows = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))["rows"]
    own = {row["group"]: row for row in rows if row["predictor"] == "fading_velocity" and row["kind"] == "all"}
    # Between the two: worse than constant velocity on walks, worse than last position on standing people.
    assert own["straight"]["ratio_to_last_position"] < 1.0 < own["straight"]["ratio_to_constant_velocity"]
    assert own["standing"]["ratio_to_constant_velocity"] < 1.0 < own["standing"]["ratio_to_last_position"]


def test_every_example_is_shown_in_the_documentation():
    page = (ROOT / "docs" / "examples.md").read_text(encoding="utf-8")
    shown = re.findall(r"^```\{literalinclude\} \.\./examples/(.*)$", page, re.MULTILINE)
    assert sorted(shown) == sorted(str(path.relative_to(ROOT / "examples")) for path in [*EXAMPLES, *ROBOTS])


def test_every_example_has_a_thumbnail_in_the_gallery():
    """The build of the pages draws those that `gallery.py` names."""
    page = (ROOT / "docs" / "examples.md").read_text(encoding="utf-8")
    drawn = (ROOT / "docs" / "extensions" / "gallery.py").read_text(encoding="utf-8")
    names = [path.stem for path in [*EXAMPLES, *ROBOTS]]
    assert [name for name in names if f":img-top: _thumbnails/{name}.png\n" not in page] == []
    assert [name for name in names if f'    "{name}": thumbnails.' not in drawn] == []
