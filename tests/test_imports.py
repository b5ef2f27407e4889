"""Dependencies follow the data flow: the import graph is read from the source."""

import ast
import subprocess
import sys
from collections import deque
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("predictors", "gazempc", "experiments")

# Layers of each package: no module imports a later line or a neighbour in its line. Results need neither robots nor
# a loop, so these follow them.
GAZEMPC = (
    ("errors", "types", "signals"),
    ("files",),
    ("specfiles", "parts", "command"),
    ("recordings", "neck", "ros2", "part_options"),
    ("settings",),
    ("results",),
    ("export",),
    ("robots", "controllers", "people"),
    ("loop",),
    ("margins",),
    ("sim",),
    ("live",),
    ("identify",),
    ("front", "run_settings"),
    ("run",),
    ("__init__",),
)
EXPERIMENTS = (
    ("pages", "plots"),
    ("engine", "aggregate"),
    ("forecast",),
    (
        "compare",
        "bound",
        "fronts",
        "sweep",
        "fit",
        "rivals",
        "paper",
        "people",
        "eyes",
        "swing",
    ),
    ("__init__", "console"),
)


def source_files():
    """All modules by name."""
    found = {}
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


FILES = source_files()


@cache
def imports_of_all():
    """Project modules imported by each module; a function, because every test process imports this file."""
    return {name: imports_in(ast.parse(path.read_text(encoding="utf-8"))) for name, path in FILES.items()}


def imports_in(tree):
    """`from a import b` is `a.b` where that is a module; imports in functions count, too."""
    imports, nodes = set(), deque([tree])
    while nodes:
        node = nodes.popleft()
        if isinstance(node, ast.Import):
            imports.update(alias.name for alias in node.names if alias.name in FILES)
        elif isinstance(node, ast.ImportFrom):
            inner = [f"{node.module}.{alias.name}" for alias in node.names]
            imports.update(name if name in FILES else node.module for name in inner if node.module in FILES)
        else:  # a statement; there are no imports in expressions
            nodes.extend(inner for inner in ast.iter_child_nodes(node) if not isinstance(inner, ast.expr))
    return imports


def circle_in(imports):
    """One cycle of modules, or None."""
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        return error.args[1]
    return None


def imports_back_up(package, order, imports):
    """Imports, as `importer -> imported`, of a later line of the order, or of a neighbour in the same one."""
    rank = {part: k for k, line in enumerate(order) for part in line}
    back = []
    for name, found in imports.items():
        for other in found:
            importer, imported = part_of(name, package), part_of(other, package)
            if importer and imported and importer != imported and rank[imported] >= rank[importer]:
                back.append(f"{name} -> {other}")
    return sorted(back)


def part_of(name, package):
    """The folder or file of a package that contains a module; the package itself is its public interface."""
    top, _, rest = name.partition(".")
    return (rest.split(".")[0] or "__init__") if top == package else None


def test_the_import_graph_is_acyclic():
    assert circle_in(imports_of_all()) is None


@pytest.mark.parametrize("importer", PACKAGES[:-1])
def test_packages_depend_in_one_direction(importer):
    later = PACKAGES[PACKAGES.index(importer) + 1 :]
    wrong = [
        f"{n} -> {o}"
        for n, found in imports_of_all().items()
        for o in found
        if n.startswith(importer) and o.startswith(later)
    ]
    assert wrong == []


@pytest.mark.parametrize(("package", "order"), [("gazempc", GAZEMPC), ("experiments", EXPERIMENTS)])
def test_modules_do_not_import_later_layers_of_their_package(package, order):
    listed = {part for line in order for part in line}
    assert {part_of(name, package) for name in FILES} - {None} == listed
    assert imports_back_up(package, order, imports_of_all()) == []


def test_importing_has_no_side_effects_and_loads_no_heavy_library():
    """Importing prints nothing, writes nothing, and imports neither matplotlib nor control."""
    code = (
        "import sys, gazempc, predictors, experiments, gazempc.run, gazempc.settings;"
        "heavy = {'matplotlib', 'control', 'filterpy'} & set(sys.modules); print(sorted(heavy))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    assert done.stderr == ""
