"""Fixtures of live sources."""

from collections.abc import Iterator

import pytest
from builders.ros2_graph import Stage


@pytest.fixture
def stage() -> Iterator[Stage]:
    """A graph of ROS 2 inside the test."""
    made = Stage()
    yield made
    made.close()
