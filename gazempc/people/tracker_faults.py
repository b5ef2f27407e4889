"""Faults of trackers that the loop makes up for: late first frames, frozen positions, jumps, low rates."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np

from gazempc.types import FloatArray, Sighting
from predictors import Forecast, HeadObservation, Perfect, Predictor
from predictors.geometry import wrap_rad, yaw_rad

_FROZEN_AFTER_S = 0.5
# A person who walked so fast over the last quarter of a second cannot stand still to the last bit at once: braking
# takes a person half a second. A person who slows down first, as simulated people without noise do, counts as standing.
_WALKED_M_S = 0.5
_WALKED_OVER_S = 0.25
_LONGEST_STEP_S = 1.0
# Heads turn at up to some 600 degrees a second. At lower frame rates a jump is no fault.
_JUMP_RAD = math.radians(90.0)
_JUMP_WITHIN_S = 0.15
# Below this rate frames are too far apart for a jump, and a walking head moves by 0.2 m between them.
LOW_RATE_HZ = 6.0
_RATE_INTERVALS, _ROUNDING = 2, 1e-6
_JUMPS_ARE_ONE_WITHIN_S = 1.0


def is_low_rate(times_s: FloatArray) -> bool:
    """Whether frames come less often than six times a second.

    Args:
        times_s: Times of frames, shape (F,), seconds, in any order; several people of a frame may share one.

    Returns:
        True if more than half of the intervals are longer than a sixth of a second; False of fewer than three frames.
    """
    apart_s = np.diff(np.unique(times_s))
    return apart_s.size >= _RATE_INTERVALS and float(np.median(apart_s)) * LOW_RATE_HZ > 1.0 + _ROUNDING


class FrozenTracker:
    """Detects that a tracker repeats one position, with new stamps, of a person who was walking.

    Attributes:
        frozen: Whether it does so at present.
        newest_s: Capture time of the newest sighting, seconds.
    """

    def __init__(self) -> None:
        self.frozen = False
        self._walked = False
        self._position: list[float] | None = None
        self._since_s = self.newest_s = -math.inf
        self._path: deque[tuple[float, FloatArray]] = deque()

    def see(self, sighting: Sighting) -> bool:
        """Take note of a sighting.

        Args:
            sighting: The sighting.

        Returns:
            Whether it is a repetition: the same position for more than 0.5 s, to the last bit, and a walk before it.
        """
        observation = sighting.observation
        time_s = observation.capture_time_s
        if time_s <= self.newest_s:
            return False  # the predictor refuses observations out of order
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
        """Whether a sighting, of any person, is the position at which the tracker stands frozen.

        Args:
            sighting: The sighting.
        """
        return self.frozen and _position_of(sighting) == self._position

    def _speed_m_s(self, time_s: float, head_base_m: FloatArray) -> float:
        """Mean speed over the last quarter of a second, or since the frame before where that is longer ago."""
        while len(self._path) > 1 and self._path[1][0] <= time_s - _WALKED_OVER_S:
            self._path.popleft()
        self._path.append((time_s, head_base_m))
        first_s, first_m = self._path[0]
        return math.dist(head_base_m, first_m) / (time_s - first_s) if first_s < time_s else 0.0


class FrozenPeople:
    """Detects the same among several people, each by their number."""

    def __init__(self) -> None:
        self._trackers: dict[int, FrozenTracker] = {}

    def repeats(self, sighting: Sighting) -> bool:
        """Whether a sighting, before its association, repeats a position at which a tracker stands frozen.

        Args:
            sighting: The sighting.
        """
        return any(tracker.repeats(sighting) and tracker.see(sighting) for tracker in self._trackers.values())

    def see(self, number: int, sighting: Sighting) -> tuple[bool, bool]:
        """Take note of a sighting of a person.

        Args:
            number: Which person.
            sighting: The sighting.

        Returns:
            Whether the tracker counts as frozen from now on, and whether it was and has gone on.
        """
        time_s = sighting.observation.capture_time_s
        # A sighting older than that belongs to another standstill.
        self._trackers = {
            n: each for n, each in self._trackers.items() if n == number or time_s - each.newest_s <= _LONGEST_STEP_S
        }
        tracker = self._trackers.setdefault(number, FrozenTracker())
        was_frozen = tracker.frozen
        frozen = tracker.see(sighting)
        return frozen, was_frozen and not frozen


class OrientationJumps:
    """Leaves out orientations that no body can have turned to since the frame before."""

    def __init__(self) -> None:
        self._time_s = self._jumped_s = -math.inf
        self._yaws_rad: dict[str, float] = {}

    def without(self, observation: HeadObservation) -> tuple[HeadObservation, bool]:
        """Judge the yaws of head and pelvis, each by that of the frame before, whether that one was used or not.

        So one frame is left out where a tracker turns a person round for good, and all where it does so at every frame.

        Args:
            observation: The observation.

        Returns:
            The observation without the orientations that jumped by more than 90 degrees within 0.15 s, and whether
            it is the first such frame for a second.
        """
        time_s = observation.capture_time_s
        if time_s <= self._time_s:
            return observation, False  # the predictor refuses observations out of order
        seen = {"head_quat_wxyz": observation.head_quat_wxyz, "pelvis_quat_wxyz": observation.pelvis_quat_wxyz}
        yaws_rad = {name: yaw_rad(quat) for name, quat in seen.items() if quat is not None}
        jumped: list[str] = []
        if time_s - self._time_s <= _JUMP_WITHIN_S:
            both = yaws_rad.keys() & self._yaws_rad.keys()
            jumped = [name for name in both if abs(wrap_rad(yaws_rad[name] - self._yaws_rad[name])) > _JUMP_RAD]
        self._time_s, self._yaws_rad = time_s, yaws_rad
        if not jumped:
            return observation, False
        first = time_s - self._jumped_s > _JUMPS_ARE_ONE_WITHIN_S
        self._jumped_s = time_s
        head, pelvis = (None if name in jumped else quat for name, quat in seen.items())
        return replace(observation, head_quat_wxyz=head, pelvis_quat_wxyz=pelvis), first


def _position_of(sighting: Sighting) -> list[float]:
    """A head as the sensor sees it, where that moves: its own motion makes others of one position."""
    seen_m = sighting.head_position_sensor_m
    position_m: list[float] = (sighting.observation.head_position_base_m if seen_m is None else seen_m).tolist()
    return position_m


# A velocity needs two frames. Over a network that delays frames by 40 to 250 ms, the first one to come is often the
# third or fourth in order of capture, and those before it follow within 0.2 s. Later in a track each frame is one of
# many: with all late frames in their places the gaze erred 0.01 to 0.03 deg less (64 walks, two seeds), which is not
# worth copies of the predictor's state.
START_S = 0.3
# Frames and time before the track of a detector is extrapolated: hair and necks pass for a face in several frames.
# A detector is a sensor that states its confidence; the others confirm their tracks themselves, and to wait for them
# costs a robot before walking people 4 points of eye contact.
_START_FRAMES = 6
# People in a room run at up to 3 m/s, and lean or step aside by this much beside the walk that was seen.
_SPEED_M_S, _REACH_M = 3.0, 0.3


class TrackStart:
    """Gives one predictor its observations, those of the first 0.3 s of a track in the order of their capture.

    If one of these comes late, the predictor is reset and takes all of them in again. So the track may begin earlier
    than with the observation that came first. Where observations come in order, the predictor gets them as they come.

    Its forecasts stay within 0.3 m and 3 m/s of the last position. For the first 0.3 s and six frames of a sensor that
    states its confidence, they are that position.

    Args:
        predictor: The predictor.
    """

    def __init__(self, predictor: Predictor) -> None:
        self._predictor = predictor
        self._forget()

    def _forget(self) -> None:
        self._first: list[HeadObservation] = []
        self._newest_s = 0.0
        self._frames = 0
        self._last: HeadObservation | None = None

    def reset(self) -> None:
        """Forget the person; the predictor does, too."""
        self._predictor.reset()
        self._forget()

    def update(self, observation: HeadObservation) -> None:
        """Give the predictor one observation.

        Args:
            observation: The observation.

        Raises:
            OutOfOrderError: If it is older than the newest one and comes after the start, or is there already.
            Exception: Any exception of the predictor.
        """
        captured_s = observation.capture_time_s
        if self._has_place_for(captured_s):
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
        """Keep a forecast of the predictor within reach of the last position.

        Args:
            forecast: The forecast.

        Returns:
            The forecast within reach, and whether it left the reach of a track that has lasted long enough.
        """
        last = self._last
        if last is None or isinstance(self._predictor, Perfect):  # the true future needs no evidence
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

    def _has_place_for(self, captured_s: float) -> bool:
        if not self._first or captured_s >= self._newest_s:
            return False
        within = self._newest_s - min(captured_s, self._first[0].capture_time_s) <= START_S
        return within and all(each.capture_time_s != captured_s for each in self._first)
