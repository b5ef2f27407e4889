"""The README: CI runs its commands, its Python runs, its links resolve."""

import contextlib
import io
import re
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from experiments.console import COMMANDS
from gazempc.neck.spec import load_neck
from gazempc.sim.simulated import SimulatedNeck

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def test_ci_runs_both_commands_of_the_readme():
    main_job, tests, *_ = (block.strip() for block in blocks("sh"))
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert main_job in script
    assert tests in script


def some_frames():
    """A standing person for a third of a second."""
    for _ in range(10):
        yield SimpleNamespace(time_s=time.time(), head_m=[2.0, 0.2, 0.3])
        time.sleep(1 / 30)


def test_the_python_of_the_readme_runs_and_prints_its_shown_output():
    robot = SimulatedNeck(load_neck("reference"), np.zeros(2), time.monotonic)
    namespace = {"MyRobot": lambda: robot, "tracker": some_frames()}
    (code,) = blocks("python")
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, "README.md", "exec"), namespace)
    lines = printed.getvalue().splitlines()
    assert len(lines) == 2
    assert [line for line in lines if f"`{line}`" not in README] == []
    assert len(namespace["gaze"].log().capture_time_s) > 0


def test_the_readme_names_every_command():
    assert set(COMMANDS) - set(re.findall(r"`(\w+)`", README)) == set()
    assert set(re.findall(r"bin/gazempc (\w+)", README)) <= set(COMMANDS)


def test_every_file_linked_in_the_readme_exists():
    targets = [t for t in re.findall(r"\]\(([^)#]+)", README) if not t.startswith("http")]
    assert len(targets) >= 5
    for target in targets:
        assert (ROOT / target).is_file(), target
