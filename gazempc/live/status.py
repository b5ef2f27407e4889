"""What a live run is like at one moment: a frozen value for whoever shows it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Status:
    """A moment of a live run.

    Attributes:
        time_s: Time since the first tick, seconds.
        age_s: Age of the newest observation that was used, from its capture, seconds; None before the first one.
        lost: Whether that is too long ago to go by.
        distance_m: From the eye to the head of this observation, metres; None before the first one.
        observations: How many have arrived so far, readable or not.
        used: How many of them the predictor was given.
        joints_rad: Angles of the joints as estimated, in the order of `NeckSpec.joint_names`, radians.
        gaze_rad: Direction of the gaze in the base frame, pan and tilt, radians.
        aim_rad: Direction of the gaze that the joints are commanded to, radians.
        plan_age_s: Time since the first command of the plan in use, seconds; None without a plan.
        late_ms: How much later than due a tick was at most, since the status before, milliseconds.
        left_out: Ticks left out so far.
        events: Events that began since the status before: time since the first tick, seconds, and name.
    """

    time_s: float
    age_s: float | None
    lost: bool
    distance_m: float | None
    observations: int
    used: int
    joints_rad: tuple[float, ...]
    gaze_rad: tuple[float, float]
    aim_rad: tuple[float, float]
    plan_age_s: float | None
    late_ms: float
    left_out: int
    events: tuple[tuple[float, str], ...]
