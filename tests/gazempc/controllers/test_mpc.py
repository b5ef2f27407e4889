"""The MPC controller: dead time, forecast and limits put together."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from gazempc.controllers.controller import CommandState, ControllerError, Situation
from gazempc.controllers.lookahead import LookAhead
from gazempc.controllers.mpc import meeting
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.controllers.mpc.prediction import predict
from gazempc.controllers.mpc.revisions import Revisions
from gazempc.controllers.reactive import Reactive
from gazempc.errors import SettingsError
from gazempc.loop.observer import JointObserver
from gazempc.loop.smoother import Smoother
from gazempc.neck.kinematics import gaze_error_rad, look_at
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.sim.simulated import SimulatedNeck
from predictors import Forecast

NECK = load_neck("reference")


def forecast(times_s, path, sigma_m=np.zeros_like):
    times = np.asarray(times_s)
    return Forecast(times, path(times), sigma_m(times)[:, None, None] ** 2 * np.eye(3), 0.0)


def run(controller, neck, path, ticks, start_rad=(0.0, 0.0), model=None, known=None, sigma_m=np.zeros_like):
    """Closed loop, as the loop does it; returns true joint angles, commands and the gaze error after each tick.

    The future is the true one, or what `known(now, times)` says of it, with standard deviations `sigma_m` of the time
    from now. `neck` is simulated; controller, observer and
    smoother know `model`.
    """
    model = model or neck
    now = 0.0
    observer = JointObserver(model, np.array(start_rad), 0.0)
    smoother = Smoother(model, np.array(start_rad))
    robot = SimulatedNeck(neck, smoother.command.position_rad, lambda: now)
    robot.connect()
    sent = np.tile(smoother.command.position_rad, (400, 1))
    plan, joints, commands, errors = None, [], [], []
    for k in range(ticks):
        now = k * neck.servo_period_s
        true = robot.true_state()
        state = observer.update(now, robot.read_state())
        if k % neck.servo_ticks_per_plan == 0:
            situation = Situation(
                start_s=now,
                forecast=forecast(
                    controller.forecast_times_s(now, now),
                    path if known is None else lambda t, now=now: known(now, t),
                    lambda t, now=now: sigma_m(t - now),
                ),
                command=smoother.command,
                joint_position_rad=state.position_rad,
                joint_velocity_rad_s=state.velocity_rad_s,
                joint_offset_rad=state.offset_rad,
                sent_rad=sent,
                committed_rad=np.zeros((0, 2)),
            )
            plan = controller.plan(situation)
        command = smoother.step(now, plan)
        sent = np.roll(sent, -1, axis=0)
        sent[-1] = robot.send_command(command.position_rad)
        observer.sent(sent[-1])
        joints.append(true.position_rad)
        commands.append(command.position_rad)
        errors.append(float(gaze_error_rad(neck.geometry, true.position_rad, path(np.array([now]))[0])))
    return np.array(joints), np.array(commands), np.rad2deg(errors)


def crossing(times):
    """A person who walks past at 1.2 m/s, 2.5 m away."""
    times = np.asarray(times)
    return np.stack([np.full_like(times, 2.5), 1.5 - 1.2 * times, np.full_like(times, 0.4)], axis=-1)


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


@pytest.mark.parametrize("name", ["reference", "slow"])
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("towards", [True, False])
def test_somebody_who_appears_aside_is_not_passed(name, side, towards):
    """60 deg aside, walking towards where the gaze starts or away from there; the forecast is right."""
    neck = load_neck(name)
    speed_m_s = -1.2 if towards else 0.8

    def path(times):
        times = np.asarray(times)
        y = side * ((2.5 if towards else 1.2) + speed_m_s * times)
        return np.stack([np.full_like(y, 2.5), y, np.full_like(y, 0.2)], axis=-1)

    beside = look_at(neck.geometry, path(0.0)).angles_rad - [side * np.radians(60.0), 0.0]
    joints, _, errors = run(Mpc(neck), neck, path, 700, start_rad=beside)
    aims = look_at(neck.geometry, path(neck.servo_period_s * np.arange(700))).angles_rad[:, 0]
    # At most 0.1 and 0.0031 deg as measured.
    assert np.degrees(np.max(side * (joints[:, 0] - aims))) < 0.11
    assert errors[600:].max() < 0.0036


@pytest.mark.parametrize("name", ["reference", "slow"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_somebody_who_is_misjudged_while_met_is_passed_by_less(name, side, monkeypatch):
    """50 deg aside, walking away; at first the forecast takes them for half as fast again. Contact is not put off."""
    neck = load_neck(name)

    def path(times):
        y = side * (0.9 + 0.9 * np.asarray(times))
        return np.stack([np.full_like(y, 2.5), y, np.zeros_like(y)], axis=-1)

    def misjudged(now, times):
        ahead = np.asarray(times) - now
        return path(now) + np.array([0.0, side * 0.9 * (1.0 + 0.5 * np.exp(-now / 0.3)), 0.0]) * ahead[:, None]

    start = look_at(neck.geometry, path(0.0)).angles_rad - [side * np.radians(50.0), 0.0]
    passed_deg, contact_s = [], []
    for from_rad in (meeting.MEETING_FROM_RAD, np.inf):
        monkeypatch.setattr(meeting, "MEETING_FROM_RAD", from_rad)
        spread = {"sigma_m": lambda ahead_s: 0.02 + 0.05 * ahead_s}
        joints, _, errors = run(Mpc(neck), neck, path, 500, start, known=misjudged, **spread)
        aims = look_at(neck.geometry, path(neck.servo_period_s * np.arange(500))).angles_rad[:, 0]
        passed_deg.append(np.degrees(np.max(side * (joints[:, 0] - aims))))
        contact_s.append(np.argmax(errors < 2.6) * neck.servo_period_s)
    assert passed_deg[0] < passed_deg[1] - 0.1
    assert contact_s[0] < contact_s[1] + 0.02


def test_who_is_met_and_on_which_side_to_stay_short():
    """By hand: a tenth of sigma, less with time; at most a degree; not for what goes on before the neck answers."""
    joint = meeting.Meeting(0.5, -1.0, 1.0)
    sigma = np.radians(3.0)

    def short_deg(start_s, joint_deg, aim_deg, turning_deg_s=0.0, sigma_rad=sigma):
        short = joint.short_rad(start_s, *np.radians([joint_deg, aim_deg, turning_deg_s]), sigma_rad)
        return None if short is None else np.degrees(short)

    assert short_deg(0.0, 0.0, 14.0) is None
    assert short_deg(0.1, 0.0, 30.0, turning_deg_s=40.0) is None  # they went 20 deg before the neck could answer
    assert short_deg(0.2, 0.0, 30.0, turning_deg_s=-40.0) == pytest.approx(0.3)
    assert short_deg(1.2, 5.0, 12.0) == pytest.approx(0.15)
    assert short_deg(1.2, 5.0, 12.0, sigma_rad=np.nan) == pytest.approx(0.5)
    assert short_deg(1.2, 5.0, 12.0, sigma_rad=2.0) == pytest.approx(0.5)
    assert short_deg(1.2, 14.0, 12.0) == pytest.approx(0.15)  # just passed: still short on the side it came from
    assert short_deg(1.2, 15.0, 12.0) == pytest.approx(-0.15)  # they are on the other side
    assert short_deg(2.3, 12.0, 12.0) is None
    assert short_deg(3.0, 12.0, -12.0) == pytest.approx(-0.3)
    joint.reset()
    assert short_deg(3.1, 12.0, 10.0) is None
    # Out of reach, the joint waits at its limit; but it does have to go there.
    assert short_deg(4.0, np.degrees(0.99), 130.0) is None
    assert short_deg(5.0, 0.0, 130.0) == pytest.approx(0.3)
    # An earlier time is that of another run.
    assert short_deg(1.0, 10.0, 12.0) is None


def test_who_comes_back_from_out_of_reach_is_followed_as_if_nothing_had_been():
    """They walk about beyond the pan limit and come into reach again: the joint waits there and is not far off."""

    def returning(times):
        pan = np.radians(130.0 - 30.0 * np.asarray(times))
        return np.stack([2.5 * np.cos(pan), 2.5 * np.sin(pan), np.zeros_like(pan)], axis=-1)

    _, _, errors = run(Mpc(NECK), NECK, returning, 700, start_rad=(NECK.command_limits.position_max_rad[0], 0.0))
    assert errors[int(2.3 / NECK.servo_period_s) :].max() < 0.0015  # 0.0013 as measured


@pytest.mark.parametrize("sigma_m", [np.nan, 1e6])
def test_a_doubt_without_bounds_is_no_reason_not_to_turn(sigma_m):
    """Somebody 50 deg aside whose forecast has no useful covariance is met all the same."""
    joints, _, _ = run(
        Mpc(NECK), NECK, still(np.radians(50.0)), 800, sigma_m=lambda ahead_s: np.full_like(ahead_s, sigma_m)
    )
    assert np.degrees(joints[-1, 0]) == pytest.approx(50.0, abs=1.0)


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
    followed = np.array([smoother.step(k * NECK.servo_period_s, plan).position_rad for k in ticks])
    wanted = np.array([plan.at(k * NECK.servo_period_s).position_rad for k in ticks])
    # Its jerk is within the limits, so nothing keeps the smoother from it.
    assert np.rad2deg(np.abs(followed - wanted)).max() < 1e-9


def still(angle_rad, distance_m=2.5):
    """A person who stands still at an angle."""

    def path(times):
        return np.tile(
            [distance_m * np.cos(angle_rad), distance_m * np.sin(angle_rad), 0.0], (np.asarray(times).size, 1)
        )

    return path


def variant(name="reference", **of_both_axes):
    content = load_neck(name).model_dump()
    for axis in ("pan", "tilt"):
        content[axis] |= of_both_axes
    return NeckSpec.model_validate(content)


def test_a_constant_load_leaves_no_error():
    """Two degrees of load: the MPC looks at the person all the same; a look-ahead stays two degrees off."""
    loaded = variant(load_offset_deg=2.0)
    _, _, errors = run(Mpc(NECK), loaded, still(0.3), 2000, start_rad=(0.3, 0.0), model=NECK)
    assert errors[-1] < 0.02
    _, _, errors = run(LookAhead(NECK), loaded, still(0.3), 2000, start_rad=(0.3, 0.0), model=NECK)
    assert errors[-1] > 2.0


def test_a_load_counts_from_the_first_moment():
    """Without dead time, the joint's own offset is in the state that is planned from."""
    plant, model = variant(load_offset_deg=2.0, dead_time_s=0.0), variant(dead_time_s=0.0)
    _, _, errors = run(Mpc(model), plant, still(0.3), 2000, start_rad=(0.3, 0.0), model=model)
    assert errors[-1] < 0.02


