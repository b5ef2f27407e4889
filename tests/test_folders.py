"""The first line of each folder says its subject and what it may import; its modules keep to that."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = sorted(
    str(path.parent.relative_to(ROOT)).replace("/", ".")
    for package in ("predictors", "gazempc", "experiments", "benchmarks")
    for path in (ROOT / package).rglob("__init__.py")
)
# Small modules that all of gazempc builds on.
EVERYBODY_MAY = {
    f"gazempc.{name}"
    for name in (
        "errors",
        "types",
        "progress",
        "files",
        "specfiles",
        "parts",
        "part_options",
        "settings",
        "command",
        "signals",
    )
}


def part_of(module):
    """The part of the project that a module is in: `gazempc.neck` of `gazempc.neck.spec`."""
    return ".".join(module.split(".")[: 2 if module.startswith(("gazempc.", "experiments.")) else 1])


def exists(name):
    """Whether it is a module or a folder of modules."""
    path = ROOT / name.replace(".", "/")
    return path.is_dir() or path.with_suffix(".py").is_file()


@cache
def stated(folder):
    """What the first line says that the folder may import."""
    first = (ROOT / folder.replace(".", "/") / "__init__.py").read_text(encoding="utf-8").splitlines()[0]
    found = re.fullmatch(r'"""[A-Z].+\. May import ([^.]+(?:\.\w+[^.]*)*)\.(?:""")?', first)
    assert found, f"{folder}: {first}"
    names = re.findall(r"[\w.]+", re.sub(r"\band\b|nothing of gazempc|only|all packages", "", found[1]))
    return {name if exists(name) else f"gazempc.{name}" for name in names}


def allowed(folder):
    """What the folder may import, with what those may; a folder inside a part may what the part may."""
    found, waiting = {part_of(folder)}, {folder, part_of(folder)}
    while waiting:
        new = {part_of(name) for name in stated(waiting.pop())} - found
        found |= new
        waiting |= {name for name in new if name in FOLDERS}
    return found


def imported(folder):
    """Parts of the project that the modules of a folder import, the front doors apart."""
    for path in (ROOT / folder.replace(".", "/")).glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module in FOLDERS:
                yield from (part_of(f"{node.module}.{alias.name}") for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module and part_of(node.module).split(".")[0] in FOLDERS:
                yield part_of(node.module)


@pytest.mark.parametrize("folder", [folder for folder in FOLDERS if folder.startswith(("gazempc.", "predictors"))])
def test_a_folder_imports_what_its_first_line_says(folder):
    assert set(imported(folder)) - allowed(folder) - EVERYBODY_MAY == set()


@pytest.mark.parametrize("folder", FOLDERS)
def test_the_first_line_says_what_a_folder_may_import(folder):
    assert [name for name in stated(folder) if not exists(name)] == []
