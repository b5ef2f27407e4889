"""The MPC on people who walk: dead times, offsets, limits, loads, and what the forecast lags behind."""

import itertools

import numpy as np
import pytest
from builders.control import NECK, crossing, forecast, run, still
from scipy.optimize import linprog

from gazempc.controllers.controller import CommandState, Situation
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.controllers.mpc.prediction import predict
from gazempc.controllers.mpc.revisions import Revisions
from gazempc.loop.smoother import Smoother
from gazempc.neck.kinematics import look_at
from gazempc.neck.spec import load_neck
from predictors import Forecast

MPC = Mpc(NECK)


def earliest_arrival_s(distance_rad, tolerance_rad, steps=60):
    """By linear programming: the first step from which on the joint can be within the tolerance, within limits."""
    p = predict(NECK.pan, NECK, steps, 300.0)
    limits = NECK.command_limits
    bounds = np.repeat(
        [limits.position_max_rad[0], limits.velocity_max_rad_s[0], limits.acceleration_max_rad_s2[0]], steps
    )
    limit_rows = np.vstack([p.command_from_jerk, -p.command_from_jerk])
    limit_values = np.concatenate([bounds, bounds])
    jerk = limits.jerk_max_rad_s3[0] / 300.0
    for first in range(steps):
        there = p.joint_from_jerk[first:]
        found = linprog(
            np.zeros(steps),
            A_ub=np.vstack([limit_rows, there, -there]),
            b_ub=np.concatenate(
                [
                    limit_values,
                    np.full(len(there), distance_rad + tolerance_rad),
                    np.full(len(there), tolerance_rad - distance_rad),
                ]
            ),
            bounds=(-jerk, jerk),
        )
        if found.success:
            return NECK.pan.dead_time_s + (first + 1) * NECK.control_period_s
    raise AssertionError("never")


def test_with_the_true_future_the_gaze_is_on_the_person():
    _, _, errors = run(Mpc(NECK), NECK, crossing, 400, start_rad=look_at(NECK.geometry, crossing(0.0)).angles_rad)
    assert errors[300:].max() < 0.0022  # 0.0019 as measured


@pytest.mark.parametrize("dead_times", [(0.4, 0.4), (0.2513, 0.4), (0.4, 0.1037), (0.0, 0.003)])
def test_fractional_and_different_dead_times(dead_times):
    """Pan and tilt with dead times of their own that are no multiple of a tick: the error stays that of whole ones."""
    axes = {
        name: getattr(NECK, name).model_copy(update={"dead_time_s": dead})
        for name, dead in zip(("pan", "tilt"), dead_times, strict=True)
    }
    neck = NECK.model_copy(update=axes)
    neck.__dict__.pop("dead_time_s", None)

    def path(times):
        position = crossing(times)
        position[..., 2] += 0.3 * np.sin(2.0 * np.asarray(times))
        return position

    start = look_at(neck.geometry, path(0.0)).angles_rad
    _, _, errors = run(Mpc(neck), neck, path, 400, start_rad=start)
    assert errors[300:].max() < 0.0052  # at most 0.0045 as measured


def test_offsets_of_axes_and_eye():
    neck = load_neck("fetch")
    start = look_at(neck.geometry, crossing(0.0)).angles_rad
    _, _, errors = run(Mpc(neck), neck, crossing, 400, start_rad=start)
    assert errors[200:].max() < 0.0046  # 0.0040 as measured


def test_a_person_who_does_what_the_forecast_lags_behind_is_met_sooner(monkeypatch):
    """They speed up for 1.5 s while the forecast says that they go on as they go now, and is sure of that."""

    def speeding_up(times):
        since = np.clip(np.asarray(times, dtype=float) - 1.0, 0.0, 1.5)
        beside = 0.6 * since**2 + 1.8 * np.maximum(np.asarray(times) - 2.5, 0.0)
        return np.stack([np.full_like(beside, 2.5), -1.0 + beside, np.zeros_like(beside)], axis=-1)

    def as_they_go(now, times):
        position, before = speeding_up(np.array([now, now - 1e-4]))
        return position + (position - before) / 1e-4 * (np.asarray(times) - now)[:, None]

    errors = []
    for anticipates in (True, False):
        mpc = Mpc(NECK)
        if not anticipates:
            monkeypatch.setattr(Revisions, "expected_rad", lambda *_: np.zeros(2))
        start = look_at(NECK.geometry, speeding_up(0.0)).angles_rad
        sigma_m = {"sigma_m": lambda ahead_s: 0.02 + 0.05 * ahead_s}
        errors.append(run(mpc, NECK, speeding_up, 800, start, known=as_they_go, **sigma_m)[2])
    with_it, without = (error[int(1.4 / NECK.servo_period_s) : int(2.6 / NECK.servo_period_s)] for error in errors)
    assert with_it.mean() < 0.9 * without.mean()
    assert errors[0][-100:].max() < 0.011  # 0.0094 as measured


