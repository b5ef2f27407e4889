"""Errors of the yaws of head and pelvis, and what becomes of them while the person faces away."""

import numpy as np
import pytest
from builders.sensing import correlation, sensor, standing, yaw_errors

from gazempc.sim.sensor import observe

LONG = standing(300.0)
HEAD = {"noise_deg": 2.0, "wander_deg": 8.0, "wander_time_s": 0.8}
PELVIS = {"noise_deg": 1.0, "wander_deg": 6.0, "wander_time_s": 0.3}


def test_each_yaw_has_its_own_white_error_and_wander():
    for part, error in (("head", HEAD), ("pelvis", PELVIS)):
        found = np.degrees(yaw_errors(LONG, part, head_yaw=HEAD, pelvis_yaw=PELVIS))
        variance = error["noise_deg"] ** 2 + error["wander_deg"] ** 2
        assert found.std() == pytest.approx(np.sqrt(variance), rel=0.1)
        for lag in (1, 12):
            expected = error["wander_deg"] ** 2 / variance * np.exp(-lag / 30 / error["wander_time_s"])
            assert correlation(found, lag) == pytest.approx(expected, abs=0.08)


def test_yaw_flips_and_is_lost_only_while_the_person_faces_away():
    """Turning on the spot; of the time facing away a quarter is flipped and an eighth is lost."""
    angle_deg = np.rad2deg(np.linspace(0.0, 2 * np.pi * 50, 300 * 30))
    walk = standing(300.0, facing_away_deg=angle_deg)
    away = np.abs((angle_deg + 180.0) % 360.0 - 180.0) > 120.0
    fate = {"away_deg": 120.0, "lost_share": 0.125, "flipped_share": 0.25, "hold_s": 0.3}
    errors = yaw_errors(walk, pelvis_yaw=fate, part="pelvis")
    lost, flipped = np.isnan(errors), np.abs(np.abs(errors) - np.pi) < 1e-6
    assert not (lost | flipped)[~away].any()
    assert lost[away].mean() == pytest.approx(0.125, abs=0.03)
    assert flipped[away].mean() == pytest.approx(0.25, abs=0.04)
    assert np.abs(errors[~lost & ~flipped]).max() < 1e-9
    assert not np.isnan(yaw_errors(walk, pelvis_yaw=fate, part="head")).any()


def test_a_flip_holds_for_its_mean_time():
    walk = standing(300.0, facing_away_deg=180.0)
    flipped = np.abs(yaw_errors(walk, head_yaw={"flipped_share": 0.5, "hold_s": 0.5})) > 3.0
    # Half of the new draws give the other state: a state holds twice the mean time of a draw.
    changes = np.count_nonzero(np.diff(flipped.astype(int)))
    per_frame = 1 - np.exp(-1 / 30 / 0.5)
    assert changes == pytest.approx(300 * 30 * per_frame / 2, rel=0.1)


def test_stated_sds_of_yaws_are_those_of_white_error_and_wander_where_there_is_a_yaw():
    away = standing(20.0, facing_away_deg=180.0)
    spec = sensor(
        states_covariance=True,
        position_noise_m=0.01,
        yaw_noise_deg=2.0,
        head_yaw={"wander_deg": 4.0, "lost_share": 0.5},
        pelvis_yaw={"reported": False},
    )
    observations = [s.observation for s in observe(away, spec, 0)]
    for each in observations:
        assert each.pelvis_yaw_sd_rad is None
        if each.head_quat_wxyz is None:
            assert each.head_yaw_sd_rad is None
        else:
            assert np.degrees(each.head_yaw_sd_rad) == pytest.approx(np.sqrt(20.0))
    assert {each.head_quat_wxyz is None for each in observations} == {True, False}
