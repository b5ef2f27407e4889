"""The head in the picture of a camera that turns: time in zone, and time to reacquire a head that was out of sight."""

from __future__ import annotations

import math

import numpy as np

from gazempc.neck.kinematics import head_angles_rad, look_at_rad
from gazempc.neck.picture import FramedPicture, Framing
from gazempc.results.contact import time_to_stable
from gazempc.results.log import Log
from gazempc.types import BoolArray, FloatArray

# The true rate of the head's direction is a central difference over this time, as of its motion (docs/metrics.md).
_RATE_OVER_S = 0.3
# Longer without an observation, the head was out of sight.
_OUT_OF_SIGHT_S = 0.5


def framing_metrics(log: Log, scored: BoolArray) -> dict[str, float]:
    """Metrics of the framing in the log's settings.

    Args:
        log: The run.
        scored: Ticks of the scored window, shape (M,).

    Returns:
        ``time_in_zone`` and ``time_to_reacquire_s``; NaN without a framing of one person, or without a true head.
    """
    framing = Framing.model_validate(log.run.settings.get("framing", {"subject": "no"}))
    picture = FramedPicture.of(framing, log.neck) if framing.subject == "one" else None
    if picture is None or not log.run.knows_true_head:
        return {"time_in_zone": math.nan, "time_to_reacquire_s": math.nan}
    in_zone = np.all(np.abs(aim_error_rad(log, picture)) <= picture.zone_rad, axis=1)  # NaN is outside
    return {
        "time_in_zone": float(np.mean(in_zone[scored])),
        "time_to_reacquire_s": _time_to_reacquire_s(log, in_zone),
    }


def aim_error_rad(log: Log, picture: FramedPicture) -> FloatArray:
    """How far the camera points beside its aim for the true head, pan and tilt, shape (M, 2), radians."""
    looks_rad = look_at_rad(log.neck.geometry, log.head_true_base_m)
    half = max(1, round(0.5 * _RATE_OVER_S / log.neck.servo_period_s))
    at = np.arange(looks_rad.shape[0])
    before, after = np.maximum(at - half, 0), np.minimum(at + half, at.size - 1)
    turned_rad = _wrapped(looks_rad[after, 0] - looks_rad[before, 0])
    aim_rad = picture.aim_rad(looks_rad, turned_rad / np.maximum(log.time_s[after] - log.time_s[before], 1e-9))
    return _wrapped(aim_rad - head_angles_rad(log.joint_position_rad))


def _wrapped(angle_rad: FloatArray) -> FloatArray:
    wrapped: FloatArray = (angle_rad + np.pi) % (2.0 * np.pi) - np.pi
    return wrapped


def _time_to_reacquire_s(log: Log, in_zone: BoolArray) -> float:
    order = np.argsort(log.capture_time_s, kind="stable")
    seen_s, arrived_s = log.capture_time_s[order], log.arrival_time_s[order]
    took_s = []
    for k in np.flatnonzero(np.diff(seen_s) > _OUT_OF_SIGHT_S) + 1:
        after = log.time_s >= arrived_s[k] - 1e-9
        times_s = log.time_s[after]
        if times_s.size:
            found_s = time_to_stable(in_zone[after], times_s, log.neck.servo_period_s)
            took_s.append(found_s if math.isfinite(found_s) else float(times_s[-1] - times_s[0]))
    return float(np.mean(took_s)) if took_s else math.nan
