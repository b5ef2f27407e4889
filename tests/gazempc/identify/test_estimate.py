"""Dead time and servo are found on plants whose truth is known, with honest intervals."""

import math

import numpy as np
import pytest
from builders.identification import altered, assert_close, plant, simulate
from scipy import signal

from gazempc.identify.estimate import bandwidth_hz, estimate_axis
from gazempc.identify.identify import main as identify
from gazempc.identify.new_neck import as_toml
from gazempc.neck.spec import load_neck

TRUTHS = [
    ((0.0, 0.0025), 12.0, 0.9),
    ((0.0333, 0.5), 25.0, 0.5),
]


@pytest.mark.parametrize(("dead_times_s", "wn", "zeta"), TRUTHS)
def test_dead_time_and_servo_are_told_apart(dead_times_s, wn, zeta):
    taken = simulate(plant(dead_times_s, wn, zeta, encoder_noise_deg=0.1, load_offset_deg=1.5), seed=3)
    for axis, dead_time_s in enumerate(dead_times_s):
        found = estimate_axis(taken, axis)
        assert_close(found, dead_time_s, wn, zeta)
        assert math.degrees(found.offset_rad) == pytest.approx(1.5, abs=0.05)
        assert found.residual_rms_deg == pytest.approx(0.1, rel=0.1)
        assert found.fit_percent > 95


@pytest.mark.slow
def test_intervals_hold_what_they_promise(clean):
    """95 % intervals of repeats with noise that is correlated in time, as of friction, hold the truth."""
    rng = np.random.default_rng(0)
    thin = altered(clean, joint_time_s=clean.joint_time_s[::4], joint_rad=clean.joint_rad[::4])
    truths = (0.4, 12.0, 0.9, bandwidth_hz(12.0, 0.9))
    repeats, rho, inside, narrow = 12, 0.8, np.zeros(4), np.zeros(4)
    for _ in range(repeats):
        white = rng.normal(0.0, math.radians(0.1) * math.sqrt(1 - rho**2), thin.joint_rad.shape)
        noise = signal.lfilter([1.0], [1.0, -rho], white, axis=0)
        found = estimate_axis(altered(thin, joint_rad=thin.joint_rad + noise), 0)
        intervals = (found.dead_time_s, found.natural_frequency_rad_s, found.damping_ratio, found.bandwidth_hz)
        for i, (interval, truth) in enumerate(zip(intervals, truths, strict=True)):
            inside[i] += interval.low <= truth <= interval.high
            # An interval that is too wide holds the truth too, but says nothing: a third of it must often miss.
            narrow[i] += abs(truth - interval.value) <= interval.half_width / 6
    assert np.all(inside >= 0.8 * repeats), inside / repeats
    assert np.all(narrow <= 0.75 * repeats), narrow / repeats


def test_rare_coarse_wild_and_repeated_readings_with_late_stamps(clean):
    """As of cheap hardware; a known delay of the stamps is taken off."""
    step = math.radians(0.088)
    angles_rad = np.round(clean.joint_rad[::6] / step) * step
    angles_rad[50::97] = -math.pi
    times_s = clean.joint_time_s[::6] + 0.03
    taken = altered(clean, joint_time_s=np.repeat(times_s, 3), joint_rad=np.repeat(angles_rad, 3, axis=0))
    assert_close(estimate_axis(taken, 0), 0.43, 12.0, 0.9)


@pytest.mark.slow
def test_eyes_and_body_are_identified_each_for_itself(tmp_path):
    """Dead times and servos of five joints, all different, from one run of the command."""
    truth = load_neck("reference_eyes")
    eyes = {"pan": altered_axis(truth.eyes.pan, 0.06, 50.0), "tilt": altered_axis(truth.eyes.tilt, 0.045, 40.0)}
    body = altered_axis(truth.pan, 0.3, 8.0)
    truth = truth.model_copy(update={"name": "chain", "eyes": eyes, "body": body})
    path, out = tmp_path / "chain.toml", tmp_path / "found.toml"
    path.write_text(as_toml(truth.model_dump(exclude_none=True)))
    assert identify(["--robot", "mujoco", "--neck", str(path), "--duration-s", "6", "--out", str(out)]) == 0
    found = load_neck(out)
    assert found.joint_names == ("pan", "tilt", "eye_pan", "eye_tilt", "body_yaw")
    np.testing.assert_allclose(found.dead_time_s, [0.4, 0.4, 0.06, 0.045, 0.3], atol=1e-3)
    wn = [axis.natural_frequency_rad_s for axis in found.axes]
    np.testing.assert_allclose(wn, [12.0, 12.0, 50.0, 40.0, 8.0], rtol=0.02)
    assert found.model_copy(update={"name": "", "source": ""}).position_max_rad == pytest.approx(truth.position_max_rad)


def altered_axis(axis, dead_time_s, wn):
    return axis.model_copy(update={"dead_time_s": dead_time_s, "natural_frequency_rad_s": wn})
