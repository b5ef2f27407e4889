"""The watch over what arrives: each second it judges the frames, and each finding is printed once."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from gazempc.live.capture_clock import judge_stamps, unusable
from gazempc.live.clock import Clock
from gazempc.live.hints import Finding, Frame, SetupHints
from gazempc.live.mount import Mount
from gazempc.live.plausibility import judge_ids, judge_place, judge_rate
from gazempc.live.stamps import StampReader
from gazempc.loop.events import Event
from gazempc.loop.track import Target
from gazempc.settings import LoopSettings
from gazempc.types import FloatArray

# Detections of one instant arrive, and are stamped, within this.
_ONE_FRAME_S = 0.01


class FollowedPerson:
    """Passes on one frame an instant: of the attended person, else of the person nearest to the frame before.

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


# Something wrong is said within a second of the first frame.
_FIRST_AFTER_S, _AGAIN_AFTER_S = 0.9, 1.0
_WINDOW_S = 1.0
# Rates are estimated over a longer time: a tracker may be slower than a frame a second.
_RATE_WINDOW_S = 4.0
_FRAMES_MAX = 1000


class Watch:
    """Keeps the frames of the last seconds and judges them.

    Args:
        clock: The loop's clock.
        reader: How stamps are read; None if the source gives the loop's times.
        mount: Where the sensor is, and its unit and axes.
        settings: When the loop gives up on a frame or person.
        hints: Names of the settings in warnings.
    """

    def __init__(
        self, clock: Clock, reader: StampReader | None, mount: Mount, settings: LoopSettings, hints: SetupHints
    ) -> None:
        self._clock, self._reader, self._mount = clock, reader, mount
        self._settings, self._hints = settings, hints
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
        stamps = judge_stamps(lately, self._settings.stale_after_s, self._reader, self._clock, self._hints)
        believed = stamps is None and not unusable(lately, self._settings.stale_after_s)
        return [
            *([] if stamps is None else [stamps]),
            *judge_place(lately, _times_s(lately, believed), self._mount, self._hints),
            *judge_rate(_times_s(self._frames, believed), self._settings.lost_after_s, self._hints),
            *judge_ids(lately, self._hints),
        ]


def _times_s(frames: Sequence[Frame] | deque[Frame], believed: bool) -> FloatArray:
    return np.array([frame.capture_s if believed else frame.arrival_s for frame in frames])
