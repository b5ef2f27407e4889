"""Detectors that look at fewer frames than the camera gives."""

from __future__ import annotations

import math
from collections.abc import Iterator

from experiments.rivals.rival import Detection

# Frames a tenth of a second apart are ten a second, whatever the last digit of their stamps.
_SAME_TIME_S = 1e-3


class FrameRate:
    """Takes a frame only if the one before is long enough ago.

    Args:
        period_s: Least time between two frames that it looks at, seconds.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self.reset()

    def reset(self) -> None:
        """Take the next frame in any case."""
        self._last_s = -math.inf

    def take(self, detections: tuple[Detection, ...]) -> Iterator[Detection]:
        """The detections of the frames that it looks at, oldest first."""
        for detection in detections:
            if detection.capture_time_s > self._last_s + self._period_s - _SAME_TIME_S:
                self._last_s = detection.capture_time_s
                yield detection
