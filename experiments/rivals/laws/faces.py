"""Which face Reachy Mini's daemon takes for the person, and its filter in the image."""

from __future__ import annotations

import math

import numpy as np

from experiments.rivals.rival import Detection, HeadCamera
from gazempc.types import FloatArray

# Constants of reachy_mini, `vision/face_tracking.py`; lengths in halves of the image.
_LONGEST_JUMP = 0.5
_MISSES = 20
_STILL = 0.02
_FAST_CHANGE = 0.15
_FAST_GAIN = 0.6
_SLOW_GAIN = 0.3


class Association:
    """Takes faces that are large enough, and near the last one.

    Args:
        camera: Whose images.
        detection_period_s: Time between two images that the detector looks at, seconds.
        least_share: Of the image's area; a smaller face is nobody's.
    """

    def __init__(self, camera: HeadCamera, detection_period_s: float, least_share: float) -> None:
        self._least_px2 = least_share * camera.width_px * camera.height_px
        self._patience_s = _MISSES * detection_period_s
        self.reset()

    def reset(self) -> None:
        """Forget the last face."""
        self._offset: FloatArray | None = None
        self._seen_s = -math.inf

    def takes(self, detection: Detection) -> bool:
        """Whether this is the person; the daemon counts misses, here their time."""
        if detection.box_px.prod() < self._least_px2:
            return False
        if detection.capture_time_s - self._seen_s > self._patience_s:
            self.reset()
        if self._offset is not None and np.linalg.norm(detection.offset - self._offset) > _LONGEST_JUMP:
            return False
        self._offset, self._seen_s = detection.offset, detection.capture_time_s
        return True


class ImageFilter:
    """Keeps the face's place where it hardly changes, and follows it faster where it changes fast."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Take the next place as it is."""
        self._filtered: FloatArray | None = None
        self._raw: FloatArray | None = None

    def update(self, raw: FloatArray) -> FloatArray:
        """The filtered place, shape (2,), in halves of the image."""
        if self._filtered is None or self._raw is None:
            self._filtered = raw
        elif np.linalg.norm(raw - self._filtered) >= _STILL:
            fast = np.linalg.norm(raw - self._raw) > _FAST_CHANGE
            self._filtered = self._filtered + (_FAST_GAIN if fast else _SLOW_GAIN) * (raw - self._filtered)
        self._raw = raw
        return self._filtered
