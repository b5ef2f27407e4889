"""Identification of known dead time, servo and latency, with interval coverage, or refusal."""

import math

import numpy as np
import pytest
from builders.identification import REFERENCE, altered, assert_close, plant, simulate
from builders.replays import at_100_hz
from scipy import signal

from gazempc.files.documents import as_toml
from gazempc.identify.estimate import bandwidth_hz, estimate_axis
from gazempc.identify.excitation import ExcitationSettings, excite
from gazempc.identify.identify import main as identify
from gazempc.identify.latency import estimate_latency
from gazempc.identify.record import IdentificationError
from gazempc.identify.servo_fit import Z_95, ServoModel, robust_covariance
from gazempc.neck.spec import load_neck

TRUTHS = [
    ((0.0, 0.0025), 12.0, 0.9),
    ((0.0333, 0.5), 25.0, 0.5),
]


@pytest.mark.parametrize(("dead_times_s", "wn", "zeta"), TRUTHS)
def test_dead_time_and_servo_are_identified_separately(dead_times_s, wn, zeta):
    taken = simulate(plant(dead_times_s, wn, zeta, encoder_noise_deg=0.1, load_offset_deg=1.5), seed=3)
    for axis, dead_time_s in enumerate(dead_times_s):
        found = estimate_axis(taken, axis)
        assert_close(found, dead_time_s, wn, zeta)
        assert math.degrees(found.offset_rad) == pytest.approx(1.5, abs=0.05)
        assert found.residual_rms_deg == pytest.approx(0.1, rel=0.1)
        assert found.fit_percent > 95


@pytest.mark.slow
def test_intervals_have_nominal_coverage(clean):
    """95 % intervals cover the truth under noise correlated in time, such as friction."""
    rng = np.random.default_rng(0)
    thin = altered(clean, joint_time_s=clean.joint_time_s[::4], joint_rad=clean.joint_rad[::4])
    truths = (0.4, 12.0, 0.9, bandwidth_hz(12.0, 0.9))
    repeats, rho, inside, narrow = 8, 0.8, np.zeros(4), np.zeros(4)
    for _ in range(repeats):
        white = rng.normal(0.0, math.radians(0.1) * math.sqrt(1 - rho**2), thin.joint_rad.shape)
        noise = signal.lfilter([1.0], [1.0, -rho], white, axis=0)
        found = estimate_axis(altered(thin, joint_rad=thin.joint_rad + noise), 0)
        intervals = (found.dead_time_s, found.natural_frequency_rad_s, found.damping_ratio, found.bandwidth_hz)
        for i, (interval, truth) in enumerate(zip(intervals, truths, strict=True)):
            inside[i] += interval.low <= truth <= interval.high
            # Intervals are not too wide: a third of the width must often miss the truth.
            narrow[i] += abs(truth - interval.value) <= interval.half_width / 6
    assert np.all(inside >= 0.8 * repeats), inside / repeats
    assert np.all(narrow <= 0.75 * repeats), narrow / repeats


def test_identification_from_sparse_quantised_outlying_and_repeated_readings(clean):
    """As with cheap hardware; a known stamp delay is subtracted."""
    step = math.radians(0.088)
    angles_rad = np.round(clean.joint_rad[::6] / step) * step
    angles_rad[50::97] = -math.pi
    times_s = clean.joint_time_s[::6] + 0.03
    taken = altered(clean, joint_time_s=np.repeat(times_s, 3), joint_rad=np.repeat(angles_rad, 3, axis=0))
    assert_close(estimate_axis(taken, 0), 0.43, 12.0, 0.9)


@pytest.mark.slow
def test_eyes_and_body_are_identified_separately(tmp_path):
    """Five different joints from one run of the command."""
    truth = at_100_hz("reference_eyes")
    eyes = {"pan": altered_axis(truth.eyes.pan, 0.06, 50.0), "tilt": altered_axis(truth.eyes.tilt, 0.045, 40.0)}
    body = altered_axis(truth.pan, 0.3, 8.0)
    truth = truth.model_copy(update={"name": "chain", "eyes": eyes, "body": body})
    path, out = tmp_path / "chain.toml", tmp_path / "found.toml"
    path.write_text(as_toml(truth.model_dump(exclude_none=True)))
    assert identify(["--robot", "mujoco", "--neck", str(path), "--duration-s", "8", "--out", str(out)]) == 0
    found = load_neck(out)
    assert found.joint_names == ("pan", "tilt", "eye_pan", "eye_tilt", "body_yaw")
    np.testing.assert_allclose(found.dead_time_s, [0.4, 0.4, 0.06, 0.045, 0.3], atol=1e-3)
    wn = [axis.natural_frequency_rad_s for axis in found.axes]
    np.testing.assert_allclose(wn, [12.0, 12.0, 50.0, 40.0, 8.0], rtol=0.02)
    assert found.model_copy(update={"name": "", "source": ""}).position_max_rad == pytest.approx(truth.position_max_rad)


