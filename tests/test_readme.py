"""The README's commands are those that CI runs."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def shell_blocks():
    return re.findall(r"```sh\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL)


def test_ci_runs_both_commands_of_the_readme():
    main_job, tests, *_ = (block.strip() for block in shell_blocks())
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert main_job in script
    assert tests in script


def test_every_file_the_readme_points_to_is_there():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    targets = [t for t in re.findall(r"\]\(([^)#]+)", text) if not t.startswith("http")]
    assert len(targets) >= 5
    for target in targets:
        assert (ROOT / target).is_file(), target
