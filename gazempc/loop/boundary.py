"""Fault isolation: any exception or invalid return value of a part becomes a `PartError` with the class of the part."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np

from gazempc.controllers.controller import ControllerError, Plan
from gazempc.loop.events import Event
from gazempc.parts import error_line
from gazempc.types import FloatArray
from predictors import Forecast

# Plausibility bounds: two turns, more than the range of any joint. Larger values are a wrong unit or a fault.
_ANY_ANGLE_RAD, _ANY_SPEED_RAD_S = 4.0 * np.pi, 1e3
# As for recordings.
_ANY_DISTANCE_M = 1000.0
# Bounds of a forecast: horizon, number of times.
_ANY_HORIZON_S, _MOST_TIMES = 60.0, 5000
# Longer calls are recorded: they use up a quarter of a plan.
SLOW_S = 0.1


class PartError(Exception):
    """A part raised an exception, or returned an invalid value; the text names the class and the method.

    Attributes:
        error: The exception of the part, or of the check of its answer.
    """

    def __init__(self, call: str, error: BaseException) -> None:
        super().__init__(f"{error_line(error)} ({call})")
        self.error = error


# By thread, so that the sending thread can name the call that blocks another one.
_under_way: dict[int, boundary] = {}
_slow: dict[int, str] = {}


def class_of(part: object) -> str:
    """Class name of a part; for a wrapper, of the wrapped part."""
    inner = getattr(part, "wrapped", part)
    return type(inner).__name__ if inner is part else class_of(inner)


class boundary:  # noqa: N801  (as `contextlib.suppress`)
    """Context of a call of a part and of the check of its result.

    Args:
        part: The part.
        method: The method that is called.
        note: Called with the fault, which is then suppressed. None: the fault is raised.

    Raises:
        PartError: In place of any other exception, also of `SystemExit`; but not of an interrupt in the main thread,
            the only one that receives Ctrl-C.
    """

    def __init__(self, part: object, method: str, note: Callable[[PartError], object] | None = None) -> None:
        self._thread, self._note = threading.get_ident(), note
        #: Name of the call, such as ``MyPredictor.forecast()``, and its start time (`time.perf_counter`).
        self.name, self.began_s = f"{class_of(part)}.{method}()", time.perf_counter()

    def __enter__(self) -> None:
        """The call begins."""
        self._outer = _under_way.get(self._thread)
        _under_way[self._thread] = self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        """The call has ended."""
        took_s = time.perf_counter() - self.began_s
        if took_s > SLOW_S:
            _slow[self._thread] = f"{self.name} took {took_s:.3f} s"
        if self._outer is None:
            del _under_way[self._thread]
        else:
            _under_way[self._thread] = self._outer
        if error is None or (
            isinstance(error, KeyboardInterrupt) and threading.current_thread() is threading.main_thread()
        ):
            return False
        fault = error if isinstance(error, PartError) else PartError(self.name, error)
        if self._note is None:
            raise fault from fault.error
        self._note(fault)
        return True


def slow_calls(thread: int, ended: bool = False) -> list[TimeoutError | None]:
    """Slow calls of parts in a thread.

    Args:
        thread: Identifier of the thread.
        ended: Whether the run has ended: a call that has not returned is then included.

    Returns:
        One error a call, with its name and duration; None for a call in progress.
    """
    call, finished = _under_way.get(thread), _slow.pop(thread, "")
    if finished:
        return [TimeoutError(finished)]
    since_s = 0.0 if call is None else time.perf_counter() - call.began_s
    if call is None or since_s <= SLOW_S:
        return []
    return [TimeoutError(f"{call.name} has not returned for {since_s:.3f} s") if ended else None]


def numbers(name: str, value: object, shape: tuple[int, ...]) -> FloatArray:
    """Check an array of real numbers.

    Args:
        name: Name of the array, for the message.
        value: The array.
        shape: Required shape.

    Returns:
        The array, in double precision.

    Raises:
        ValueError: If type, shape or values are invalid.
    """
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiu" and value.shape == shape:
        return np.asarray(value, dtype=np.float64)
    is_what = f"{value.dtype} of shape {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
    raise ValueError(f"{name} is {is_what}, expected an array of real numbers of shape {shape}")


def checked_times(wanted_s: object, start_s: float) -> FloatArray:
    """Check the times for which a controller needs a forecast.

    Args:
        wanted_s: Answer of the controller.
        start_s: Start of its plan, seconds.

    Returns:
        The times, shape (H,), seconds.

    Raises:
        ValueError: If they are not finite, out of bounds or too many.
    """
    times_s = np.asarray(wanted_s)
    numbers("the array of times", times_s, (times_s.size,))
    if not 0 < times_s.size <= _MOST_TIMES or not np.abs(times_s - start_s).max() <= _ANY_HORIZON_S:
        raise ValueError(
            f"{times_s.size} times, expected 1 to {_MOST_TIMES}, finite and within {_ANY_HORIZON_S:g} s of the plan"
        )
    return times_s.astype(np.float64)


def checked_forecast(forecast: object, times: int) -> Forecast:
    """Check a forecast.

    Args:
        forecast: Answer of the predictor.
        times: Number of requested times.

    Returns:
        The forecast.

    Raises:
        TypeError: If it is not a forecast.
        ValueError: If shapes or values are invalid.
    """
    if not isinstance(forecast, Forecast):
        raise TypeError(f"forecast() returned {type(forecast).__name__}, expected a Forecast")
    if np.size(forecast.times_s) != times:
        raise ValueError(f"forecast() returned {np.size(forecast.times_s)} times, asked for were {times}")
    means_m = numbers("means_base_m", forecast.means_base_m, (times, 3))
    covariances_m2 = numbers("covariances_m2", forecast.covariances_m2, (times, 3, 3))
    # An infinite variance is valid; NaN is not.
    if not np.isfinite(means_m).all() or np.isnan(covariances_m2).any():
        raise ValueError("forecast() returned positions that are not finite, or covariances with a NaN")
    if np.abs(means_m).max() > _ANY_DISTANCE_M:
        raise ValueError(f"forecast() returned a head {np.abs(means_m).max():.3g} m away")
    return forecast


def checked_plan(plan: object, joints: int) -> Plan:
    """Check a plan.

    Args:
        plan: Answer of the controller.
        joints: Number of the neck's joints.

    Returns:
        The plan.

    Raises:
        TypeError: If it is not a plan.
        ValueError: If its arrays or events are invalid.
        ControllerError: If a number is not finite or implausible for a neck; with the event.
    """
    if not isinstance(plan, Plan):
        raise TypeError(f"plan() returned {type(plan).__name__}, expected a Plan")
    shape = (len(plan.position_rad), joints)
    for name in ("position_rad", "velocity_rad_s", "acceleration_rad_s2"):
        numbers(name, getattr(plan, name), shape)
    if not all(isinstance(each, tuple | list) for each in (plan.events, plan.faults)):
        raise ValueError(f"events and faults are {plan.events!r} and {plan.faults!r}, expected tuples")
    if not plan.is_finite:
        raise ControllerError("plan() returned numbers that are not finite", Event.PLAN_NOT_FINITE)
    angle_rad, speed_rad_s = (float(np.abs(each).max()) for each in (plan.position_rad, plan.velocity_rad_s))
    if angle_rad > _ANY_ANGLE_RAD or speed_rad_s > _ANY_SPEED_RAD_S:
        reached = f"angles up to {angle_rad:.3g} rad and velocities up to {speed_rad_s:.3g} rad/s"
        raise ControllerError(f"plan() returned {reached}", Event.PLAN_OUT_OF_RANGE)
    return plan
