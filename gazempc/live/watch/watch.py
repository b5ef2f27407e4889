"""Looks at what arrives, each second, and says once what is probably wrong."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from gazempc.live.clock import Clock
from gazempc.live.mount import Mount
from gazempc.live.stamps import StampReader
from gazempc.live.watch.clock import judge_stamps, unusable
from gazempc.live.watch.frame import Finding, Frame
from gazempc.live.watch.mends import Mends
from gazempc.live.watch.place import judge_place
from gazempc.live.watch.rhythm import judge_ids, judge_rate
from gazempc.loop.events import Event
from gazempc.settings import LoopSettings
from gazempc.types import FloatArray

# Something wrong is said within a second of the first frame.
_FIRST_AFTER_S, _AGAIN_AFTER_S = 0.9, 1.0
_WINDOW_S = 1.0
# Rates are told over a longer time: a tracker may be slower than a frame a second.
_RATE_WINDOW_S = 4.0
_FRAMES_MAX = 1000


class Watch:
    """Keeps the frames of the last seconds and judges them.

    Args:
        clock: The loop's clock.
        reader: How stamps are read; None if the source gives the loop's times.
        mount: Where the sensor is, and its unit and axes.
        settings: When the loop gives up on a frame or person.
        mends: Names what mends it.
    """

    def __init__(
        self, clock: Clock, reader: StampReader | None, mount: Mount, settings: LoopSettings, mends: Mends
    ) -> None:
        self._clock, self._reader, self._mount = clock, reader, mount
        self._settings, self._mends = settings, mends
        self._frames: deque[Frame] = deque(maxlen=_FRAMES_MAX)
        self._due_s: float | None = None
        self._said: set[Event] = set()

    def see(self, frame: Frame) -> None:
        """Take note of a frame, used or not."""
        if self._due_s is None:
            self._due_s = frame.arrival_s + _FIRST_AFTER_S
        self._frames.append(frame)

    def findings(self, now_s: float) -> list[Finding]:
        """What is probably wrong; each kind once in a run, and nothing before its time.

        Args:
            now_s: The time, seconds.
        """
        if self._due_s is None or now_s < self._due_s or not self._frames:
            return []
        self._due_s = now_s + _AGAIN_AFTER_S
        while self._frames and self._frames[0].arrival_s < now_s - _RATE_WINDOW_S:
            self._frames.popleft()
        found = [each for each in self._judge(now_s) if each.event not in self._said]
        self._said.update(each.event for each in found)
        return found

    def _judge(self, now_s: float) -> list[Finding]:
        lately = [frame for frame in self._frames if frame.arrival_s >= now_s - _WINDOW_S]
        if not lately:
            return []
        stamps = judge_stamps(lately, self._settings.stale_after_s, self._reader, self._clock, self._mends)
        believed = stamps is None and not unusable(lately, self._settings.stale_after_s)
        return [
            *([] if stamps is None else [stamps]),
            *judge_place(lately, _times_s(lately, believed), self._mount, self._mends),
            *judge_rate(_times_s(self._frames, believed), self._settings.lost_after_s, self._mends),
            *judge_ids(lately, self._mends),
        ]


def _times_s(frames: Sequence[Frame] | deque[Frame], believed: bool) -> FloatArray:
    return np.array([frame.capture_s if believed else frame.arrival_s for frame in frames])
