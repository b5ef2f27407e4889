"""Motion of joints, head and eyes: by hand, and the same whenever the joints happen to be read."""

import dataclasses

import numpy as np
import pytest
from builders.attention import attention_log, of_motion

from gazempc.neck.spec import load_neck
from gazempc.results.metrics import measure
from gazempc.results.motion import derivative

REFERENCE, EYES = load_neck("reference"), load_neck("reference_eyes")
PERIOD_S = REFERENCE.servo_period_s
TEMPLATE = attention_log(np.zeros(10))
LENGTH_S, AMPLITUDE_RAD, SPEED_RAD_S = 6.0, 0.4, 3.0
EVEN_S = np.arange(0.0, LENGTH_S, PERIOD_S)
PEAKS = {
    "peak_velocity_rad_s": AMPLITUDE_RAD * SPEED_RAD_S,
    "peak_acceleration_rad_s2": AMPLITUDE_RAD * SPEED_RAD_S**2,
    "peak_jerk_rad_s3": AMPLITUDE_RAD * SPEED_RAD_S**3,
}


def swing_rad(time_s):
    return AMPLITUDE_RAD * np.sin(SPEED_RAD_S * time_s)


def moved(neck, joints_rad, read_s, time_s=EVEN_S, kind="live"):
    """A log of a motion: `joints_rad` (M, N) read at `read_s`."""
    run = TEMPLATE.run.model_copy(update={"neck": neck, "kind": kind, "mode": "live", "joints": "measured"})
    return of_motion(TEMPLATE, time_s, joints_rad, np.full((time_s.size, 3), np.nan), run=run, joint_time_s=read_s)


def pan_swings(time_s, read_s):
    return moved(REFERENCE, np.stack([swing_rad(read_s), 0.0 * read_s], axis=1), read_s, time_s)


def jittered(seed=1):
    """Ticks of a busy computer: most a little late, some by nearly a period, some left out."""
    rng = np.random.default_rng(seed)
    late_s = np.minimum(rng.exponential(0.0005, EVEN_S.size), 0.99 * PERIOD_S)
    late_s[rng.random(EVEN_S.size) < 0.02] = 0.98 * PERIOD_S
    return (EVEN_S + late_s)[rng.random(EVEN_S.size) > 0.03]


def test_figures_of_a_known_motion_at_even_and_at_uneven_ticks():
    even = measure(pan_swings(EVEN_S, EVEN_S))
    uneven = jittered()
    by_period = np.abs(np.diff(swing_rad(uneven), 2)).max() / PERIOD_S**2
    assert by_period > 10 * PEAKS["peak_acceleration_rad_s2"], "the nominal period would do as well"
    live = measure(pan_swings(uneven, uneven))
    for name, peak in PEAKS.items():
        for found in (even, live):
            assert getattr(found, name) <= peak * (1 + 1e-6)
            assert getattr(found, name) > 0.99 * peak
    scored = EVEN_S[EVEN_S >= 1.0]
    rms = np.sqrt(np.mean((SPEED_RAD_S**2 * swing_rad(scored)) ** 2))
    for found in (even, live):
        assert found.rms_acceleration_rad_s2 == pytest.approx(rms, rel=0.02)
    assert live.sparc == pytest.approx(even.sparc, rel=0.01)
    assert live.ldlj == pytest.approx(even.ldlj, rel=0.02)


def test_a_robot_that_reports_less_often_than_it_is_asked_or_not_at_all_for_a_while():
    """Every reading stands in the log for three ticks; some ticks have none."""
    read_s = EVEN_S[(np.arange(EVEN_S.size) // 3) * 3] - 0.002
    log = pan_swings(EVEN_S, read_s)
    silent = (EVEN_S > 3.0) & (EVEN_S < 3.1)
    angles = log.joint_position_rad.copy()
    angles[silent] = np.nan
    log = dataclasses.replace(log, joint_position_rad=angles, joint_time_s=np.where(silent, np.nan, read_s))
    found = measure(log)
    for name, peak in PEAKS.items():
        assert getattr(found, name) == pytest.approx(peak, rel=0.01)
        assert getattr(found, name) <= peak * (1 + 1e-6)
    assert found.ldlj == pytest.approx(measure(pan_swings(EVEN_S, EVEN_S)).ldlj, rel=0.02)


def test_derivatives_are_exact_for_polynomials_at_any_times():
    time_s = np.array([0.0, 0.1, 0.15, 0.4, 1.0])
    cubic = np.stack([2.0 * time_s**3, time_s**2], axis=1)
    np.testing.assert_allclose(derivative(cubic, time_s, 3), np.tile([12.0, 0.0], (2, 1)), atol=1e-9)
    np.testing.assert_allclose(derivative(cubic[:, 1:], time_s, 2), 2.0)


def test_head_and_eyes_are_apart():
    """Eyes that cancel the head: the gaze stands still, the head does not, and the eyes are where the head was."""
    head_rad = swing_rad(EVEN_S)
    joints = np.stack([head_rad, 0.0 * EVEN_S, -head_rad, np.full_like(EVEN_S, 0.1)], axis=1)
    found = measure(moved(EYES, joints, EVEN_S))
    scored = EVEN_S >= 1.0
    head = np.sqrt(np.mean((SPEED_RAD_S**2 * head_rad[scored]) ** 2))
    assert found.head_rms_acceleration_rad_s2 == pytest.approx(head, rel=0.02)
    assert found.rms_acceleration_rad_s2 == pytest.approx(np.sqrt(2.0) * head, rel=0.02)
    aside_deg = np.degrees(np.arccos(np.cos(head_rad[scored]) * np.cos(0.1)))
    assert found.eye_eccentricity_p95_deg == pytest.approx(np.quantile(aside_deg, 0.95), rel=1e-9)
