"""Every metric of the table, recomputed from the log independently."""

import dataclasses

import numpy as np
import pytest
from builders.attention import attention_log, of_motion
from builders.recordings import synthetic
from builders.replays import replayed
from monalysa.quality import smoothness as reference_smoothness
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, multivariate_t
from scipy.stats import f as f_distribution

from gazempc.neck.spec import load_neck
from gazempc.results.metrics import inside, measure, squared_radius
from gazempc.results.motion import derivative, limit_violations, log_dimensionless_jerk, sparc

NECK = load_neck("fetch")


@pytest.fixture(scope="module")
def log():
    """A run on a neck with offsets, so that the eye is not in the base's origin."""
    return replayed(synthetic("subject02_R4"), "lookahead", neck=NECK)


def independent_error_deg(log):
    """Gaze error by rotation matrices and arccos, tick by tick."""
    errors = []
    for (pan, tilt), head in zip(log.joint_position_rad, log.head_true_base_m, strict=True):
        turn, nod = Rotation.from_euler("z", pan), Rotation.from_euler("y", -tilt)
        geometry = NECK.geometry
        eye = turn.apply(np.array(geometry.tilt_axis_in_pan_m) + nod.apply(geometry.eye_in_tilt_m))
        gaze = (turn * nod).apply([1, 0, 0])
        to_head = (head - eye) / np.linalg.norm(head - eye)
        errors.append(np.degrees(np.arccos(np.clip(gaze @ to_head, -1, 1))))
    return np.array(errors)


def test_gaze_metrics(log):
    m = measure(log)
    error = independent_error_deg(log)
    scored = error[200:]
    assert log.time_s[200] == pytest.approx(1.0)
    assert m.gaze_error_rms_deg == pytest.approx(np.sqrt(np.mean(np.square(scored))), abs=1e-5)
    assert m.gaze_error_median_deg == pytest.approx(np.median(scored), abs=1e-5)
    assert m.gaze_error_p95_deg == pytest.approx(np.quantile(scored, 0.95), abs=1e-5)
    for name, cone in (("2p6", 2.6), ("4", 4.0), ("9", 9.0)):
        assert getattr(m, f"eye_contact_{name}") == pytest.approx(sum(scored <= cone) / len(scored), abs=1e-9)
    longest = max((len(run) for run in "".join("x" if e > 2.6 else " " for e in scored).split()), default=0)
    assert m.longest_break_s == pytest.approx(longest * 0.005)
    inside = error <= 2.6
    assert m.time_to_contact_s == pytest.approx(log.time_s[np.flatnonzero(inside)[0]])
    lasting = [k for k in range(len(inside) - 99) if all(inside[k : k + 100])]
    assert m.time_to_stable_contact_s == pytest.approx(log.time_s[lasting[0]])


def test_overshoot_of_a_damped_oscillation_about_a_still_head(log):
    """By hand: from 30 deg, a damped oscillation about straight ahead; only the second after arrival counts."""
    neck = load_neck("reference")
    time_s = np.arange(600) * 0.005
    swing_deg = 30.0 * np.exp(-time_s / 0.5) * np.cos(2 * np.pi * time_s / 0.8)
    joints = np.stack([np.deg2rad(swing_deg), np.zeros(600)], axis=-1)
    head, run = np.tile([2.5, 0.0, 0.0], (600, 1)), log.run.model_copy(update={"neck": neck})
    for moved, passed_deg in (
        (joints, -swing_deg.min()),
        (-joints, -swing_deg.min()),
        (np.abs(joints), 0.0),  # approaches the head without reaching it
        (joints * [0.0, 1.0] + [0.5, 0.0], np.nan),  # never arrives
        (0.2 * joints, np.nan),  # near from the start
    ):
        found = measure(of_motion(log, time_s, moved, head, run=run)).overshoot_deg
        assert found == pytest.approx(passed_deg, abs=1e-9, nan_ok=True)