def test_a_horizon_of_too_many_steps_is_refused():
    with pytest.raises(SettingsError, match=r"mpc\.horizon_s.*at most 200 steps"):
        Mpc(NECK.model_copy(update={"control_rate_hz": 200.0}), horizon_s=2.0)


@settings(max_examples=8)
@given(st.floats(0.7, 1.3), st.floats(0.05, 0.6), st.floats(-1.0, 1.0))
def test_a_dead_time_modelled_30_percent_wrong_leaves_it_stable(scale, dead_time_s, far_rad):
    """A person who jumps aside: the joint comes to them, passes them by little, and stays."""
    plant, model = variant(dead_time_s=dead_time_s), variant(dead_time_s=scale * dead_time_s)

    def known(now, times):
        return still(0.0 if now < 0.5 else far_rad)(times)

    joints, _, _ = run(Mpc(model, horizon_s=0.4), plant, still(far_rad), 1600, model=model, known=known)
    off_deg = np.rad2deg(joints[:, 0] - far_rad) * (np.sign(far_rad) or 1.0)
    assert off_deg.max() < 1.0 + 0.12 * abs(np.rad2deg(far_rad))
    assert np.abs(off_deg[-200:]).max() < 0.45  # 0.39 in the worst case found, still shrinking


@settings(max_examples=60)
@given(
    st.fixed_dictionaries(
        {
            "position_min_deg": st.floats(-170, -1),
            "position_max_deg": st.floats(1, 170),
            "velocity_max_rad_s": st.floats(0.05, 8),
            "acceleration_max_rad_s2": st.floats(0.2, 60),
            "jerk_max_rad_s3": st.floats(2, 3000),
            "natural_frequency_rad_s": st.floats(2, 60),
            "damping_ratio": st.floats(0.3, 2),
            "dead_time_s": st.floats(0, 0.6),
        }
    ),
    st.integers(0, 2**32 - 1),
)
def test_any_neck_any_state_any_target_the_command_is_within_limits(axis, seed):
    """Thousands of plans: joints anywhere, targets that jump, also into the neck and behind it, any confidence."""
    rng = np.random.default_rng(seed)
    neck = variant(**axis)
    limits = neck.command_limits
    mpc, smoother = Mpc(neck, horizon_s=0.2), Smoother(neck, rng.uniform(-2, 2, 2))
    ts = neck.servo_period_s
    commands = [smoother.command.position_rad] * 3
    for tick in range(40):
        now = tick * neck.control_period_s
        times = mpc.forecast_times_s(now, now)
        means = rng.uniform(-4, 4, 3) + rng.uniform(-3, 3, 3) * (times - now)[:, None]
        if rng.random() < 0.3:
            means = np.tile(means[0] * 1e-3, (times.size, 1))
        covariance = np.nan if rng.random() < 0.1 else 10 ** rng.uniform(-6, 2)
        situation = Situation(
            start_s=now,
            forecast=Forecast(times, means, np.tile(covariance * np.eye(3), (times.size, 1, 1)), 0.0),
            command=smoother.command,
            joint_position_rad=rng.uniform(-3, 3, 2),
            joint_velocity_rad_s=rng.uniform(-10, 10, 2),
            joint_offset_rad=rng.normal(0, 0.05, 2),
            sent_rad=np.tile(smoother.command.position_rad, (200, 1)),
            committed_rad=np.zeros((0, 2)),
        )
        plan = mpc.plan(situation)
        assert plan.is_finite()
        commands += [smoother.step(now + k * ts, plan).position_rad for k in range(neck.servo_ticks_per_plan)]
    x = np.array(commands)
    assert np.all(x <= limits.position_max_rad + 1e-9)
    assert np.all(x >= limits.position_min_rad - 1e-9)
    bounds = (limits.velocity_max_rad_s, limits.acceleration_max_rad_s2, limits.jerk_max_rad_s3)
    for order, limit in enumerate(bounds, start=1):
        # Third differences of angles carry 1e-16 / ts^3 of rounding.
        assert np.all(np.abs(np.diff(x, order, axis=0)) / ts**order <= limit * (1 + 1e-6) + 1e-8 / ts**order * 1e-5)


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1))
def test_a_start_outside_the_limits_has_a_plan_that_says_so(seed):
    """Commands at up to three times the limits: a finite plan, never an exception; the softened limit is named."""
    rng = np.random.default_rng(seed)
    limits = NECK.command_limits
    mpc = FUZZED
    times = mpc.forecast_times_s(0.0, 0.0)
    command = CommandState(
        limits.position_max_rad * rng.uniform(-3, 3, 2),
        limits.velocity_max_rad_s * rng.uniform(-3, 3, 2),
        limits.acceleration_max_rad_s2 * rng.uniform(-3, 3, 2),
    )
    situation = Situation(
        0.0,
        forecast(times, still(rng.uniform(-3, 3))),
        command,
        rng.uniform(-3, 3, 2),
        rng.uniform(-9, 9, 2),
        np.zeros(2),
        np.zeros((100, 2)),
        np.zeros((0, 2)),
    )
    plan = mpc.plan(situation)
    assert plan.is_finite()
    # An acceleration cannot be outside its limit for longer than it takes to end it: only the first knots may be.
    outside = np.any(np.abs(plan.velocity_rad_s[1:]) > limits.velocity_max_rad_s * (1 + 1e-4))
    assert not outside or "limits_softened" in plan.events


