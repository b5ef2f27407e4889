"""Redundant gaze of head, eyes and body."""

import numpy as np
import pytest
from builders.control import run
from builders.replays import NECK, at_100_hz

from gazempc.controllers.lookahead import LookAhead
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.controllers.reactive import Reactive
from gazempc.neck.kinematics import look_at_rad
from gazempc.neck.spec import load_neck
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import JointState

EYES, BODY = at_100_hz("reference_eyes"), load_neck("reachy_mini_body")
EYE_LIMIT_DEG = 35.0


def crossing(times_s):
    times = np.asarray(times_s, dtype=np.float64)
    return np.stack([np.full_like(times, 2.0), 1.3 * times - 1.5, np.full_like(times, 0.35)], axis=-1)


def standing(times_s):
    times = np.asarray(times_s, dtype=np.float64)
    return np.tile(2.0 * np.array([np.cos(np.deg2rad(60.0)), np.sin(np.deg2rad(60.0)), 0.0]), (times.size, 1))


def start(neck, path=crossing):
    angles = neck.rest_rad.copy()
    angles[:2] = look_at_rad(neck.geometry, path(0.0))
    return angles


@pytest.mark.parametrize(
    ("make", "neck"), [(LookAhead, EYES), (Mpc, BODY), (Mpc, load_neck("icub")), (LookAhead, load_neck("furhat"))]
)
def test_with_the_true_future_the_gaze_stays_on_the_person(make, neck):
    """Eyes of `icub` have the dead time of its neck; those of all others are faster."""
    ticks = round(2.5 / neck.servo_period_s)
    _, _, error_deg = run(make(neck), neck, crossing, ticks, start_rad=start(neck))
    settled = error_deg[ticks // 2 :]
    assert settled.max() < (0.8 if neck is BODY else 0.3)


@pytest.mark.parametrize("make", [LookAhead, Mpc])
def test_the_eyes_compensate_the_error_of_the_head(make):
    """The head's own error is degrees, and its motion far smoother than without eyes."""
    joints, _, _ = run(make(EYES), EYES, crossing, 250, start_rad=start(EYES))
    alone, _, _ = run(make(NECK), NECK, crossing, 250, start_rad=start(EYES)[:2])
    acceleration, of_alone = (
        np.sqrt(np.mean(np.diff(each[50:, 0], 2) ** 2)) / EYES.servo_period_s**2 for each in (joints, alone)
    )
    assert acceleration < 0.95 * of_alone
    assert 1.0 < np.rad2deg(np.abs(joints[50:, 2])).max() < 20.0


@pytest.mark.parametrize("make", [LookAhead, Mpc])
def test_the_eyes_lead_the_head_in_a_large_shift(make):
    joints, _, error_deg = run(make(EYES), EYES, standing, 300, start_rad=np.zeros(4))
    eye_deg, head_deg = np.rad2deg(joints[:, 2]), np.rad2deg(joints[:, 0])
    at_limit = int(np.flatnonzero(eye_deg > EYE_LIMIT_DEG - 2.0)[0])
    assert head_deg[at_limit] < 1.0
    # The fastest command that the head's limits allow has turned it by 22.4 deg after 0.81 s, by simulation.
    assert EYES.servo_period_s * np.flatnonzero(error_deg < 2.6)[0] < 0.81 + 0.1
    assert abs(eye_deg[-1]) < 5.0
    assert error_deg[-1] < 0.1


def test_reactive_eyes_compensate_the_measured_head():
    """The gaze reaches a person at rest long before the head."""
    joints, _, error_deg = run(
        Reactive(EYES), EYES, lambda t: standing(t) * [1.0, 0.3, 1.0], 100, start_rad=np.zeros(4)
    )
    assert error_deg[30] < 0.1
    assert np.rad2deg(joints[30, 0]) < 1.0


@pytest.mark.parametrize("make", [Reactive, Mpc])
def test_a_body_joint_extends_the_reach_of_the_head(make):
    behind = np.array([-1.0, 1.2, 0.2])
    ticks = round(4.0 / BODY.servo_period_s)
    joints, _, error_deg = run(
        make(BODY), BODY, lambda t: np.tile(behind, (np.size(t), 1)), ticks, start_rad=np.zeros(3)
    )
    assert error_deg[-1] < 0.5
    assert np.rad2deg(joints[-1, 2]) > 60.0


def stuck(joint, stuck_from_s):
    """A neck with one joint blocked from some time on."""

    class Stuck(SimulatedNeck):
        def __init__(self, neck, start_rad, clock_s, seed=0):
            super().__init__(neck, start_rad, clock_s, seed)
            self._clock, self._last = clock_s, float(start_rad[joint])

        def true_state(self):
            state = super().true_state()
            if stuck_from_s <= self._clock():
                position, velocity = state.position_rad.copy(), state.velocity_rad_s.copy()
                position[joint], velocity[joint] = self._last, 0.0
                return JointState(state.time_s, position, velocity)
            self._last = float(state.position_rad[joint])
            return state

    return Stuck


def to_and_fro(times_s):
    times = np.asarray(times_s, dtype=np.float64)
    return np.stack([np.full_like(times, 2.0), 1.2 * np.sin(1.2 * times), np.full_like(times, 0.35)], axis=-1)


@pytest.mark.parametrize(
    ("make", "neck", "joint", "stuck_from_s", "ticks", "most_deg"),
    [
        # The head compensates a blocked eye: otherwise about 7 deg.
        pytest.param(LookAhead, EYES, 2, 0.0, 400, 0.3, id="eye from the start"),
        pytest.param(Mpc, EYES, 2, 1.6, 600, 0.3, id="eye on the way"),
        pytest.param(Mpc, BODY, 2, 1.0, 160, 0.8, id="body"),
        pytest.param(LookAhead, EYES, 0, 0.5, 400, 0.05, id="head"),
    ],
)
def test_redundant_joints_compensate_a_blocked_joint(make, neck, joint, stuck_from_s, ticks, most_deg):
    joints, _, error_deg = run(
        make(neck), neck, to_and_fro, ticks, start_rad=start(neck, to_and_fro), robot_type=stuck(joint, stuck_from_s)
    )
    assert np.ptp(joints[ticks // 2 :, joint]) < 1e-9
    assert np.sqrt(np.mean(error_deg[ticks // 2 :] ** 2)) < most_deg


def test_eyes_at_their_limit_are_an_event():
    plans = []

    class Kept(Mpc):
        def plan(self, situation):
            plans.append(super().plan(situation))
            return plans[-1]

    run(Kept(EYES), EYES, standing, 150, start_rad=np.zeros(4))
    limited = ["eyes_at_limit" in plan.events for plan in plans]
    assert any(limited[:15])
    assert not any(limited[-5:])
