"""Fixtures of the experiments' tests."""

import os
from pathlib import Path

import pytest
from builders.in_process import workers_in_this_process


@pytest.fixture(scope="module")
def in_this_process():
    """The module's commands start no worker process."""
    with workers_in_this_process():
        yield


@pytest.fixture(scope="session")
def standing_dir() -> Path:
    """Folder with motion capture of people who stand, which is not part of the project."""
    folder = Path(os.environ.get("GAZEMPC_STANDING", Path(__file__).resolve().parents[3] / "shared" / "standing"))
    if not (folder / "index.csv").is_file():
        pytest.skip(f"the people who stand are not at {folder} (set GAZEMPC_STANDING)")
    return folder
