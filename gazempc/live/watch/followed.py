"""Of several people the frames of one, for the watch, which judges one person's frames."""

from __future__ import annotations

import math
from collections.abc import Callable

from gazempc.live.watch.frame import Frame
from gazempc.loop.track import Target
from gazempc.types import FloatArray

# Detections of one instant arrive, and are stamped, within this.
_ONE_FRAME_S = 0.01


class FollowedPerson:
    """Tells one frame an instant: that of whoever is looked at, else of whoever is nearest to the one before.

    Args:
        tell: Takes that frame.
        people: Knows who is looked at.
    """

    def __init__(self, tell: Callable[[Frame], None], people: Target) -> None:
        self._tell, self._people = tell, people
        self._together: list[Frame] = []
        self._last_m: FloatArray | None = None

    def see(self, frame: Frame) -> None:
        """Take note of a frame, used or not; those of one instant follow each other."""
        first = self._together[0] if self._together else frame
        apart_s = max(abs(frame.capture_s - first.capture_s), frame.arrival_s - first.arrival_s)
        if apart_s > _ONE_FRAME_S:
            self._tell_one()
        self._together.append(frame)

    def _tell_one(self) -> None:
        attended = self._people.newest
        about_m = self._last_m if attended is None else attended.head_position_base_m
        frames, self._together = self._together, []
        one = frames[0] if about_m is None else min(frames, key=lambda frame: math.dist(_where_m(frame), about_m))
        self._last_m = _where_m(one)
        self._tell(one)


def _where_m(frame: Frame) -> FloatArray:
    return frame.sensor_m if frame.base_m is None else frame.base_m
