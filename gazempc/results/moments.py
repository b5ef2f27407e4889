"""Moments of a run, one value each: a stream for viewers during the run, or from its log."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gazempc.results.log import Log
from gazempc.types import FloatArray, JointState


class TickMoment(NamedTuple):
    """One servo tick.

    Attributes:
        time_s: The time, seconds.
        joints: Measured joint state, or after a `JointsMoment` the true one; None if unknown.
        sent_rad: The command that was sent, shape (N,), radians.
        motions: Position, velocity and acceleration of the command, one triple a joint, radians and seconds.
        head_true_base_m: The true head, shape (3,), metres; None or NaN if unknown.
    """

    time_s: float
    joints: JointState | None
    sent_rad: FloatArray
    motions: tuple[tuple[float, float, float], ...]
    head_true_base_m: FloatArray | None = None


class JointsMoment(NamedTuple):
    """True joint state of a simulated neck at the next tick."""

    joints: JointState


class SeenMoment(NamedTuple):
    """A used observation, and the forecast after it.

    Attributes:
        time_s: Time of its arrival, seconds.
        capture_time_s: Time of its capture, seconds.
        head_observed_base_m: The head, shape (3,), metres.
        head_quat_wxyz: Its orientation, shape (4,); None if it was not observed.
        person_id: The sensor's name of the person; empty without one.
        means_base_m: Forecast at `gazempc.results.log.FORECAST_HORIZONS_S` from the capture, shape (3, 3), metres; NaN
            without one.
        covariances_m2: Shape (3, 3, 3), square metres.
        degrees_of_freedom: Degrees of freedom of the forecast's t distribution.
        true_base_m: True heads at these times, shape (3, 3), metres; None if unknown.
    """

    time_s: float
    capture_time_s: float
    head_observed_base_m: FloatArray
    head_quat_wxyz: FloatArray | None
    person_id: str
    means_base_m: FloatArray
    covariances_m2: FloatArray
    degrees_of_freedom: float
    true_base_m: FloatArray | None = None


class PlanMoment(NamedTuple):
    """A plan at the time of its first command.

    Attributes:
        time_s: The time, seconds.
        start_s: Time of its first knot, seconds.
        step_s: Time between knots, seconds.
        position_rad: Commanded angles at the knots, shape (K, N), radians.
        latency_ms: Age of its newest observation, milliseconds.
    """

    time_s: float
    start_s: float
    step_s: float
    position_rad: FloatArray
    latency_ms: float


class EventMoment(NamedTuple):
    """Start of an event.

    Attributes:
        time_s: The time, seconds.
        name: Its name.
        text: Its exception, or its name.
    """

    time_s: float
    name: str
    text: str


class AttendedMoment(NamedTuple):
    """Change of the attended one of several people.

    Attributes:
        time_s: The time, seconds.
        person: Number of the person, in order of entry; 0 for none.
        why: Reason, one word.
    """

    time_s: float
    person: int
    why: str


class LateMoment(NamedTuple):
    """Delay of the next tick.

    Attributes:
        late_ms: Delay, milliseconds.
        skipped: Number of ticks skipped before it.
    """

    late_ms: float
    skipped: int


class PictureMoment(NamedTuple):
    """A picture of the camera.

    Attributes:
        time_s: Time of its capture, seconds.
        jpeg: The picture.
    """

    time_s: float
    jpeg: bytes


class StatusMoment(NamedTuple):
    """State of the loop for status lines, four times a second; not logged.

    Attributes:
        time_s: The time, seconds.
        joints_rad: The joints as estimated, shape (N,), radians.
        command_rad: The command, shape (N,), radians.
        capture_time_s: Capture of the newest observation that was used, seconds; None before the first one.
        head_base_m: Its head, shape (3,), metres.
        plan_start_s: Time of the first command of the plan in use, seconds; None without a plan.
        observations: Number of observations so far, readable or not.
        used: Number of those that the predictor used.
    """

    time_s: float
    joints_rad: FloatArray
    command_rad: FloatArray
    capture_time_s: float | None
    head_base_m: FloatArray | None
    plan_start_s: float | None
    observations: int
    used: int


class CutMoment(NamedTuple):
    """Boundary between two logs."""


# Those of a log and of its plans.
LoggedMoment = TickMoment | SeenMoment | PlanMoment | EventMoment | AttendedMoment
Moment = LoggedMoment | JointsMoment | LateMoment | PictureMoment | StatusMoment | CutMoment


def moments_of(log: Log, plans: Sequence[PlanMoment] = ()) -> list[LoggedMoment]:
    """Moments of a run, from its log.

    Args:
        log: The log. Plans, lateness and pictures are not in it.
        plans: The plans of the run in temporal order, if available.

    Returns:
        The moments in temporal order.
    """
    texts = {fault.event: fault.line for fault in log.faults}
    rows = zip(log.attended_time_s.tolist(), log.attended_person.tolist(), log.attended_why.tolist(), strict=True)
    found: list[LoggedMoment] = [AttendedMoment(*row) for row in rows]
    for k, time_s in enumerate(log.arrival_time_s.tolist()):
        forecast = log.forecast_mean_base_m[k], log.forecast_covariance_m2[k], float(log.forecast_degrees_of_freedom[k])
        observed = float(log.capture_time_s[k]), log.head_observed_base_m[k], None, str(log.person_id[k])
        found.append(SeenMoment(time_s, *observed, *forecast, log.forecast_true_base_m[k]))
    events = zip(log.event_time_s.tolist(), log.event_name.tolist(), strict=True)
    found += [EventMoment(time_s, name, texts.get(name, name)) for time_s, name in events]
    found += plans
    commands = np.stack([log.command_position_rad, log.command_velocity_rad_s, log.command_acceleration_rad_s2], axis=2)
    for k, (time_s, motions) in enumerate(zip(log.time_s.tolist(), commands.tolist(), strict=True)):
        joints = JointState(float(log.joint_time_s[k]), log.joint_position_rad[k], log.joint_velocity_rad_s[k])
        known = joints if np.isfinite(joints.position_rad).all() else None
        sent = tuple(map(tuple, motions))
        found.append(TickMoment(time_s, known, log.command_position_rad[k], sent, log.head_true_base_m[k]))
    # Stable: of one time, a tick comes last.
    return sorted(found, key=lambda each: each.time_s)