def altered_axis(axis, dead_time_s, wn):
    return axis.model_copy(update={"dead_time_s": dead_time_s, "natural_frequency_rad_s": wn})


# ---------------------------------------------------------------- refusals


def refusal(taken, axis=0, **options):
    """Message of the refusal, before or after the fit."""
    try:
        return "\n".join(estimate_axis(taken, axis, **options).doubts)
    except IdentificationError as error:
        return str(error)


def with_noise(taken, sigma_deg):
    return taken.joint_rad + np.random.default_rng(2).normal(0, math.radians(sigma_deg), taken.joint_rad.shape)


def friction(taken):
    """Stick-slip: a joint that moves in jumps of 40 degrees."""
    return np.round(taken.joint_rad / math.radians(40)) * math.radians(40)


SPOILT = {
    "no readings of the joints": lambda t: altered(t, joint_time_s=np.zeros(0), joint_rad=np.zeros((0, 2))),
    "50 different time stamps": lambda t: altered(t, joint_time_s=t.joint_time_s[:50], joint_rad=t.joint_rad[:50]),
    "share 0.0 s": lambda t: altered(t, joint_time_s=t.joint_time_s + 1e9),
    "moves over 0.34 deg": lambda t: altered(t, command_rad=t.command_rad / 100),
    "the joint over 0.0 deg": lambda t: altered(t, joint_rad=np.zeros_like(t.joint_rad)),
    "implausible jumps": lambda t: altered(
        t, joint_rad=np.where(np.arange(len(t.joint_rad))[:, None] % 10 == 0, -math.pi, t.joint_rad)
    ),
    "of the motion; at least 80 %": lambda t: altered(t, joint_time_s=t.joint_time_s[::4], joint_rad=friction(t)[::4]),
    "dead time is uncertain by": lambda t: altered(
        t, joint_time_s=t.joint_time_s[::30], joint_rad=with_noise(t, 3.0)[::30]
    ),
    "before its commands": lambda t: altered(t, joint_time_s=t.joint_time_s - 0.45),
    "at the bound of the search (-100 ms)": lambda t: altered(t, joint_time_s=t.joint_time_s - 0.6),
}


# Fits that do not converge to one servo try all starts.
LONG = ("of the motion; at least 80 %", "dead time is uncertain by")


@pytest.mark.parametrize("problem", [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in SPOILT])
def test_data_that_do_not_determine_the_servo_are_refused(clean, problem):
    text = refusal(SPOILT[problem](clean))
    assert problem in text
    assert text.startswith("pan: ")


def test_a_dead_time_beyond_the_search_range_is_refused(clean):
    assert "--dead-time-max-s" in refusal(clean, dead_time_max_s=0.3)
    assert refusal(clean, dead_time_max_s=0.5) == ""


def test_backlash_is_reported_and_noise_is_not(clean):
    """Intervals cover noise only; model errors are reported."""
    slack, held, rows = math.radians(0.8), clean.joint_rad[0], []
    for angles in clean.joint_rad:
        held = np.clip(held, angles - slack / 2, angles + slack / 2)
        rows.append(held)
    with_play = estimate_axis(altered(clean, joint_rad=np.array(rows)), 0)
    assert "correlated in time" in with_play.note
    assert 0.1 < with_play.structured_rms_deg <= with_play.residual_rms_deg < 0.8
    noisy = estimate_axis(altered(clean, joint_rad=with_noise(clean, 0.3)), 0)
    assert noisy.note == ""
    assert noisy.structured_rms_deg < 0.1


# ---------------------------------------------------------------- the model of the servo


