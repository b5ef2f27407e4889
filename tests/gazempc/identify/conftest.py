"""A recording of a plant without noise, which many tests begin from."""

import pytest
from builders.identification import plant, simulate


@pytest.fixture(scope="session")
def clean():
    """A record of the reference neck without any noise."""
    return simulate(plant())