def test_motion_metrics(log):
    m = measure(log)
    dt = 0.005
    velocity = np.gradient(log.joint_position_rad, dt, axis=0)
    assert m.peak_velocity_rad_s == pytest.approx(np.abs(velocity).max(), rel=0.01)
    assert m.peak_velocity_rad_s == pytest.approx(np.abs(log.joint_velocity_rad_s).max(), rel=0.01)
    by_velocity = np.diff(log.joint_velocity_rad_s, axis=0) / dt
    assert m.peak_acceleration_rad_s2 == pytest.approx(np.abs(by_velocity).max(), rel=0.03)
    assert m.rms_acceleration_rad_s2 == pytest.approx(np.sqrt(np.mean(np.sum(by_velocity[200:] ** 2, 1))), rel=0.01)
    assert m.peak_jerk_rad_s3 == pytest.approx(np.abs(np.diff(by_velocity, axis=0)).max() / dt, rel=0.1)
    assert m.limit_violations == 0


@pytest.mark.parametrize("order", [0, 1, 2, 3])
@pytest.mark.parametrize("which", ["command_position_rad", "joint_position_rad"])
def test_every_kind_of_violation_is_counted(log, which, order):
    t = log.time_s
    names = ("position_max_rad", "velocity_max_rad_s", "acceleration_max_rad_s2", "jerk_max_rad_s3")
    limits = [getattr(NECK, name)[0] for name in names]
    # A smooth motion that violates the limit of one derivative only.
    frequency = (0.01, 1.2, 8.0, 40.0)[order]
    amplitude = 1.02 * limits[order] / frequency**order
    motion = np.zeros((t.size, 2))
    motion[:, 0] = amplitude * (np.sin(frequency * t) if order else np.ones_like(t))
    still = {"command_position_rad": np.zeros((t.size, 2)), "joint_position_rad": np.zeros((t.size, 2))}
    assert limit_violations(dataclasses.replace(log, **still), NECK) == 0
    assert limit_violations(dataclasses.replace(log, **{**still, which: motion}), NECK) > 0
    assert limit_violations(dataclasses.replace(log, **{**still, which: motion * 0.97}), NECK) == 0


def test_forecast_metrics(log):
    m = measure(log)
    for i, horizon in enumerate((250, 500, 1000)):
        errors = []
        for capture, mean, true in zip(
            log.capture_time_s, log.forecast_mean_base_m[:, i], log.forecast_true_base_m[:, i], strict=True
        ):
            if capture + horizon / 1000 <= log.time_s[-1] + 0.004:
                k = (capture + horizon / 1000) / 0.005
                near = log.head_true_base_m[min(round(k), len(log.time_s) - 1)]
                assert np.linalg.norm(true - near) < 0.01
                errors.append(1000 * np.linalg.norm(mean - true))
        assert getattr(m, f"forecast_error_{horizon}_mm") == pytest.approx(np.mean(errors), rel=0.02)
    known = np.isfinite(log.forecast_true_base_m[:, 1, 0])
    off_m = (log.forecast_mean_base_m - log.forecast_true_base_m)[known, 1]
    nees = [d @ np.linalg.inv(c) @ d for d, c in zip(off_m, log.forecast_covariance_m2[known, 1], strict=True)]
    assert m.forecast_nees_500 == pytest.approx(np.mean(nees))
    v = log.forecast_degrees_of_freedom[known]
    assert np.median(v) < 100.0  # infinite at the filter's first frame
    for share, coverage in ((0.68, m.forecast_coverage_68_500), (0.95, m.forecast_coverage_95_500)):
        # Of a t distribution with this covariance, or of a normal one.
        tailed = np.isfinite(v)
        limits = np.full(v.size, chi2.ppf(share, 3))
        limits[tailed] = 3.0 * (v[tailed] - 2.0) / v[tailed] * f_distribution.ppf(share, 3, v[tailed])
        assert coverage == pytest.approx(np.mean(np.array(nees) < limits))


def test_smoothness_equals_the_published_algorithm():
    t = np.arange(0, 2, 0.005)
    bell = t**2 * (2 - t) ** 2 + 0.05 * np.sin(25 * t) ** 2
    assert sparc(bell, 200.0) == pytest.approx(reference_smoothness.sparc(bell, 200.0)[0], rel=1e-6)
    theirs = reference_smoothness.log_dimensionless_jerk(bell, 200.0, data_type="vel", rem_mean=False)
    assert log_dimensionless_jerk(bell, 200.0) == pytest.approx(theirs, rel=1e-2)
    rough = bell + 0.2 * np.sin(40 * t) ** 2
    assert sparc(rough, 200.0) < sparc(bell, 200.0)
    assert log_dimensionless_jerk(rough, 200.0) < log_dimensionless_jerk(bell, 200.0)


