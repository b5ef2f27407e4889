"""The smoother: exact tracking of plans, limits, braking at the end of a plan."""

import numpy as np
import pytest
from builders.control import assert_within
from hypothesis import given
from hypothesis import strategies as st

from gazempc.controllers.controller import Plan
from gazempc.loop.smoother import Smoother
from gazempc.neck.limits import narrowed
from gazempc.neck.spec import load_neck

NECK = load_neck("reference")
LIMITS = NECK.command_limits
TS = NECK.servo_period_s


def roll(smoother, plan, ticks, start=0):
    return np.array([smoother.step((start + k) * TS, plan) for k in range(ticks)])


def assert_within_limits(positions, first):
    """From rest at `first`."""
    assert_within(LIMITS, np.vstack([first, positions]), TS)


def feasible_plan(seed, steps=40, share=0.99):
    """A plan within the limits, from random jerks with a simple margin rule."""
    rng = np.random.default_rng(seed)
    h = NECK.control_period_s
    p, v, a = np.zeros(2), np.zeros(2), np.zeros(2)
    knots = [(p, v, a)]
    for _ in range(steps):
        j = rng.uniform(-1, 1, 2) * share * LIMITS.jerk_max_rad_s3
        j = np.where(np.abs(a + j * h) > share * LIMITS.acceleration_max_rad_s2, -20 * a, j)
        j = np.where(np.abs(v + 0.1 * a) > 0.6 * LIMITS.velocity_max_rad_s, -20 * a - 40 * v, j)
        j = np.clip(j, -share * LIMITS.jerk_max_rad_s3, share * LIMITS.jerk_max_rad_s3)
        p, v, a = p + h * v + h**2 / 2 * a + h**3 / 6 * j, v + h * a + h**2 / 2 * j, a + h * j
        knots.append((p, v, a))
    P, V, A = (np.array(x) for x in zip(*knots, strict=True))
    return Plan(-TS, h, P, V, A)


@given(seed=st.integers(0, 10_000))
def test_a_feasible_plan_is_followed_exactly(seed):
    plan = feasible_plan(seed)
    smoother = Smoother(NECK, np.zeros(2))
    ticks = 4 * 39
    followed = roll(smoother, plan, ticks)
    planned = np.array([plan.at(k * TS).position_rad for k in range(ticks)])
    inside = np.all((planned > LIMITS.position_min_rad + 0.3) & (planned < LIMITS.position_max_rad - 0.3), axis=1)
    until = ticks if inside.all() else int(np.argmin(inside))
    assert np.rad2deg(np.abs(followed - planned)[:until]).max(initial=0) < 1e-3
    assert_within_limits(followed, np.zeros(2))


@given(
    st.lists(
        st.tuples(
            st.floats(-6, 6),
            st.floats(-3, 3),
            st.floats(-9, 9),
            st.floats(-9, 9),
            st.floats(-99, 99),
            st.integers(1, 30),
        ),
        min_size=1,
        max_size=12,
    )
)
def test_the_command_stays_within_limits_for_all_plans(targets):
    """Jumping targets far outside, with impossible velocities and accelerations."""
    smoother = Smoother(NECK, np.zeros(2))
    positions, k = [], 0
    for pan, tilt, v_pan, v_tilt, a, ticks in targets:
        plan = Plan(k * TS, 1.0, np.array([[pan, tilt]]), np.array([[v_pan, v_tilt]]), np.array([[a, -a]]))
        positions.append(roll(smoother, plan, ticks, start=k))
        k += ticks
    assert_within_limits(np.vstack(positions), np.zeros(2))


def test_a_ramp_is_caught_and_followed_without_lag():
    """A ramp that starts 10 deg away is caught, then tracked exactly."""
    smoother = Smoother(NECK, np.zeros(2))
    speed = 0.4
    times = np.arange(0, 2.0, 0.02)
    p = np.stack([0.17 + speed * times, np.zeros_like(times)], axis=1)
    plan = Plan(0.0, 0.02, p, np.tile([speed, 0.0], (times.size, 1)), np.zeros_like(p))
    followed = roll(smoother, plan, 300)
    planned = np.array([plan.at(k * TS).position_rad for k in range(300)])
    error_deg = np.rad2deg(np.abs(followed - planned)[:, 0])
    assert error_deg[-1] < 1e-6
    caught_s = np.argmax(error_deg < 0.01) * TS
    assert caught_s < 0.4


