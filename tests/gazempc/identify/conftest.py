"""A noise-free record shared by the tests."""

import pytest
from builders.identification import plant, simulate


@pytest.fixture(scope="session")
def clean():
    """A noise-free record of the reference neck."""
    return simulate(plant())
