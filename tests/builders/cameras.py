"""Rendered people for the camera source."""

import functools
import os

import pytest

from gazempc.robots.studio import Studio


@functools.cache
def studio():
    """The room to render; one a process. Elsewhere than in CI, tests skip where nothing can be rendered."""
    try:
        return Studio()
    except RuntimeError as error:
        if os.environ.get("CI"):
            pytest.fail(f"{error}; CI must not skip this")
        pytest.skip(str(error))
