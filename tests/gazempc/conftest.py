"""Fixtures of user-defined parts."""

import pytest
from builders.own_modules import write_own_parts


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """Name of a module with user-defined parts in the working directory."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("own")
        patch.chdir(folder)
        patch.syspath_prepend(folder)
        yield write_own_parts(folder)
