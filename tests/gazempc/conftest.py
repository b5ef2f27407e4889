"""Fixtures that robots and sources share."""

import pytest


@pytest.fixture
def scene():
    """A Zenoh router, a robot's controller and a person, and what a test connects to them."""
    from builders.ros2_network import Scene

    made = Scene()
    yield made
    made.close()
