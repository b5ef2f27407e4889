"""The encoders' readings of the last seconds, for laws that ask where the head was."""

from __future__ import annotations

from collections import deque

from gazempc.types import FloatArray, JointState

KEPT_S = 3.0
# A time this near to the first or last reading is taken for that one's.
_NEAR_S = 0.05


class EncoderHistory:
    """Readings of the last 3 s."""

    def __init__(self) -> None:
        self._readings: deque[JointState] = deque()

    def note(self, reading: JointState) -> None:
        """Take down a reading, later than all before."""
        self._readings.append(reading)
        while self._readings[0].time_s < reading.time_s - KEPT_S:
            self._readings.popleft()

    def at(self, time_s: float) -> FloatArray | None:
        """Pan and tilt at a time: linear between readings, else the nearest end.

        Args:
            time_s: The time, seconds.

        Returns:
            Shape (2,), radians; None if it is more than 0.05 s away from all readings.
        """
        readings = self._readings
        if not readings:
            return None
        first, last = readings[0], readings[-1]
        if time_s <= first.time_s:
            return first.position_rad if first.time_s - time_s <= _NEAR_S else None
        if time_s >= last.time_s:
            return last.position_rad if time_s - last.time_s <= _NEAR_S else None
        # What is asked for is mostly some tenths of a second ago.
        k = len(readings) - 1
        while readings[k].time_s > time_s:
            k -= 1
        before, after = readings[k], readings[k + 1]
        share = (time_s - before.time_s) / (after.time_s - before.time_s)
        between: FloatArray = before.position_rad + share * (after.position_rad - before.position_rad)
        return between
