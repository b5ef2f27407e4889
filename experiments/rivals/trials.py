"""Trials: motion of a person in front of the robot, and metrics of the head's response: overshoot, settling, reversals.

The metrics are defined here, in the absence of published definitions. Directions are relative to the robot's base, pan
positive to the left and tilt positive up.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import LeftOutError, PlacementError
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.recordings.recording import Labels, Recording, Track
from gazempc.results.contact import CONTACT_DEG
from gazempc.results.log import Log
from gazempc.results.metrics import gaze_error_deg
from gazempc.results.motion import reversals
from gazempc.types import FloatArray

# Onset of the face: the whole response is scored.
SHOWN_FROM_S = 1.0
FRAME_RATE_HZ = 100.0
# As in the published trials: 1 to 2 m away, 15 s. Angles, which are not published, are large enough for a clear head
# turn; a face at 1.2 m or 1.6 m in front of a camera at a height of 1.0 m.
STILL_DISTANCE_M, STILL_S = 1.5, 15.0
SIDES_DEG = {"centre": 0.0, "left": 20.0, "right": -20.0}
HEIGHTS_DEG = {"seated": 8.0, "standing": 22.0}
STILL = tuple(f"still_{height}_{side}" for height in HEIGHTS_DEG for side in SIDES_DEG)
STEP_DEG, STEP_AT_S, STEP_S = 30.0, 3.0, 11.0
RAMP_DEG_S, RAMP_FROM_S, RAMP_S, RAMP_ENDS_S = 20.0, 3.0, 4.0, 12.0
MOVES_DISTANCE_M, MOVES_TILT_DEG = 2.0, 10.0
HEIGHT_M = 1.2
PASSES_M = {"pass_1.0m": 1.0, "pass_2.5m": 2.5}
TURNS, TURN_DISTANCE_M = "turns", 2.5
LOSS, LOSS_S = "loss", 1.0
# A walk with a stop at its end, for `experiments.rivals.framing`.
STOP = "stop"
# The loss begins after this share of the walk.
_LOSS_AFTER = 0.35
# The person stands at the end, so that slow laws can regain contact.
STANDS_S, _STOP_TIME_S, _PACE_S = 4.0, 0.2, 0.1
# Recorded standing or sitting people, at the distance of the motionless face.
STAND, SIT = f"stand_{STILL_DISTANCE_M:g}m", f"sit_{STILL_DISTANCE_M:g}m"
POSTURES = (STAND, SIT)
# Trials on walks, with means over people.
WALKS = (*PASSES_M, TURNS)
ALONE = (*STILL, "step", "ramp")
TRIALS = (*ALONE, *POSTURES, *WALKS, LOSS)


@dataclass(frozen=True)
class Trial:
    """One person in front of the robot.

    Attributes:
        name: One of `TRIALS`.
        walk: The person in the base frame, from time 0.
        start_rad: Initial pan and tilt; None for the direction of the first observed head.
        event_s: Onset of the response, seconds; None without a timed response.
        joint: Joint of the response: 0 for pan; 1 for tilt, with the person straight ahead.
        back_s: Time at which the face reappears after a loss, seconds; None without a loss.
    """

    name: str
    walk: Recording
    start_rad: tuple[float, float] | None = None
    event_s: float | None = None
    joint: int = 0
    back_s: float | None = None


def takes(trial: str, labels: Labels) -> bool:
    """Whether a recording is applicable to a trial.

    Args:
        trial: One of `POSTURES` for people who stay, else one on walks.
        labels: Labels of the recording. Defaults: straight for a walk without a group; standing for a person who stays,
            unless the kind is ``sitting``.
    """
    if trial in POSTURES:
        return (trial == SIT) == (labels.activity == "sitting")
    return (trial == TURNS) == (labels.group not in (None, "straight"))


def make_trial(name: str, recording: str | None) -> Trial:
    """Construct a trial.

    Args:
        name: One of `TRIALS`.
        recording: For trials on recorded people: a synthetic name or a path.

    Returns:
        The trial.

    Raises:
        LeftOutError: If the walk comes too near to the robot, or is too short.
    """
    if name in STILL:
        _, height, side = name.split("_")
        tilt_deg, pan_deg = HEIGHTS_DEG[height], SIDES_DEG[side]
        walk = _alone(name, STILL_S + SHOWN_FROM_S, lambda t: np.full(t.size, pan_deg), tilt_deg, STILL_DISTANCE_M)
        return Trial(name, _hidden(walk, -1.0, SHOWN_FROM_S), (0.0, 0.0), SHOWN_FROM_S, int(side == "centre"))
    if name in ALONE:
        return _moving(name)
    if recording is None:
        raise ValueError(f"trial {name!r} needs a recording")
    try:
        distance_m = STILL_DISTANCE_M if name in POSTURES else PASSES_M.get(name, TURN_DISTANCE_M)
        walk = place(load(recording), "side", distance_m, HEIGHT_M)
    except PlacementError as error:
        raise LeftOutError(str(error)) from None
    if name != LOSS:
        return Trial(name, _stopping(walk) if name == STOP else walk)
    lost_s = _LOSS_AFTER * float(walk.times_s[-1])
    back_s = lost_s + LOSS_S
    if back_s > walk.times_s[-1]:
        raise LeftOutError(f"{walk.name}: {walk.times_s[-1]:.2f} s is too short for a loss of {LOSS_S:g} s")
    return Trial(name, _hidden(_stopping(walk), lost_s, back_s), back_s=back_s)


def _moving(name: str) -> Trial:
    def step_deg(times_s: FloatArray) -> FloatArray:
        return np.where(times_s < STEP_AT_S, -STEP_DEG / 2.0, STEP_DEG / 2.0)

    def ramp_deg(times_s: FloatArray) -> FloatArray:
        return RAMP_DEG_S * (np.clip(times_s - RAMP_FROM_S, 0.0, RAMP_S) - RAMP_S / 2.0)

    ramp = ramp_deg, RAMP_ENDS_S, RAMP_FROM_S + RAMP_S
    pan_deg, ends_s, event_s = (step_deg, STEP_S, STEP_AT_S) if name == "step" else ramp
    return Trial(name, _alone(name, ends_s, pan_deg, MOVES_TILT_DEG, MOVES_DISTANCE_M), event_s=event_s)


def _alone(
    name: str, duration_s: float, pan_deg: Callable[[FloatArray], FloatArray], tilt_deg: float, distance_m: float
) -> Recording:
    """A person who faces the robot, at a pan angle as a function of time."""
    times_s = np.arange(round(duration_s * FRAME_RATE_HZ) + 1) / FRAME_RATE_HZ
    pan, tilt = np.deg2rad(pan_deg(times_s)), np.deg2rad(tilt_deg)
    ground_m = distance_m * np.cos(tilt)
    head_m = np.stack([ground_m * np.cos(pan), ground_m * np.sin(pan), np.full(pan.size, distance_m * np.sin(tilt))], 1)
    faces = Rotation.from_euler("z", (pan + np.pi)[:, None]).as_quat(scalar_first=True)
    track = Track(
        head_position_m=head_m,
        head_quat_wxyz=faces,
        pelvis_position_m=head_m - [0.0, 0.0, 0.7],
        pelvis_quat_wxyz=faces,
    )
    return Recording(name, "synthetic", "synthetic", times_s, track, None, True, Labels(subject="synthetic"))


def _stopping(walk: Recording) -> Recording:
    """The walk, extended by a stop and standing."""
    track, period_s = walk.truth, float(np.median(np.diff(walk.times_s)))
    valid = np.flatnonzero(track.valid)
    last, before = valid[-1], valid[valid <= valid[-1] - max(round(_PACE_S / period_s), 1)][-1]
    since_s = period_s * np.arange(1, round(STANDS_S / period_s) + 1)
    # Exponential decay of the speed: stopping distance of a step or less.
    share = _STOP_TIME_S * (1.0 - np.exp(-since_s / _STOP_TIME_S)) / (walk.times_s[last] - walk.times_s[before])

    def stops(rows: FloatArray) -> FloatArray:
        return np.concatenate([rows[: last + 1], rows[last] + share[:, None] * (rows[last] - rows[before])])

    def stays(rows: FloatArray) -> FloatArray:
        return np.concatenate([rows[: last + 1], np.tile(rows[last], (since_s.size, 1))])

    longer = _each(track, lambda name, rows: (stops if name.endswith("_m") else stays)(rows))
    times_s = np.concatenate([walk.times_s[: last + 1], walk.times_s[last] + since_s])
    return replace(walk, times_s=times_s, truth=longer, measured=None)


def _hidden(walk: Recording, from_s: float, to_s: float) -> Recording:
    """The walk without observations for an interval."""
    hidden = (walk.times_s >= from_s) & (walk.times_s < to_s)
    seen = _each(walk.truth, lambda _, rows: np.where(hidden[:, None], np.nan, rows))
    return replace(walk, truth=seen, measured=None)


def _each(track: Track, change: Callable[[str, FloatArray], FloatArray]) -> Track:
    """The track with a function applied to positions and orientations."""
    return Track(*(change(name, rows) for name, rows in vars(track).items()))


# Interval at the end whose median is the final angle.
_FINAL_S = 3.0
SETTLED_DEG = (1.0, CONTACT_DEG[0])
# Least amplitude of a move.
_SWING_DEG = 0.5


def response(log: Log, event_s: float, joint: int) -> dict[str, float]:
    """Metrics of a joint's transient response to an event.

    Args:
        log: The run.
        event_s: Time of the event, seconds.
        joint: 0 for the pan, 1 for the tilt.

    Returns:
        ``overshoot_deg``, ``settling_s`` (to 1 deg), ``settling_2p6_s`` and ``reversals``; settling times are censored
        at the end of the run. ``rest_error_deg`` is the steady-state gaze error, the median of the last 3 s, which
        detects laws that settle off the face.
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
    """Maximum excursion beyond the final angle in the direction of the first move.

    Args:
        angle_deg: The joint's angle over time, shape (N,), degrees.
        final_deg: The final angle, degrees.

    Returns:
        Degrees; 0 without overshoot, or for a move below the least amplitude.
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
        Seconds; the last time if it does not settle.
    """
    outside = np.flatnonzero(np.abs(error_deg) > within_deg)
    if not outside.size:
        return 0.0
    return float(times_s[min(outside[-1] + 1, times_s.size - 1)])