def test_step_is_as_fast_as_the_limits_allow():
    """The arrival is that of the linear program, dead time included, and somebody who stands is not passed."""

    def still(times):
        return np.tile([2.5 * np.cos(0.98), 2.5 * np.sin(0.98), 0.0], (np.asarray(times).size, 1))

    joints, _, _ = run(Mpc(NECK, smoothing_time_s=0.02), NECK, still, 300)
    arrived_s = np.argmax(np.abs(joints[:, 0] - 0.98) < 0.02) * NECK.servo_period_s
    assert arrived_s <= earliest_arrival_s(0.98, 0.02) + 3 * NECK.control_period_s
    assert joints[:, 0].max() < 0.98 + np.radians(0.1)
    assert joints[-1, 0] == pytest.approx(0.98, abs=0.005)


def test_a_short_horizon_serves_without_watching_revisions():
    _, _, errors = run(
        Mpc(NECK, horizon_s=0.1), NECK, crossing, 400, start_rad=look_at(NECK.geometry, crossing(0.0)).angles_rad
    )
    assert errors[300:].max() < 1.0


def test_a_command_follows_the_plan():
    controller = Mpc(NECK)
    smoother = Smoother(NECK, np.array([0.5, 0.1]))
    situation = Situation(
        0.0,
        forecast(controller.forecast_times_s(0.0, 0.0), crossing),
        smoother.command,
        np.array([0.5, 0.1]),
        np.zeros(2),
        np.zeros(2),
        np.tile([0.5, 0.1], (100, 1)),
        np.zeros((0, 2)),
    )
    plan = controller.plan(situation)
    ticks = range(int(0.8 / NECK.servo_period_s))
    followed = np.array([smoother.step(k * NECK.servo_period_s, plan) for k in ticks])
    wanted = np.array([plan.at(k * NECK.servo_period_s).position_rad for k in ticks])
    # Its jerk is within the limits, so nothing keeps the smoother from it.
    assert np.rad2deg(np.abs(followed - wanted)).max() < 1e-9


@pytest.mark.parametrize("name", ["reference", "slow", "fetch", "pr2"])
def test_the_smoother_follows_plans_that_use_their_limits(name):
    """A jump of 60 deg, replanned at every control tick: the command is on each plan."""
    neck = load_neck(name)
    mpc, smoother = Mpc(neck), Smoother(neck, np.zeros(2))
    ts, path = neck.servo_period_s, still(np.radians(60.0))
    apart_deg = 0.0
    for tick in range(60):
        now = tick * neck.control_period_s
        command = smoother.command
        situation = Situation(
            now,
            forecast(mpc.forecast_times_s(now, now), path),
            command,
            command.position_rad,
            command.velocity_rad_s,
            np.zeros(2),
            np.tile(command.position_rad, (200, 1)),
            np.zeros((0, 2)),
        )
        plan = mpc.plan(situation)
        for k in range(neck.servo_ticks_per_plan):
            followed = smoother.step(now + k * ts, plan)
            apart_deg = max(apart_deg, np.rad2deg(np.abs(followed - plan.at(now + k * ts).position_rad)).max())
    assert apart_deg < 1e-9
    assert np.rad2deg(smoother.command.position_rad[0]) > 50.0


def test_doubt_makes_the_motion_smoother():
    """The same jump of a forecast, once sure and once not: the planned acceleration falls with confidence."""

    def peak(sigma_m):
        times = MPC.forecast_times_s(0.0, 0.0)
        covariances = np.tile(sigma_m**2 * np.eye(3), (times.size, 1, 1))
        situation = Situation(
            0.0,
            Forecast(times, still(0.05)(times), covariances, 0.0),
            CommandState(np.zeros(2), np.zeros(2), np.zeros(2)),
            np.zeros(2),
            np.zeros(2),
            np.zeros(2),
            np.zeros((100, 2)),
            np.zeros((0, 2)),
        )
        return np.abs(MPC.plan(situation).acceleration_rad_s2[:, 0]).max()

    peaks = [peak(sigma_m) for sigma_m in (0.0, 0.05, 0.1, 0.3, 3.0, np.nan)]
    assert all(later <= earlier + 1e-9 for earlier, later in itertools.pairwise(peaks))
    assert peaks[-1] < 0.5 * peaks[0]