SHARES = (0.68, 0.90, 0.95)
SPREAD = np.array([[0.01, 0.004, 0.0], [0.004, 0.04, 0.001], [0.0, 0.001, 0.0025]])
DRAWS = 40_000


def errors_of(freedom):
    """Errors of covariance SPREAD, normal or with the tails of a t distribution."""
    rng = np.random.default_rng(0)
    if np.isinf(freedom):
        return rng.multivariate_normal(np.zeros(3), SPREAD, size=DRAWS)
    return multivariate_t(np.zeros(3), SPREAD * (freedom - 2.0) / freedom, df=freedom, seed=rng).rvs(DRAWS)


def nees_of(freedom):
    errors = errors_of(freedom)
    return np.einsum("ni,ij,nj->n", errors, np.linalg.inv(SPREAD), errors)


@pytest.mark.parametrize("freedom", [2.5, 10.0, np.inf])
@pytest.mark.parametrize("share", SHARES)
def test_consistent_errors_have_nominal_coverage(freedom, share):
    assert np.mean(inside(nees_of(freedom), np.full(DRAWS, freedom), share)) == pytest.approx(share, abs=0.007)


def test_the_horizontal_ellipse_has_two_dimensional_coverage():
    for freedom in (3.0, np.inf):
        errors = errors_of(freedom)[:, :2]
        squared = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(SPREAD[:2, :2]), errors)
        assert np.mean(squared <= squared_radius(freedom, 0.95, axes=2)) == pytest.approx(0.95, abs=0.007)


# ---------------------------------------------------------------- motion at even and uneven ticks


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
    """Ticks of a loaded computer: most slightly late, some by nearly a period, some missing."""
    rng = np.random.default_rng(seed)
    late_s = np.minimum(rng.exponential(0.0005, EVEN_S.size), 0.99 * PERIOD_S)
    late_s[rng.random(EVEN_S.size) < 0.02] = 0.98 * PERIOD_S
    return (EVEN_S + late_s)[rng.random(EVEN_S.size) > 0.03]


def test_motion_metrics_at_even_and_uneven_ticks():
    even = measure(pan_swings(EVEN_S, EVEN_S))
    uneven = jittered()
    by_period = np.abs(np.diff(swing_rad(uneven), 2)).max() / PERIOD_S**2
    assert by_period > 10 * PEAKS["peak_acceleration_rad_s2"], "the nominal period is as accurate"
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


def test_repeated_and_missing_readings_do_not_bias_derivatives():
    """Every reading is repeated for three ticks; some ticks have none."""
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


def test_head_and_eyes_have_separate_metrics():
    """Eyes that compensate the head: constant gaze, moving head, and eyes opposite to the head."""
    head_rad = swing_rad(EVEN_S)
    joints = np.stack([head_rad, 0.0 * EVEN_S, -head_rad, np.full_like(EVEN_S, 0.1)], axis=1)
    found = measure(moved(EYES, joints, EVEN_S))
    scored = EVEN_S >= 1.0
    head = np.sqrt(np.mean((SPEED_RAD_S**2 * head_rad[scored]) ** 2))
    assert found.head_rms_acceleration_rad_s2 == pytest.approx(head, rel=0.02)
    assert found.rms_acceleration_rad_s2 == pytest.approx(np.sqrt(2.0) * head, rel=0.02)
    aside_deg = np.degrees(np.arccos(np.cos(head_rad[scored]) * np.cos(0.1)))
    assert found.eye_eccentricity_p95_deg == pytest.approx(np.quantile(aside_deg, 0.95), rel=1e-9)


def test_a_head_that_is_known_at_single_ticks_gives_no_durations():
    log = replayed(synthetic("subject03_R4"), "reactive")
    head_m = np.full_like(log.head_true_base_m, np.nan)
    head_m[::20] = log.head_true_base_m[::20]
    dense, sparse = measure(log), measure(dataclasses.replace(log, head_true_base_m=head_m))
    assert dense.longest_break_s > 1.0
    assert np.isnan(
        [sparse.longest_break_s, sparse.time_to_stable_contact_s, sparse.time_from_start_to_contact_s]
    ).all()
    assert sparse.gaze_error_rms_deg == pytest.approx(dense.gaze_error_rms_deg, rel=0.05)
