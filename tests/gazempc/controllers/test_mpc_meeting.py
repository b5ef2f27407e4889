"""The MPC on somebody who appears aside: met soon, and not passed."""

import numpy as np
import pytest
from builders.control import NECK, run, still

from gazempc.controllers.mpc import meeting
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.neck.kinematics import look_at
from gazempc.neck.spec import load_neck


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
