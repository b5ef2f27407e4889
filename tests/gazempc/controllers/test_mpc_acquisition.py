"""The MPC on somebody who is off the gaze: met soon, and not passed."""

import numpy as np
import pytest
from builders.control import NECK, run, still

from gazempc.controllers.mpc.acquisition import Acquisition
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.neck.kinematics import look_at
from gazempc.neck.spec import load_neck


@pytest.mark.parametrize("name", ["reference", "slow"])
@pytest.mark.parametrize(("side", "towards"), [(1.0, True), (-1.0, False)])
def test_somebody_who_appears_aside_is_hardly_passed(name, side, towards):
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
    assert np.degrees(np.max(side * (joints[:, 0] - aims))) < 1.0
    assert errors[600:].max() < 0.1


@pytest.mark.parametrize("name", ["reference", "reachy_mini"])
def test_somebody_who_stands_aside_is_hardly_passed(name):
    """20 deg aside, less than what gives bounds: the program that follows gets the joint when it is slow."""
    neck = load_neck(name)
    joints, _, _ = run(Mpc(neck), neck, still(np.radians(20.0)), 300)
    assert np.degrees(joints[:, 0].max()) < 20.45


def test_when_a_joint_is_on_its_way_and_what_it_is_not_to_pass():
    """By hand, in degrees: from 15 off until 2.6 off; bounds only for who was more than 25 off."""
    joint = Acquisition(NECK, 0, 0.1)

    def bounds(joint_deg, aim_deg, joint_deg_s=0.0, turning_deg_s=0.0):
        reference = np.radians([aim_deg, aim_deg + 1.0])
        found = joint.bounds_rad(*np.radians([joint_deg, joint_deg_s]), reference, np.radians(turning_deg_s))
        return None if found is None else np.degrees(found)

    assert bounds(0.0, 14.0) is None
    low, high = bounds(0.0, 16.0)
    assert low.max() < -360.0
    assert high.min() > 360.0
    assert bounds(0.0, 3.0) is not None
    assert bounds(0.0, 2.0) is None
    low, high = bounds(0.0, 30.0, turning_deg_s=10.0)
    assert high == pytest.approx([29.9, 30.9])  # short by half a period of a gap that grows by 10 deg/s
    assert low.max() < -360.0
    low, high = bounds(34.0, 30.0)  # it has passed them, and comes from the other side
    assert low == pytest.approx([30.0, 31.0])
    assert bounds(31.0, 30.0) is None
    assert bounds(0.0, -30.0)[0] == pytest.approx([-30.0, -29.0])
    # On them but too fast to stay, it is on its way, too: by 2.7 deg in the 0.1 s of the other program.
    low, high = bounds(-29.0, -30.0, joint_deg_s=-27.0)
    assert low.max() < -360.0  # who is reached may be passed
    assert high.min() > 360.0
    assert bounds(-29.0, -30.0, joint_deg_s=-25.0) is None
    assert bounds(0.0, 14.0) is None
    # Out of reach the joint waits at its limit, which is where it can be.
    assert bounds(79.0, 130.0) is None


def test_who_comes_back_from_out_of_reach_is_followed_as_if_nothing_had_been():
    """They walk about beyond the pan limit and come into reach again: the joint waits there and is not far off."""

    def returning(times):
        pan = np.radians(130.0 - 30.0 * np.asarray(times))
        return np.stack([2.5 * np.cos(pan), 2.5 * np.sin(pan), np.zeros_like(pan)], axis=-1)

    start_rad = (NECK.command_limits.position_max_rad[0], 0.0)
    _, _, errors = run(Mpc(NECK), NECK, returning, 800, start_rad=start_rad)
    assert errors[int(3.0 / NECK.servo_period_s) :].max() < 0.1


def test_a_forecast_without_a_useful_covariance_is_followed():
    joints, _, _ = run(
        Mpc(NECK), NECK, still(np.radians(50.0)), 800, sigma_m=lambda ahead_s: np.full_like(ahead_s, np.nan)
    )
    assert np.degrees(joints[-1, 0]) == pytest.approx(50.0, abs=1.0)
