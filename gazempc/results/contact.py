"""Eye contact in a log: cones, breaks, first contact, overshoot; the head in the picture of a camera that turns."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from pydantic import ValidationError

from gazempc.neck.kinematics import gaze_ray, head_angles_rad, look_at_rad, wrapped_rad
from gazempc.neck.picture import FramedPicture, Framing
from gazempc.results.log import Log
from gazempc.types import BoolArray, FloatArray

# Half width of the cone in which people feel looked at: 5.2 deg diameter, Horstmann & Linke (2021); and wider cones of
# other authors.
CONTACT_DEG = (2.6, 4.0, 9.0)
# Minimum duration of stable contact.
STABLE_S = 0.5
# Contact held for this time after a start of motion counts as kept: the dead time and lag of the slowest neck are over,
# and at 0.3 m/s a person 4 m away has left the cone of 2.6 deg.
_KEPT_S = 1.0
# Time window of overshoot after the first contact.
OVERSHOOT_S = 1.0


def of_known(values: FloatArray | BoolArray, statistic: Callable[[Any], Any] = np.mean) -> float:
    """A statistic of the finite values, such as the mean; NaN without any.

    Args:
        values: Any shape.
        statistic: Function of the finite values, shape (K,).
    """
    known = values[np.isfinite(values)]
    return float(statistic(known)) if known.size else float("nan")


def p95(values: FloatArray) -> float:
    """95th percentile."""
    return float(np.percentile(values, 95))


def share_within(error_deg: FloatArray, limit_deg: float) -> float:
    """Share of ticks with an error within a limit.

    Args:
        error_deg: Gaze errors, shape (M,), degrees.
        limit_deg: Half width of the cone, degrees.

    Returns:
        0 to 1; NaN if an error is unknown.
    """
    return float(np.mean(error_deg <= limit_deg)) if np.isfinite(error_deg).all() else float("nan")


def longest_break_s(log: Log, error_deg: FloatArray, scored: BoolArray) -> float:
    """Longest time without eye contact. A tick lasts until the next one.

    Args:
        log: The run.
        error_deg: Gaze error at each tick, shape (M,), degrees.
        scored: Scored ticks, shape (M,).

    Returns:
        Seconds.
    """
    lasts_s = np.diff(log.time_s, append=log.time_s[-1] + log.neck.servo_period_s)[scored]
    edges = np.flatnonzero(np.diff(error_deg[scored] > CONTACT_DEG[0], prepend=False, append=False))
    until_s = np.concatenate([[0.0], np.cumsum(lasts_s)])
    return float(np.max(until_s[edges[1::2]] - until_s[edges[::2]], initial=0.0))


def overshoot_deg(log: Log, ticks: slice = slice(None)) -> float:
    """Lateral overshoot of the gaze after acquisition from a large error, within 1 s from the first contact.

    Args:
        log: The run.
        ticks: The evaluated part.

    Returns:
        Degrees, 0 without overshoot; NaN if the gaze starts near the person or never reaches them.
    """
    eye_base_m, direction = gaze_ray(log.neck.geometry, log.joint_position_rad[ticks])
    to_head_m, time_s = log.head_true_base_m[ticks] - eye_base_m, log.time_s[ticks]
    off_rad = np.arctan2(direction[:, 1], direction[:, 0]) - np.arctan2(to_head_m[:, 1], to_head_m[:, 0])
    off_deg = np.rad2deg(wrapped_rad(off_rad))
    if not (off_deg.size and abs(off_deg[0]) > CONTACT_DEG[-1]):
        return float("nan")
    passed_deg = -np.sign(off_deg[0]) * off_deg
    there = np.flatnonzero(passed_deg >= -CONTACT_DEG[0])
    if not there.size:
        return float("nan")
    soon = time_s <= time_s[there[0]] + OVERSHOOT_S
    return max(0.0, float(np.nanmax(passed_deg[there[0] :][soon[there[0] :]])))


def time_to(flags: BoolArray, time_s: FloatArray) -> float:
    """Time of the first true flag from the first tick on, seconds; NaN if there is none."""
    hits = np.flatnonzero(flags)
    return float(time_s[hits[0]] - time_s[0]) if hits.size else float("nan")


def time_to_stable(flags: BoolArray, time_s: FloatArray, dt_s: float) -> float:
    """Time of the first contact that lasts 0.5 s.

    Args:
        flags: Contact at each tick, shape (M,).
        time_s: Times of the ticks, shape (M,), seconds.
        dt_s: Servo period, seconds.

    Returns:
        Seconds from the first tick on; NaN if there is none.
    """
    return time_to(_lasting(flags, round(STABLE_S / dt_s)), time_s)


def time_to_return(log: Log, flags: BoolArray, back_s: float) -> float:
    """Time from the return of a person to the first contact that lasts 0.5 s.

    Args:
        log: The run.
        flags: Contact at each tick, shape (M,).
        back_s: Time of the return, seconds; at most the last tick.

    Returns:
        Seconds from the next tick on; the rest of the run if there is none.
    """
    after = log.time_s >= back_s - 1e-9
    times_s = log.time_s[after]
    found_s = time_to_stable(flags[after], times_s, log.neck.servo_period_s)
    return found_s if math.isfinite(found_s) else float(times_s[-1] - times_s[0])


def time_from_start_to_contact(log: Log, error_deg: FloatArray, start_s: float) -> float:
    """Time from a start of motion to the first sustained contact that follows.

    Args:
        log: The run.
        error_deg: Gaze error at each tick, shape (M,), degrees; NaN is no contact.
        start_s: Start of motion, seconds; NaN without one.

    Returns:
        Seconds: 0 if contact holds for the first second, else until it begins to hold for 0.5 s after it was lost.
        Without a return, the time to the end of the run, a lower bound. NaN without a start.
    """
    after = log.time_s >= start_s
    if not after.any():
        return float("nan")
    time_s = log.time_s[after] - start_s
    # No contact is required during gaze aversion.
    contact = (error_deg[after] <= CONTACT_DEG[0]) | log.looks_away[after]
    lost = np.flatnonzero(~contact & (time_s <= _KEPT_S))
    if not lost.size:
        return 0.0
    back = np.flatnonzero(_lasting(contact[lost[0] :], round(STABLE_S / log.neck.servo_period_s)))
    return float(time_s[lost[0] + back[0]] if back.size else time_s[-1])


def _lasting(flags: BoolArray, ticks: int) -> BoolArray:
    """Whether the flag is true at each tick and the ``ticks - 1`` following ones."""
    until_end = np.append(flags, np.zeros(ticks - 1, dtype=np.bool_))
    return np.asarray(np.convolve(until_end, np.ones(ticks), "valid") == ticks)


# Interval of the central difference that estimates the true rate of the head's direction (docs/metrics.md).
_RATE_OVER_S = 0.3
# Observation gap beyond which the head is out of view.
_OUT_OF_SIGHT_S = 0.5


def framing_metrics(log: Log, scored: BoolArray) -> dict[str, float]:
    """Metrics of the framing in the log's settings.

    Args:
        log: The run.
        scored: Ticks of the scored window, shape (M,).

    Returns:
        ``time_in_zone`` and ``time_to_reacquire_s``; NaN without a valid framing of one person, or without a true head.
    """
    picture: FramedPicture | None = None
    with suppress(ValidationError):  # of an older version
        framing = Framing.model_validate(log.run.settings.get("framing", {"subject": "no"}))
        picture = FramedPicture.of(framing, log.neck) if framing.subject == "one" else None
    if picture is None or not log.run.knows_true_head:
        return {"time_in_zone": math.nan, "time_to_reacquire_s": math.nan}
    in_zone = np.all(np.abs(aim_error_rad(log, picture)) <= picture.zone_rad, axis=1)  # NaN is outside
    order = np.argsort(log.capture_time_s, kind="stable")
    back_s = log.arrival_time_s[order][1:][np.diff(log.capture_time_s[order]) > _OUT_OF_SIGHT_S]
    took_s = [time_to_return(log, in_zone, each_s) for each_s in back_s if each_s - 1e-9 <= log.time_s[-1]]
    return {"time_in_zone": float(np.mean(in_zone[scored])), "time_to_reacquire_s": of_known(np.array(took_s))}


def aim_error_rad(log: Log, picture: FramedPicture) -> FloatArray:
    """Error of the camera relative to its reference for the true head, pan and tilt, shape (M, 2), radians."""
    looks_rad = look_at_rad(log.neck.geometry, log.head_true_base_m)
    half = max(1, round(0.5 * _RATE_OVER_S / log.neck.servo_period_s))
    at = np.arange(looks_rad.shape[0])
    before, after = np.maximum(at - half, 0), np.minimum(at + half, at.size - 1)
    turned_rad = wrapped_rad(looks_rad[after, 0] - looks_rad[before, 0])
    aim_rad = picture.aim_rad(looks_rad, turned_rad / np.maximum(log.time_s[after] - log.time_s[before], 1e-9))
    return wrapped_rad(aim_rad - head_angles_rad(log.joint_position_rad))
