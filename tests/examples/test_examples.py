"""Each example runs from anywhere and prints what stands at its end."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
_MARK = "# It prints:\n"


def promised(text):
    """What an example says that it prints."""
    assert text.count(_MARK) == 1
    return "".join(f"{line[2:]}\n" for line in text.split(_MARK)[1].splitlines())


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_prints_what_it_says(path, tmp_path):
    done = subprocess.run(
        [sys.executable, str(path)],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"},
        check=False,
    )
    assert done.stderr == ""
    assert done.returncode == 0
    assert done.stdout == promised(path.read_text(encoding="utf-8"))


def test_the_examples_are_few_and_short():
    assert 6 <= len(EXAMPLES) <= 10
    for path in EXAMPLES:
        assert len(path.read_text(encoding="utf-8").split(_MARK)[0].splitlines()) <= 60, path.name


def test_every_example_is_shown_in_the_documentation():
    page = (ROOT / "docs" / "examples.md").read_text(encoding="utf-8")
    assert [path.name for path in EXAMPLES if f"../examples/{path.name}\n" not in page] == []