@pytest.mark.parametrize(("wn", "zeta"), [(6.0, 1.2), (25.0, 0.5), (10.0, 1.0)])
def test_model_is_the_transfer_function_that_scipy_simulates(wn, zeta):
    """lsim on a finer grid with a delay of an integer number of its steps."""
    motion = excite(REFERENCE, REFERENCE.rest_rad, ExcitationSettings(duration_s=8.0))[:, 0]
    command_time = 0.005 * np.arange(motion.size)
    fine = 0.0005 * np.arange(10 * motion.size)
    delay_steps = 247  # 123.5 ms
    u = np.concatenate([np.full(delay_steps, motion[0]), np.repeat(motion, 10)])[: fine.size]
    _, q, _ = signal.lsim(signal.TransferFunction([wn**2], [1, 2 * zeta * wn, wn**2]), u, fine, interp=False)
    read = slice(1003, None, 37)
    model = ServoModel(command_time, motion, fine[read])
    np.testing.assert_allclose(model.delayed(model.motion(wn, zeta), 0.1235), q[read], atol=1e-6)


@pytest.mark.parametrize(("wn", "zeta"), [(6.0, 0.5), (20.0, 3.0)])
def test_bandwidth_is_the_frequency_of_minus_3_db(wn, zeta):
    _, answer = signal.freqs([wn**2], [1, 2 * zeta * wn, wn**2], [2 * math.pi * bandwidth_hz(wn, zeta)])
    assert abs(answer[0]) == pytest.approx(1 / math.sqrt(2))


@pytest.mark.slow
def test_95_percent_intervals_have_coverage_under_autocorrelated_errors():
    """A smooth regression with autoregressive errors that are also correlated between channels."""
    rng, times, draws, rhos, channels = np.random.default_rng(0), 400, 300, (0.0, 0.5, 0.8, 0.95), 3
    t = np.arange(times) / 30.0
    jacobian = np.repeat(np.column_stack([np.sin(3.0 * t), np.cos(5.0 * t + 1.0)]), channels, axis=0)
    solve = np.linalg.pinv(jacobian)
    mixing = np.linalg.cholesky(0.5 * np.eye(channels) + 0.5)
    inside = np.zeros(2)
    for rho in np.repeat(rhos, draws):
        white = rng.standard_normal((times + 100, channels)) @ mixing.T
        errors = signal.lfilter([1.0], [1.0, -rho], white, axis=0)[100:].ravel()
        estimate = solve @ errors
        sd = np.sqrt(np.diag(robust_covariance(jacobian, errors - jacobian @ estimate, channels)))
        inside += np.abs(estimate) < Z_95 * sd
    share = inside / (draws * len(rhos))
    assert np.all((share >= 0.93) & (share <= 0.98)), share


# ---------------------------------------------------------------- the latency of the sensor


def walk(times_s):
    return np.stack([2.0 + 0.3 * np.sin(times_s), 1.3 * times_s - 3.0, 0.03 * np.sin(11 * times_s)], axis=-1)


@pytest.mark.parametrize("latency_s", [0.066, -0.05])
def test_latency_of_a_known_motion_is_found(latency_s):
    rng, known_s, seen_s = np.random.default_rng(1), np.arange(0, 6, 0.01), np.arange(0.0, 6.0, 1 / 30)
    observed = walk(seen_s - latency_s) + np.array([0.02, -0.05, 0.0]) + rng.normal(0, 0.01, (seen_s.size, 3))
    found = estimate_latency(known_s, walk(known_s), seen_s, observed)
    assert found.value == pytest.approx(latency_s, abs=0.005)
    assert found.low <= latency_s <= found.high


def test_data_that_do_not_determine_the_latency_are_refused():
    rng, known_s, seen_s = np.random.default_rng(1), np.arange(0, 6, 0.01), np.arange(0.0, 6.0, 1 / 30)
    noise = rng.normal(0, 0.01, (seen_s.size, 3))
    with pytest.raises(IdentificationError, match="sensor latency: "):
        estimate_latency(known_s, 0.001 * walk(known_s), seen_s, 0.001 * walk(seen_s) + noise)
    with pytest.raises(IdentificationError, match="10 observations"):
        estimate_latency(known_s, walk(known_s), seen_s[:10], walk(seen_s[:10]))
    with pytest.raises(IdentificationError, match="on one clock"):
        estimate_latency(known_s, walk(known_s), seen_s, walk(seen_s - 1.4))
    with pytest.raises(IdentificationError, match="0 times"):
        estimate_latency(known_s, np.full((600, 3), np.nan), seen_s, walk(seen_s))