def test_the_command_brakes_after_the_end_of_a_plan():
    smoother = Smoother(NECK, np.zeros(2))
    plan = Plan(0.0, 0.02, np.array([[0.0, 0.0], [0.02, 0.0]]), np.full((2, 2), [1.0, 0.0]), np.zeros((2, 2)))
    roll(smoother, plan, 8)
    moving = smoother.command.velocity_rad_s[0]
    assert moving > 0.1
    stopped = roll(smoother, plan, 100, start=8)
    assert smoother.intervention == "stale_plan"
    assert smoother.command.velocity_rad_s == pytest.approx([0, 0], abs=1e-9)
    assert stopped[-1, 0] == pytest.approx(stopped[-20, 0])


@pytest.mark.parametrize("region_deg", [(30.0, 60.0, -10.0, 20.0), (-60.0, -30.0, 5.0, 15.0), (-30.0, 30.0, -9.0, 9.0)])
@pytest.mark.parametrize("at_max", [False, True])
def test_a_command_leaves_the_end_of_a_range_without_zero(region_deg, at_max):
    """Also a range without 0: a neck that starts at the edge of its gaze region leaves it."""
    neck = narrowed(NECK, region_deg, None)
    ends = neck.command_limits.position_min_rad, neck.command_limits.position_max_rad
    start, middle = ends[at_max], sum(ends) / 2.0
    smoother = Smoother(neck, start)
    assert smoother.command.position_rad == pytest.approx(start)
    to_middle = Plan(0.0, np.inf, middle[None], np.zeros((1, 2)), np.zeros((1, 2)))
    back = Plan(0.0, np.inf, start[None], np.zeros((1, 2)), np.zeros((1, 2)))
    for plan in (to_middle, back, to_middle):
        positions = roll(smoother, plan, 400)
        assert positions[-1] == pytest.approx(plan.position_rad[0], abs=1e-6)
        assert np.all((positions >= ends[0] - 1e-9) & (positions <= ends[1] + 1e-9))


def test_without_a_plan_the_command_stops_and_starts_are_clipped():
    smoother = Smoother(NECK, np.array([9.0, -9.0]))
    start = np.array([LIMITS.position_max_rad[0], LIMITS.position_min_rad[1]])
    assert smoother.step(0.0, None) == pytest.approx(start)


def test_the_duration_of_a_step_equals_the_closed_form():
    """Rest to rest over 1 rad at v, a, j limits takes 1/v + v/a + a/j; the command must arrive on that tick."""
    smoother = Smoother(NECK, np.zeros(2))
    plan = Plan(0.0, np.inf, np.array([[1.0, 0.0]]), np.zeros((1, 2)), np.zeros((1, 2)))
    v, a, j = LIMITS.velocity_max_rad_s[0], LIMITS.acceleration_max_rad_s2[0], LIMITS.jerk_max_rad_s3[0]
    positions = roll(smoother, plan, 300)[:, 0]
    arrived_s = (np.argmax(positions > 1.0 - 1e-6) + 1) * TS
    assert arrived_s == pytest.approx(1.0 / v + v / a + a / j, abs=2 * TS)


@given(seed=st.integers(0, 10_000))
def test_a_plan_ending_at_full_acceleration_keeps_the_speed_limit(seed):
    """Each plan accelerates to just below the limit and ends: ending the acceleration needs a margin."""
    rng = np.random.default_rng(seed)
    h, fast, hard = NECK.control_period_s, LIMITS.velocity_max_rad_s, LIMITS.acceleration_max_rad_s2
    knots = [(np.zeros(2), np.zeros(2), np.zeros(2))]
    while np.all(knots[-1][1] < rng.uniform(0.9, 1.0) * fast) and len(knots) < 60:
        p, v, a = knots[-1]
        j = np.minimum(rng.uniform(0.3, 1.0) * LIMITS.jerk_max_rad_s3, (hard - a) / h)
        knots.append((p + h * v + h**2 / 2 * a + h**3 / 6 * j, v + h * a + h**2 / 2 * j, a + h * j))
    P, V, A = (np.array(x) for x in zip(*knots, strict=True))
    P = P - P[-1]
    smoother = Smoother(NECK, P[0])
    assert_within_limits(roll(smoother, Plan(-TS, h, P, V, A), 4 * len(knots) + 200), P[0])
