"""The clock of a live run, in seconds since its start, and the offset between two clocks."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import deque

import numpy as np

# Busy-wait at the end of a sleep: the wake-up latency of a process.
_SPIN_S = 0.0005
# Threshold of a step; clocks of one machine drift by microseconds.
_STEP_S = 0.01
# Interval of a minimum, with at least one frame of small delay, and number of stored intervals.
_PIECE_S, _PIECES = 1.0, 10
# The minimum delay is estimated by the 1/5 quantile, robust to single wrong stamps.
_SOONEST_SHARE = 5
# Crystals differ by 0.1 ms a second, and NTP corrects by 0.5. Smaller slopes, or slopes within the noise, are no drift.
_DRIFT_LEAST, _DRIFT_PIECES, _DRIFT_ERRORS, _SOONEST_ERROR_S = 0.002, 4, 5.0, 0.001
# Thresholds of a step of the other clock to shorter and to longer delays, beyond delays of trackers.
_SET_BACK_S, _SET_ON_S = 0.15, 2.0
# Duration after which a smaller step to longer delays is accepted, in intervals.
_LATER_PIECES = 2
# Range of delays over half a second that counts as steady; stamps in another unit exceed it.
_RECENT_S, _RECENT_LEAST_S, _RECENT_FRAMES, _STEADY_WITHIN_S = 0.5, 0.4, 5, 0.2
_RECENT_MAX = 1000
_AGAIN_AFTER_S = 0.1


class Clock(ABC):
    """The clock of a loop.

    Attributes:
        is_real: Whether it advances with the computer's monotonic clock, or only in `sleep_until_s`.
    """

    is_real: bool
    # Its zero on the computer's clocks; a simulated clock starts at 0 of both.
    _start_s = _unix_start_s = 0.0

    @abstractmethod
    def now_s(self) -> float:
        """Seconds since the clock was made."""

    @abstractmethod
    def sleep_until_s(self, time_s: float) -> None:
        """Return at a time on this clock, seconds; at once if it has passed."""

    def from_unix_s(self, unix_s: float) -> float:
        """Unix time on this clock, seconds."""
        return unix_s - self._unix_start_s

    def from_monotonic_s(self, monotonic_s: float) -> float:
        """A time of `time.monotonic` on this clock, seconds."""
        return monotonic_s - self._start_s

    def unix_clock_stepped(self) -> bool:
        """Whether the computer's Unix clock was stepped since the last call; the offset is then updated."""
        return False


class RealClock(Clock):
    """The computer's monotonic clock, and its offset to Unix time."""

    is_real = True

    def __init__(self) -> None:
        self._start_s = time.monotonic()
        self._unix_start_s = time.time() - (time.monotonic() - self._start_s)

    def now_s(self) -> float:
        """See `Clock.now_s`."""
        return time.monotonic() - self._start_s

    def sleep_until_s(self, time_s: float) -> None:
        """See `Clock.sleep_until_s`."""
        while (left_s := time_s - self.now_s()) > 0:
            if left_s > _SPIN_S:
                time.sleep(left_s - _SPIN_S)

    def unix_clock_stepped(self) -> bool:
        """See `Clock.unix_clock_stepped`; true once after each step of more than 10 ms."""
        start_s = time.time() - self.now_s()
        stepped = abs(start_s - self._unix_start_s) > _STEP_S
        if stepped:
            self._unix_start_s = start_s
        return stepped


class SimulatedClock(Clock):
    """A clock that jumps to the end of each sleep: a live run at full speed, repeatable."""

    is_real = False
    _now_s = 0.0

    def now_s(self) -> float:
        """See `Clock.now_s`."""
        return self._now_s

    def sleep_until_s(self, time_s: float) -> None:
        """See `Clock.sleep_until_s`."""
        self._now_s = max(self._now_s, time_s)


