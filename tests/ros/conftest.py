"""Fixture: a stage for each test."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def stage(tmp_path):
    from stage import Stage

    made = Stage(tmp_path)
    yield made
    made.close()
