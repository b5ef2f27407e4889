"""What happens in a run, one value each: written for viewers as it happens, or from a log afterwards."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from gazempc.results.log import Log
from gazempc.types import FloatArray, JointState


class TickMoment(NamedTuple):
    """One servo tick.

    Attributes:
        time_s: The time, seconds.
        joints: The joints as measured, or where a `JointsMoment` came just before, as they are; None if not known.
        sent_rad: The command that was sent, shape (N,), radians.
        motions: Position, velocity and acceleration of the command, one triple a joint, radians and seconds.
        head_true_base_m: The true head, shape (3,), metres; None or NaN where it is not known.
    """

    time_s: float
    joints: JointState | None
    sent_rad: FloatArray
    motions: tuple[tuple[float, float, float], ...]
    head_true_base_m: FloatArray | None = None


class JointsMoment(NamedTuple):
    """Where the joints of a simulated neck really are at the next tick."""

    joints: JointState


class SeenMoment(NamedTuple):
    """An observation that is used, and the forecast after it.

    Attributes:
        time_s: Time of its arrival, seconds.
        capture_time_s: Time of its capture, seconds.
        head_observed_base_m: The head, shape (3,), metres.
        head_quat_wxyz: Its orientation, shape (4,); None where it was not observed.
        person_id: Whom the sensor took it for; empty where it did not say.
        means_base_m: Forecast at `gazempc.results.log.FORECAST_HORIZONS_S` from the capture, shape (3, 3), metres; NaN
            where there is none.
        covariances_m2: Shape (3, 3, 3), square metres.
        degrees_of_freedom: Of the t distribution that the forecast states.
        true_base_m: True heads at these times, shape (3, 3), metres; None while they are not known.
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
    """A plan whose first command is sent now.

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
    """An event that begins.

    Attributes:
        time_s: The time, seconds.
        name: Its name.
        text: What is known of it: the exception behind it, or its name.
    """

    time_s: float
    name: str
    text: str


class AttendedMoment(NamedTuple):
    """Among several people: who is looked at from now on.

    Attributes:
        time_s: The time, seconds.
        person: Number of the person, in the order in which they entered; 0 for nobody.
        why: Why, in a word.
    """

    time_s: float
    person: int
    why: str


class LateMoment(NamedTuple):
    """How late the next tick begins.

    Attributes:
        late_ms: Later than due, milliseconds.
        skipped: Ticks that are left out before it.
    """

    late_ms: float
    skipped: int


class PictureMoment(NamedTuple):
    """What the camera saw.

    Attributes:
        time_s: Time of its capture, seconds.
        jpeg: The picture.
    """

    time_s: float
    jpeg: bytes


class CutMoment(NamedTuple):
    """A log ends here, and the next one begins."""


Moment = (
    TickMoment
    | JointsMoment
    | SeenMoment
    | PlanMoment
    | EventMoment
    | AttendedMoment
    | LateMoment
    | PictureMoment
    | CutMoment
)


def moments_of(log: Log, plans: Sequence[PlanMoment] = ()) -> Iterator[Moment]:
    """What happened in a run, by its log.

    Args:
        log: The log. Plans, lateness and pictures are not in it.
        plans: The plans of the run, in the order of time, where they were kept.

    Yields:
        Each moment in the order of time.
    """

    def ticks() -> Iterator[tuple[float, int, Moment]]:
        positions = log.command_position_rad.tolist()
        speeds = log.command_velocity_rad_s.tolist()
        accelerations = log.command_acceleration_rad_s2.tolist()
        for k, (time_s, read_s) in enumerate(zip(log.time_s.tolist(), log.joint_time_s.tolist(), strict=True)):
            joints = JointState(read_s, log.joint_position_rad[k], log.joint_velocity_rad_s[k])
            motions = tuple(zip(positions[k], speeds[k], accelerations[k], strict=True))
            known = joints if np.isfinite(joints.position_rad).all() else None
            moment = TickMoment(time_s, known, log.command_position_rad[k], motions, log.head_true_base_m[k])
            yield time_s, 2, moment

    def seen() -> Iterator[tuple[float, int, Moment]]:
        for k, time_s in enumerate(log.arrival_time_s.tolist()):
            yield (
                time_s,
                0,
                SeenMoment(
                    time_s,
                    float(log.capture_time_s[k]),
                    log.head_observed_base_m[k],
                    None,
                    str(log.person_id[k]),
                    log.forecast_mean_base_m[k],
                    log.forecast_covariance_m2[k],
                    float(log.forecast_degrees_of_freedom[k]),
                    log.forecast_true_base_m[k],
                ),
            )

    def events() -> Iterator[tuple[float, int, Moment]]:
        texts = {fault.event: fault.line for fault in log.faults}
        for time_s, name in zip(log.event_time_s.tolist(), log.event_name.tolist(), strict=True):
            yield time_s, 1, EventMoment(time_s, name, texts.get(name, name))

    def attended() -> Iterator[tuple[float, int, Moment]]:
        for row in zip(
            log.attended_time_s.tolist(), log.attended_person.tolist(), log.attended_why.tolist(), strict=True
        ):
            yield row[0], 0, AttendedMoment(*row)

    planned = ((plan.time_s, 1, plan) for plan in plans)
    for _, _, moment in heapq.merge(attended(), seen(), events(), planned, ticks(), key=lambda each: each[:2]):
        yield moment
