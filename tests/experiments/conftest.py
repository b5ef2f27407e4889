"""Fixtures of the experiments' tests."""

import pytest
from builders.in_process import workers_in_this_process


@pytest.fixture(scope="module")
def in_this_process():
    """The module's commands start no worker process."""
    with workers_in_this_process():
        yield
