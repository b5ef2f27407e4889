"""Observations passed by the program, one call each."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Mapping
from typing import Any, TypedDict

import numpy as np

from gazempc.live.clock import Clock
from gazempc.live.sources.source import Arrived, check_range
from gazempc.live.stamps import StampReader
from gazempc.types import FloatArray, Sighting
from predictors import HeadObservation

# Length of the queue: more than a second of a fast tracker.
_WAITING_MAX = 1024
# Difference from the present time that indicates a stamp of another clock or unit.
_OTHER_CLOCK_S = 3600.0
_QUATERNION, _COVARIANCE = ((4,), "a unit quaternion w, x, y, z"), ((3, 3), "a covariance in square metres")
_SHAPES = {"head_quat_wxyz": _QUATERNION, "pelvis_quat_wxyz": _QUATERNION, "covariance_m2": _COVARIANCE}


class Stated(TypedDict, total=False):
    """Optional values of `gazempc.live.gaze.Gaze.see`."""

    head_quat_wxyz: Any
    pelvis_quat_wxyz: Any
    covariance_m2: Any
    head_yaw_sd_rad: float | None
    pelvis_yaw_sd_rad: float | None
    person_id: int | str | None
    confidence: float | None


# The corresponding fields of `HeadObservation`.
_FIELDS = {name: name for name in Stated.__annotations__} | {"covariance_m2": "position_covariance_m2"}


class PushedSource:
    """Queue of observations from the thread of a tracker to the loop.

    It ends with the tracker's thread, which opened it.

    Args:
        clock: The loop's clock.
        stamps: Reader of capture times.
    """

    def __init__(self, clock: Clock, stamps: StampReader) -> None:
        self._clock, self._stamps = clock, stamps
        self._arrived: deque[Sighting] = deque(maxlen=_WAITING_MAX)
        self._owner = threading.current_thread()

    def push(self, time_s: float, head_m: Any, stated: Mapping[str, Any]) -> None:
        """Append one observation, from any thread.

        Args:
            time_s: Capture time, seconds.
            head_m: Head in the sensor's frame, shape (3,), metres.
            stated: Values of `Stated` by name; None if there is none.

        Raises:
            ValueError: If a value is invalid; names the field and the accepted values.
            TypeError: If there is no such field.
        """
        if unknown := [name for name in stated if name not in _FIELDS]:
            raise TypeError(f"see() takes no argument {unknown[0]!r}; accepted are {', '.join(_FIELDS)}")
        arrival_s = self._clock.now_s()
        capture_s = self._capture_s(time_s, arrival_s)
        head = checked("head_m", head_m, (3,), "metres in the sensor's frame, x forward, y left, z up")
        check_range(head)
        known = {_FIELDS[name]: _value(name, value) for name, value in stated.items() if value is not None}
        try:
            observation = HeadObservation(capture_s, head, **known)
        except ValueError as error:
            raise ValueError(str(error).replace(_FIELDS["covariance_m2"], "covariance_m2")) from None
        self._arrived.append(Sighting(arrival_s, observation))

    def open(self) -> None:
        """See `gazempc.live.sources.source.Source.open`, in the tracker's thread."""
        self._owner = threading.current_thread()

    def poll(self) -> Arrived:
        """See `gazempc.live.sources.source.Source.poll`."""
        return Arrived(tuple(self._arrived.popleft() for _ in range(len(self._arrived))))

    @property
    def finished(self) -> bool:
        """See `gazempc.live.sources.source.Source.finished`."""
        return not self._owner.is_alive()

    def close(self) -> None:
        """See `gazempc.live.sources.source.Source.close`."""
        self._arrived.clear()

    def _capture_s(self, time_s: Any, arrival_s: float) -> float:
        stamp_s, clock = float(checked("time_s", time_s, (), "a time in seconds")), self._stamps.stamps.clock
        known = {"unix": ("time.time", time.time), "monotonic": ("time.monotonic", time.monotonic)}.get(clock)
        if known is not None and abs(stamp_s - (now_s := known[1]())) > _OTHER_CLOCK_S:
            raise ValueError(
                f"time_s is {stamp_s:.6g}: expected the capture time in seconds as {known[0]}() gives it (now "
                f'{now_s:.1f}), or another clock: clock="unix", "monotonic", "other"'
            )
        return self._stamps.loop_s(stamp_s, arrival_s)


def checked(name: str, value: Any, shape: tuple[int, ...], what: str) -> FloatArray:
    """Validate finite numbers of a shape.

    Args:
        name: Name of the field.
        value: Given value.
        shape: The shape.
        what: Description of the numbers, for the message.

    Returns:
        The numbers.

    Raises:
        ValueError: If they are invalid; names the field and the accepted values.
    """
    wanted = f"expected {what}" + (f", shape {shape}" if shape else "")
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name} is {value!r}: {wanted}") from None
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}: {wanted}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name} is not finite ({array}): {wanted}")
    return array


def _value(name: str, value: Any) -> Any:
    if name in _SHAPES:
        return checked(name, value, *_SHAPES[name])
    if name == "person_id":
        if isinstance(value, bool) or not isinstance(value, int | np.integer | str):
            raise ValueError(f"person_id is {value!r}: expected a whole number or a text")
        return str(value)
    return float(checked(name, value, (), "a number"))