class Envelope:
    """Clock offset and drift: the lower envelope of arrival minus stamp over the last 10 s, a straight line.

    Attributes:
        slope: Drift of the stamps' clock, s/s; positive: slow, negative: fast; 0 if insignificant.
        steady: Whether the delays of the last half second are consistent.
        recent_s: Their minimum, seconds.
        resets: Number of steps of the other clock.
    """

    def __init__(self) -> None:
        self.slope, self.steady, self.resets, self.recent_s = 0.0, False, 0, 0.0
        self._due_s = -np.inf
        self._recent: deque[tuple[float, float]] = deque(maxlen=_RECENT_MAX)
        self._forget()

    def add(self, arrival_s: float, delay_s: float) -> None:
        """Add a frame.

        Args:
            arrival_s: Arrival time on the loop's clock; not decreasing.
            delay_s: Arrival minus stamp, seconds.
        """
        self._recent.append((arrival_s, delay_s))
        if arrival_s - self._piece_from_s >= _PIECE_S:
            self._end_piece(arrival_s)
        self._piece.append(delay_s)
        if arrival_s >= self._due_s or len(self._piece) <= _RECENT_FRAMES:
            self._due_s = arrival_s + _AGAIN_AFTER_S
            self._judge(arrival_s)

    def at(self, time_s: float) -> float:
        """The minimum delay.

        Args:
            time_s: Arrival time, seconds.

        Returns:
            Seconds; includes the offset of the other clock.
        """
        return self._level_s + self.slope * (time_s - self._fitted_s)

    def _forget(self) -> None:
        self._lows: deque[tuple[float, float]] = deque(maxlen=_PIECES)
        self._piece: list[float] = []
        self._piece_from_s = -np.inf
        self._level_s = self._fitted_s = 0.0

    def _end_piece(self, arrival_s: float) -> None:
        if self._piece:
            self._lows.append((self._piece_from_s + 0.5 * _PIECE_S, _low_quantile(self._piece)))
        while self._lows and self._lows[0][0] < arrival_s - _PIECES * _PIECE_S:
            self._lows.popleft()
        self._piece, self._piece_from_s = [], arrival_s

    def _judge(self, now_s: float) -> None:
        while self._recent[0][0] < now_s - _RECENT_S:
            self._recent.popleft()
        delays_s = [delay_s for _, delay_s in self._recent]
        enough = len(delays_s) >= _RECENT_FRAMES and now_s - self._recent[0][0] >= _RECENT_LEAST_S
        self.steady = enough and max(delays_s) - min(delays_s) < _STEADY_WITHIN_S
        self.recent_s = _low_quantile(delays_s)
        if self._lows and self._stepped(now_s):
            self.slope, self.resets = 0.0, self.resets + 1
            self._forget()
            self._piece, self._piece_from_s = delays_s, self._recent[0][0]
        self._fit(now_s)

    def _stepped(self, now_s: float) -> bool:
        earlier, later = list(self._lows)[:-_LATER_PIECES], list(self._lows)[-_LATER_PIECES:]
        off_s = self.recent_s - self._median_s(list(self._lows), now_s)
        return (self.steady and not -_SET_BACK_S < off_s < _SET_ON_S) or (
            bool(earlier) and all(low_s - self._median_s(earlier, at_s) > _SET_BACK_S for at_s, low_s in later)
        )

    def _median_s(self, lows: list[tuple[float, float]], time_s: float) -> float:
        """Median of the intervals, extrapolated to a time: robust to single intervals."""
        return float(np.median([low_s + self.slope * (time_s - at_s) for at_s, low_s in lows]))

    def _fit(self, now_s: float) -> None:
        points = np.array([*self._lows, (0.5 * (self._piece_from_s + now_s), _low_quantile(self._piece))])
        self._fitted_s = now_s
        times_s, lows_s = points[:, 0] - now_s, points[:, 1]
        self.slope = _drift(times_s, lows_s)
        self._level_s = float(np.min(lows_s - self.slope * times_s))


def _low_quantile(delays_s: list[float]) -> float:
    return sorted(delays_s)[len(delays_s) // _SOONEST_SHARE]


def _drift(times_s: np.ndarray, lows_s: np.ndarray) -> float:
    """Slope of the line through the minima of the intervals; 0 if insignificant."""
    if times_s.size <= _DRIFT_PIECES:
        return 0.0
    times_s = times_s - times_s.mean()
    spread = float(times_s @ times_s)
    slope = float(times_s @ lows_s) / spread
    left_s = lows_s - lows_s.mean() - slope * times_s
    error_s = max(float(np.sqrt(left_s @ left_s / (times_s.size - 2))), _SOONEST_ERROR_S)
    return slope if abs(slope) > max(_DRIFT_LEAST, _DRIFT_ERRORS * error_s / spread**0.5) else 0.0
