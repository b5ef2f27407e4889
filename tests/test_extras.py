"""The extra `all` is all that a user can install."""

import tomllib
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
FOR_DEVELOPERS = {"test", "dev", "docs"}


def test_all_names_every_extra_of_users():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    (everything,) = map(Requirement, extras["all"])
    assert everything.name == "gazempc"
    assert everything.extras == set(extras) - FOR_DEVELOPERS - {"all"}


def test_messages_and_pages_name_installs_that_work_from_a_clone():
    """The package is on no index: its name alone installs nothing."""
    for folder, pattern in (("docs", "*.md"), ("gazempc", "*.py"), ("experiments", "*.py"), (".", "README.md")):
        for path in (ROOT / folder).rglob(pattern) if folder != "." else [ROOT / pattern]:
            assert 'pip install "gazempc[' not in path.read_text(encoding="utf-8"), path