FUZZED = Mpc(NECK, horizon_s=0.3)


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
            followed = smoother.step(now + k * ts, plan).position_rad
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


MPC = Mpc(NECK)


@settings(max_examples=15)
@given(
    st.sampled_from(["reference", "slow", "fetch", "pr2"]),
    st.sampled_from([Reactive, LookAhead, Mpc]),
    st.lists(st.tuples(st.floats(-4, 4), st.floats(-4, 4), st.floats(-2, 2)), min_size=2, max_size=5),
)
def test_whoever_walks_wherever_the_limits_hold(name, kind, places):
    """People who jump about, also behind the robot and into it; every shipped neck and every controller."""
    neck = load_neck(name)
    points = np.array(places)

    def path(times):
        index = np.clip((np.atleast_1d(times) / 0.4).astype(int), 0, len(points) - 1)
        return points[index]

    joints, commands, _ = run(kind(neck), neck, path, 240)
    dt = neck.servo_period_s
    for x in (joints, commands):
        # Before the first tick the neck stood still, straight ahead.
        padded = np.vstack([np.zeros((3, 2)), x])
        assert np.all(padded <= neck.position_max_rad + 1e-9)
        assert np.all(padded >= neck.position_min_rad - 1e-9)
        bounds = (neck.velocity_max_rad_s, neck.acceleration_max_rad_s2, neck.jerk_max_rad_s3)
        for order, limit in enumerate(bounds, start=1):
            assert np.all(np.abs(np.diff(padded, order, axis=0)) / dt**order <= limit * (1 + 1e-6))


