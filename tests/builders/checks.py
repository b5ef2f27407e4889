"""Invariants of every live run, checked independently of the code under test."""

import functools

import numpy as np

from builders.live import NECK, TS, run_live
from gazempc.neck.kinematics import look_at_rad
from gazempc.neck.picture import FramedPicture, Framing
from gazempc.results.motion import readings


def assert_within_limits(positions_rad, starts_rad=None, breaks=(), ends=False, rests=True):
    """Check position and its differences against the limits of the neck, independently of the code under test.

    During robot silence (`breaks`: index of the first command after it) the robot stops, limits or not: each
    part is checked from rest on, or (not `rests`) by itself, as after a short silence the motion continues
    from possibly executed commands. After a run that `ends` the robot holds the last command.
    """
    low = np.deg2rad([NECK.pan.position_min_deg, NECK.tilt.position_min_deg])
    high = np.deg2rad([NECK.pan.position_max_deg, NECK.tilt.position_max_deg])
    assert np.all(np.isfinite(positions_rad))
    assert np.all((positions_rad >= low - 1e-9) & (positions_rad <= high + 1e-9))
    parts = np.split(positions_rad, breaks)
    before = positions_rad[0] if starts_rad is None else starts_rad
    for part in parts:
        if not len(part):
            continue
        padded = np.vstack([np.tile(before, (3, 1)), part]) if rests or part is parts[0] else part
        before = part[-1]
        if ends and part is parts[-1]:
            padded = np.vstack([padded, np.tile(before, (3, 1))])
        names = ("velocity_max_rad_s", "acceleration_max_rad_s2", "jerk_max_rad_s3")[: len(padded) - 1]
        for order, name in enumerate(names, 1):
            limit = np.array([getattr(NECK.pan, name), getattr(NECK.tilt, name)])
            worst = np.abs(np.diff(padded, order, axis=0)).max(axis=0) / TS**order
            assert np.all(worst <= limit * (1 + 1e-6)), f"{name}: {worst} > {limit}"


def assert_sound(result, start_rad=None):
    """A command at every tick; sent and logged commands are equal; all are within limits until rest."""
    sent = result.joined("command_position_rad")
    assert len(sent) == result.report.ticks
    received = np.array([position for _, position in result.robot.received])
    assert np.array_equal(received, sent)
    assert_within_limits(sent, start_rad, ends=True)
    # Each observation is used, or refused for exactly one reason.
    assert result.used + sum(result.refused.values()) == result.report.observations
    assert result.robot.calls[-1] == "close"
    assert result.source.calls[-1] == "close"


@functools.cache
def undisturbed():
    """The run without faults, longer than every run compared with it."""
    return run_live(duration_s=6.6)


def assert_recovered(result, from_s, within_deg=0.3):
    """From `from_s` on the gaze error equals that without the fault, and at some time before it does not."""
    reference, now = undisturbed(), result.joined("time_s")
    until_s = min(result.ended_s, reference.ended_s)
    scored = (now >= from_s) & (now < until_s)
    usual_deg = np.interp(now[scored], reference.joined("time_s"), reference.error_deg)
    after = np.abs(result.error_deg[scored] - usual_deg)
    assert after.size > 1.0 / TS
    assert after.max() < within_deg


def assert_same_commands(result, within_rad):
    """Until the stop, the commands equal those without the fault."""
    sent = result.joined("command_position_rad")[result.joined("time_s") < result.ended_s]
    usual = undisturbed().joined("command_position_rad")[: len(sent)]
    assert len(sent) > 2.0 / TS
    np.testing.assert_allclose(sent, usual, atol=within_rad, rtol=0)


def in_zone(log):
    """Share of the observations, from 3 s on, within the zone of the picture at their capture."""
    picture = FramedPicture.of(Framing.model_validate(log.run.settings["framing"]), log.neck)
    looks_rad = look_at_rad(log.neck.geometry, log.head_observed_base_m)
    seen_s, read = log.capture_time_s, readings(log)
    at_rad = np.stack([np.interp(seen_s, read.time_s, read.position_rad[:, k]) for k in range(2)], axis=1)
    turning_rad_s = np.gradient(looks_rad[:, 0], seen_s)
    inside = np.abs(picture.aim_rad(looks_rad, turning_rad_s) - at_rad) <= picture.zone_rad
    return float(np.all(inside, axis=1)[seen_s > 3.0].mean())
