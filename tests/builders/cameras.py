"""Rendered people for the camera source."""

import functools
import os

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

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


def film(path, person_at, seconds, fps):
    """A video of a rendered person, seen from the origin."""
    import cv2

    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), fps, (640, 480))
    for k in range(round(seconds * fps)):
        rgb = studio().picture(person_at(k / fps), np.zeros(3), Rotation.identity())
        video.write(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))
    video.release()
