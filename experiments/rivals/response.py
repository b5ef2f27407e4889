"""The answer of a head to a face: overshoot, settling, reversals. The definitions are ours; none is published."""

from __future__ import annotations

import math

import numpy as np

from gazempc.results.contact import CONTACT_DEG, time_to_stable
from gazempc.results.log import Log
from gazempc.results.metrics import gaze_error_deg
from gazempc.results.motion import reversals
from gazempc.types import FloatArray

# The final angle is the median of so long at the end.
_FINAL_S = 3.0
SETTLED_DEG = (1.0, CONTACT_DEG[0])
# A smaller move is none.
_SWING_DEG = 0.5


def response(log: Log, event_s: float, joint: int) -> dict[str, float]:
    """How a joint answers to something that happens at a time.

    Args:
        log: The run.
        event_s: When the answer begins, seconds.
        joint: 0 for the pan, 1 for the tilt.

    Returns:
        ``overshoot_deg``, ``settling_s`` (to 1 deg), ``settling_2p6_s`` and ``reversals``. What never settles settles
        at the end of the run. ``rest_error_deg`` is how far from the face the gaze is then, the median of the last 3 s:
        a law that settles beside the face has not answered it.
    """
    after = log.time_s >= event_s - 1e-9
    times_s = log.time_s[after] - event_s
    joints_deg = np.rad2deg(log.joint_position_rad[after])
    final_deg = np.median(joints_deg[times_s >= times_s[-1] - _FINAL_S], axis=0)
    angle_deg, final = joints_deg[:, joint], float(final_deg[joint])
    return {
        "overshoot_deg": overshoot_deg(angle_deg, final),
        "settling_s": settling_s(times_s, angle_deg - final, SETTLED_DEG[0]),
        "settling_2p6_s": settling_s(times_s, angle_deg - final, SETTLED_DEG[1]),
        "reversals": float(reversals(angle_deg)),
        "rest_error_deg": float(np.median(gaze_error_deg(log)[log.time_s >= log.time_s[-1] - _FINAL_S])),
    }


def overshoot_deg(angle_deg: FloatArray, final_deg: float) -> float:
    """Largest excursion past the final angle in the direction of the first move.

    Args:
        angle_deg: The joint's angle over time, shape (N,), degrees.
        final_deg: The final angle, degrees.

    Returns:
        Degrees; 0 without one, or if the joint hardly moves.
    """
    moved = np.flatnonzero(np.abs(angle_deg - angle_deg[0]) >= _SWING_DEG)
    if not moved.size:
        return 0.0
    way = math.copysign(1.0, angle_deg[moved[0]] - angle_deg[0])
    return max(0.0, float(np.max(way * (angle_deg - final_deg))))


def settling_s(times_s: FloatArray, error_deg: FloatArray, within_deg: float) -> float:
    """First time after which an error stays within a bound to the end.

    Args:
        times_s: Shape (N,), seconds, from 0.
        error_deg: Shape (N,), degrees.
        within_deg: The bound, degrees.

    Returns:
        Seconds; the last time if it never does.
    """
    outside = np.flatnonzero(np.abs(error_deg) > within_deg)
    if not outside.size:
        return 0.0
    return float(times_s[min(outside[-1] + 1, times_s.size - 1)])


def recontact_s(log: Log, back_s: float) -> float:
    """How long after the face is back the gaze is on it again, for at least 0.5 s.

    Args:
        log: The run.
        back_s: When the face is back, seconds.

    Returns:
        Seconds; the rest of the run if it never is.
    """
    after = log.time_s >= back_s - 1e-9
    times_s = log.time_s[after]
    found = time_to_stable(gaze_error_deg(log)[after] <= CONTACT_DEG[0], times_s, log.neck.servo_period_s)
    return found if math.isfinite(found) else float(times_s[-1] - times_s[0])