def test_nan_in_the_situation_is_a_controller_error():
    controller = Mpc(NECK)
    situation = Situation(
        0.0,
        forecast(controller.forecast_times_s(0.0, 0.0), crossing),
        CommandState(np.full(2, np.nan), np.zeros(2), np.zeros(2)),
        np.zeros(2),
        np.zeros(2),
        np.zeros(2),
        np.zeros((100, 2)),
        np.zeros((0, 2)),
    )
    with pytest.raises(ControllerError, match="not finite"):
        controller.plan(situation)


def test_a_smoothed_look_ahead_trails_a_ramp_by_its_time_constant():
    """The low-pass delays a steady motion by its time constant (to half a control period) and starts where it is."""
    start = look_at(NECK.geometry, crossing(0.0)).angles_rad
    plain, _, _ = run(LookAhead(NECK), NECK, crossing, 360, start_rad=start)
    smooth, _, _ = run(LookAhead(NECK, smoothing_time_s=0.1), NECK, crossing, 360, start_rad=start)
    speed = np.gradient(plain[:, 0], NECK.servo_period_s)[250:]
    assert np.median((smooth - plain)[250:, 0] / -speed) == pytest.approx(0.1, abs=0.015)


def test_reactive_holds_the_latest_position_and_lookahead_the_one_after_all_delays():
    """By hand: the target at -1.2 m/s, commanded for now + 0.4 s + 0.15 s."""
    now = 0.5
    base = {
        "start_s": now,
        "command": CommandState(np.zeros(2), np.zeros(2), np.zeros(2)),
        "joint_position_rad": np.zeros(2),
        "joint_velocity_rad_s": np.zeros(2),
        "joint_offset_rad": np.zeros(2),
        "sent_rad": np.zeros((100, 2)),
        "committed_rad": np.zeros((0, 2)),
    }
    reactive = Reactive(NECK)
    plan = reactive.plan(Situation(forecast=forecast(reactive.forecast_times_s(now, 0.43), crossing), **base))
    assert plan.at(now).position_rad[0] == pytest.approx(np.arctan2(1.5 - 1.2 * 0.43, 2.5))
    ahead = LookAhead(NECK)
    plan = ahead.plan(Situation(forecast=forecast(ahead.forecast_times_s(now, 0.43), crossing), **base))
    assert plan.at(now).position_rad[0] == pytest.approx(np.arctan2(1.5 - 1.2 * (0.5 + 0.55), 2.5))
