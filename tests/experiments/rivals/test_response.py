"""Overshoot, settling and reversals of motions whose answers are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from experiments.rivals.trials import overshoot_deg, recontact_s, response, reversals, settling_s
from gazempc.neck.spec import load_neck

TIMES_S = np.arange(0.0, 15.0, 0.005)


def oscillation(zeta: float, wn: float = 4.0):
    wd = wn * np.sqrt(1.0 - zeta**2)
    ringing = np.cos(wd * TIMES_S) + zeta / np.sqrt(1.0 - zeta**2) * np.sin(wd * TIMES_S)
    return 20.0 * (1.0 - np.exp(-zeta * wn * TIMES_S) * ringing)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_second_order_step_overshoots_as_the_textbook_says(sign: float) -> None:
    angle = sign * oscillation(0.3)
    expected = 20.0 * np.exp(-0.3 * np.pi / np.sqrt(1.0 - 0.3**2))
    assert overshoot_deg(angle, sign * 20.0) == pytest.approx(expected, abs=1e-3)
    # Peaks of 20 exp(-k pi zeta / sqrt(1 - zeta^2)); swings between them of 0.5 deg or more turn the joint back.
    peaks = 20.0 * np.exp(-0.3 / np.sqrt(1.0 - 0.09) * np.pi * np.arange(1, 20))
    swings = peaks[:-1] + peaks[1:]
    assert reversals(angle) == np.sum(swings >= 0.5)


def test_a_motion_without_overshoot_has_none_and_never_turns() -> None:
    angle = 20.0 * (1.0 - np.exp(-TIMES_S / 0.5))
    assert overshoot_deg(angle, 20.0) == pytest.approx(0.0, abs=1e-6)
    assert reversals(angle) == 0
    assert overshoot_deg(np.full(10, 3.0), 3.0) == 0.0


def test_settling_is_the_last_way_in() -> None:
    # exp(-t / 0.5) 20 deg is 1 deg at 0.5 ln 20.
    assert settling_s(TIMES_S, -20.0 * np.exp(-TIMES_S / 0.5), 1.0) == pytest.approx(0.5 * np.log(20.0), abs=0.005)
    late = np.where((TIMES_S > 7.0) & (TIMES_S < 8.0), 3.0, 0.0)
    assert settling_s(TIMES_S, late, 2.6) == pytest.approx(8.0, abs=0.005)
    assert settling_s(TIMES_S, np.full(TIMES_S.size, 5.0), 2.6) == TIMES_S[-1]
    assert settling_s(TIMES_S, np.zeros(TIMES_S.size), 1.0) == 0.0


def log_of(pan_deg, truth_deg):
    angles = np.deg2rad(np.stack([pan_deg, np.zeros(pan_deg.size)], axis=1))
    there = np.deg2rad(truth_deg)
    head_m = 2.0 * np.stack([np.cos(there), np.sin(there), np.zeros(there.size)], axis=1)
    return SimpleNamespace(
        time_s=TIMES_S, joint_position_rad=angles, head_true_base_m=head_m, neck=load_neck("reference")
    )


def test_who_settles_beside_the_face_rests_off_it() -> None:
    pan_deg = np.full(TIMES_S.size, 12.0)
    assert response(log_of(pan_deg, pan_deg + 8.0), 0.0, 0)["rest_error_deg"] == pytest.approx(8.0)


def test_back_in_contact_counts_from_the_return_and_must_last() -> None:
    truth = np.zeros(TIMES_S.size)
    off = np.where((TIMES_S < 4.0) | ((TIMES_S > 4.3) & (TIMES_S < 6.0)), 10.0, 1.0)
    assert recontact_s(log_of(off, truth), 3.0) == pytest.approx(3.0, abs=0.006)
    assert recontact_s(log_of(truth + 10.0, truth), 3.0) == pytest.approx(TIMES_S[-1] - 3.0)
