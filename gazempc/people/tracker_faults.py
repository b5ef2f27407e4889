"""Detection and correction of tracker faults: late first frames, frozen positions, jumps, low rates."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np

from gazempc.types import FloatArray, Sighting
from predictors import Forecast, HeadObservation, Perfect, Predictor
from predictors.geometry import wrap_rad, yaw_rad

_FROZEN_AFTER_S = 0.5
# Minimum speed over the last quarter of a second before a frozen position: braking takes a person half a second. A
# person who slows down first, as simulated people without noise do, is classified as standing.
_WALKED_M_S = 0.5
_WALKED_OVER_S = 0.25
_LONGEST_STEP_S = 1.0
# Heads turn at up to some 600 degrees a second, so at lower frame rates a jump is plausible.
_JUMP_RAD = math.radians(90.0)
_JUMP_WITHIN_S = 0.15
# Below this rate jumps are not detectable, and a walking head moves by 0.2 m between frames.
LOW_RATE_HZ = 6.0
_RATE_INTERVALS, _ROUNDING = 2, 1e-6
_JUMPS_ARE_ONE_WITHIN_S = 1.0


def is_low_rate(times_s: FloatArray) -> bool:
    """Whether the frame rate is below six a second.

    Args:
        times_s: Times of frames, shape (F,), seconds, in any order; several people of a frame may share one.

    Returns:
        True if more than half of the intervals exceed a sixth of a second; False for fewer than three frames.
    """
    apart_s = np.diff(np.unique(times_s))
    return apart_s.size >= _RATE_INTERVALS and float(np.median(apart_s)) * LOW_RATE_HZ > 1.0 + _ROUNDING


class FrozenTracker:
    """Detects a frozen tracker: one position of a walking person, repeated with new stamps.

    Attributes:
        frozen: Whether the tracker is frozen.
        newest_s: Capture time of the newest sighting, seconds.
    """

    def __init__(self) -> None:
        self.frozen = False
        self._walked = False
        self._position: list[float] | None = None
        self._since_s = self.newest_s = -math.inf
        self._path: deque[tuple[float, FloatArray]] = deque()

    def observe(self, sighting: Sighting) -> bool:
        """Update with a sighting.

        Args:
            sighting: The sighting.

        Returns:
            Whether it is a repetition: a bitwise identical position for more than 0.5 s, after a walk.
        """
        observation = sighting.observation
        time_s = observation.capture_time_s
        if time_s <= self.newest_s:
            return False  # the predictor rejects observations out of order
        position = _position_of(sighting)
        if position == self._position:
            self.newest_s = time_s
            self.frozen = self.frozen or (self._walked and time_s - self._since_s > _FROZEN_AFTER_S)
            return self.frozen
        if self.frozen or time_s - self.newest_s > _LONGEST_STEP_S:
            self._path.clear()
        self.frozen = False
        self._position, self._since_s, self.newest_s = position, time_s, time_s
        self._walked = self._speed_m_s(time_s, observation.head_position_base_m) > _WALKED_M_S
        return False

    def repeats(self, sighting: Sighting) -> bool:
        """Whether a sighting, of any person, has the frozen position.

        Args:
            sighting: The sighting.
        """
        return self.frozen and _position_of(sighting) == self._position

    def _speed_m_s(self, time_s: float, head_base_m: FloatArray) -> float:
        """Mean speed over the last quarter of a second, or since the previous frame, if that is earlier."""
        while len(self._path) > 1 and self._path[1][0] <= time_s - _WALKED_OVER_S:
            self._path.popleft()
        self._path.append((time_s, head_base_m))
        first_s, first_m = self._path[0]
        return math.dist(head_base_m, first_m) / (time_s - first_s) if first_s < time_s else 0.0


class FrozenPeople:
    """Detects a frozen tracker of several people, by number of the person."""

    def __init__(self) -> None:
        self._trackers: dict[int, FrozenTracker] = {}

    def repeats(self, sighting: Sighting) -> bool:
        """Whether a sighting, before its association, has a frozen position; if so, its tracker is updated.

        Args:
            sighting: The sighting.
        """
        return any(tracker.repeats(sighting) and tracker.observe(sighting) for tracker in self._trackers.values())

    def observe(self, number: int, sighting: Sighting) -> tuple[bool, bool]:
        """Update with a sighting of a person.

        Args:
            number: Number of the person.
            sighting: The sighting.

        Returns:
            Whether the tracker is frozen, and whether it has resumed after it was frozen.
        """
        time_s = sighting.observation.capture_time_s
        # Older entries are from another standstill.
        self._trackers = {
            n: each for n, each in self._trackers.items() if n == number or time_s - each.newest_s <= _LONGEST_STEP_S
        }
        tracker = self._trackers.setdefault(number, FrozenTracker())
        was_frozen = tracker.frozen
        frozen = tracker.observe(sighting)
        return frozen, was_frozen and not frozen


class OrientationJumps:
    """Removes orientations whose rate since the previous frame is not plausible for a person."""

    def __init__(self) -> None:
        self._time_s = self._jumped_s = -math.inf
        self._yaws_rad: dict[str, float] = {}

    def without(self, observation: HeadObservation) -> tuple[HeadObservation, bool]:
        """Compare the yaws of head and pelvis with the previous frame's, used or not.

        A permanent reversal thus removes one frame, and an alternating one all frames.

        Args:
            observation: The observation.

        Returns:
            The observation without orientations that jumped by more than 90 degrees within 0.15 s, and whether this is
            the first jump for a second.
        """
        time_s = observation.capture_time_s
        if time_s <= self._time_s:
            return observation, False  # the predictor rejects observations out of order
        seen = {"head_quat_wxyz": observation.head_quat_wxyz, "pelvis_quat_wxyz": observation.pelvis_quat_wxyz}
        yaws_rad = {name: yaw_rad(quat) for name, quat in seen.items() if quat is not None}
        both = yaws_rad.keys() & self._yaws_rad.keys() if time_s - self._time_s <= _JUMP_WITHIN_S else ()
        jumped: dict[str, Any] = {n: None for n in both if abs(wrap_rad(yaws_rad[n] - self._yaws_rad[n])) > _JUMP_RAD}
        self._time_s, self._yaws_rad = time_s, yaws_rad
        if not jumped:
            return observation, False
        first = time_s - self._jumped_s > _JUMPS_ARE_ONE_WITHIN_S
        self._jumped_s = time_s
        return replace(observation, **jumped), first


def _position_of(sighting: Sighting) -> list[float]:
    """Head position in the frame of the sensor: the motion of a moving sensor changes positions in the base frame."""
    seen_m = sighting.head_position_sensor_m
    position_m: list[float] = (sighting.observation.head_position_base_m if seen_m is None else seen_m).tolist()
    return position_m


# Duration of reordering. A velocity needs two frames. Over a network that delays frames by 40 to 250 ms, the first
# arrival is often the third or fourth in order of capture, and the earlier ones follow within 0.2 s. Reordering of a
# whole track reduced the gaze error by only 0.01 to 0.03 deg (64 walks, two seeds), at the cost of copies of the
# predictor's state.
START_S = 0.3
# Frames before the track of a detector is extrapolated: false detections of faces last for several frames. A detector
# is a sensor that states its confidence; other sensors confirm their tracks, and a wait for them costs 4 points of eye
# contact with walking people.
_START_FRAMES = 6
# Reach of a person in a room: running speed, and distance of a lean or a step aside.
_SPEED_M_S, _REACH_M = 3.0, 0.3


class TrackStart:
    """Updates one predictor; reorders the first 0.3 s of a track by capture time.

    A late observation in this period resets the predictor, which then processes all of them again; so the track may
    begin before the observation that arrived first. Observations in order are passed on without delay.

    Forecasts are clamped to 0.3 m plus 3 m/s from the last position; for the first 0.3 s and six frames of a sensor
    that states its confidence, to the last position.

    Args:
        predictor: The predictor.
    """

    def __init__(self, predictor: Predictor) -> None:
        self._predictor = predictor
        self._clear()

    def _clear(self) -> None:
        self._first: list[HeadObservation] = []
        self._newest_s = 0.0
        self._frames = 0
        self._last: HeadObservation | None = None

    def reset(self) -> None:
        """Discard the track, and reset the predictor."""
        self._predictor.reset()
        self._clear()

    def update(self, observation: HeadObservation) -> None:
        """Update the predictor with one observation.

        Args:
            observation: The observation.

        Raises:
            OutOfOrderError: If it is older than the newest one, and outside of the start or a duplicate.
            Exception: Any exception of the predictor.
        """
        captured_s = observation.capture_time_s
        if self._accepts_late(captured_s):
            self._first = sorted([*self._first, observation], key=lambda each: each.capture_time_s)
            self._predictor.reset()
            for each in self._first:
                self._predictor.update(each)
            self._frames += 1
            return
        self._predictor.update(observation)
        self._newest_s = captured_s
        if not getattr(self._predictor, "rejections_in_a_row", 0):
            self._last = observation
            self._frames += 1
        if not self._first or captured_s - self._first[0].capture_time_s <= START_S:
            self._first.append(observation)

    def within_reach(self, forecast: Forecast) -> tuple[Forecast, bool]:
        """Clamp a forecast of the predictor to the reach around the last position.

        Args:
            forecast: The forecast.

        Returns:
            The clamped forecast, and whether a forecast of an established track was clamped.
        """
        last = self._last
        if last is None or isinstance(self._predictor, Perfect):  # the true future needs no confirmation
            return forecast, False
        lasted = self._frames >= _START_FRAMES and last.capture_time_s - self._first[0].capture_time_s >= START_S
        confirmed = lasted or last.confidence is None
        reach_m = confirmed * (_REACH_M + _SPEED_M_S * np.maximum(forecast.times_s - last.capture_time_s, 0.0))
        away_m = forecast.means_base_m - last.head_position_base_m
        with np.errstate(over="ignore"):
            far_m = np.linalg.norm(away_m, axis=1)
        if np.all(far_m <= reach_m):
            return forecast, False
        within_m = last.head_position_base_m + np.minimum(reach_m / np.maximum(far_m, 1e-9), 1.0)[:, None] * away_m
        return replace(forecast, means_base_m=within_m), confirmed

    def _accepts_late(self, captured_s: float) -> bool:
        if not self._first or captured_s >= self._newest_s:
            return False
        within = self._newest_s - min(captured_s, self._first[0].capture_time_s) <= START_S
        return within and all(each.capture_time_s != captured_s for each in self._first)
