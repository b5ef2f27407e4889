"""Dependencies point one way: predictors <- gazempc <- experiments; figures never see the loop."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FORBIDDEN = {"predictors": {"gazempc", "experiments"}, "gazempc": {"experiments"}}
READERS_OF_LOGS = ("plots", "overview", "animation", "metrics", "report", "smoothness")
# What makes a run; whoever reads logs must not need it.
RUNS = {"loop", "loop_recorder", "replay", "smoother", "robots", "controllers", "servo"}


def imported_modules(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            module = node.module or ""
            found |= {module} | {f"{module}.{alias.name}" for alias in node.names}
    return found


@pytest.mark.parametrize("package", sorted(FORBIDDEN))
def test_dependencies_point_one_way(package):
    for path in (ROOT / package).rglob("*.py"):
        tops = {name.split(".")[0] for name in imported_modules(path)}
        assert not tops & FORBIDDEN[package], path


def test_metrics_and_figures_read_logs_only():
    for name in READERS_OF_LOGS:
        path = ROOT / "gazempc" / f"{name}.py"
        parts = {m.split(".")[1] for m in imported_modules(path) if m.startswith("gazempc.")}
        assert not parts & RUNS, path


def test_importing_has_no_side_effects_and_is_quick_to_name_what_it_needs():
    """Importing prints nothing, writes nothing and leaves matplotlib and control alone."""
    code = (
        "import sys, gazempc, predictors, experiments, gazempc.run, gazempc.settings;"
        "heavy = {'matplotlib', 'control', 'filterpy'} & set(sys.modules); print(sorted(heavy))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    assert done.stderr == ""
