"""Rotation between pictures of a synthetic panorama; delay, lag and speeds from rotations."""

import numpy as np
import pytest
from scipy import signal
from scipy.ndimage import gaussian_filter

from gazempc.files.documents import as_toml
from gazempc.identify.from_picture import TurnedAxis, option_words, turned_table, turned_toml
from gazempc.identify.identify import main
from gazempc.identify.record import IdentificationError
from gazempc.identify.turning import Interval, Pulse, TurnEstimate, Turning, estimate_turns, lens_angle_rad, turned_rad
from gazempc.neck.spec import load_neck
from gazempc.neck.speed_steps import SpeedSteps
from gazempc.robots.options import RobotOptions
from gazempc.robots.ptz_emulator import LATENCY_S

cv2 = pytest.importorskip("cv2")
WIDTH, HEIGHT, FOV = 320, 180, np.radians(60.0)
FOCAL = 0.5 * WIDTH / np.tan(FOV / 2)


@pytest.fixture(scope="module")
def room():
    """Grey values by direction: 3600 columns and 700 rows of 0.1 deg, texture at several scales."""
    rng = np.random.default_rng(0)
    white = (rng.standard_normal((700, 3600), np.float32) for _ in range(3))
    texture = sum(s * gaussian_filter(each, s, mode="wrap") for each, s in zip(white, (1.5, 4.0, 10.0), strict=True))
    return np.clip(128 + 60 * texture, 0, 255).astype(np.float32)


def picture(room, pan, tilt=0.0, person=None, share=1.0, blur=0.0, seed=0):
    """A pinhole picture; `person` is the left edge of a patch with another texture, pixels."""
    x, y = np.meshgrid(np.arange(WIDTH) - (WIDTH - 1) / 2, np.arange(HEIGHT) - (HEIGHT - 1) / 2)
    forward = np.cos(tilt) * FOCAL + np.sin(tilt) * y
    up = np.sin(tilt) * FOCAL - np.cos(tilt) * y
    azimuth, elevation = pan - np.arctan2(x, forward), np.arctan2(up, np.hypot(x, forward))
    column = (1800 - np.degrees(azimuth) * 10).astype(np.float32) % 3600
    row = (350 - np.degrees(elevation) * 10).astype(np.float32)
    seen = cv2.remap(room, column, row, cv2.INTER_LINEAR)
    rng = np.random.default_rng(seed)
    if person is not None:
        seen[60:, person : person + 70] = 90 + 50 * gaussian_filter(np.random.default_rng(9).normal(size=(120, 70)), 2)
    if blur:
        seen = cv2.blur(seen, (max(round(blur), 1), 1))
    return np.clip(share * seen + rng.normal(0.0, 1.0, seen.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("axis", "turn_deg"), [("pan", 0.05), ("pan", -15.0), ("tilt", -3.0), ("tilt", 9.0)])
def test_the_rotation_between_two_pictures_is_estimated(room, axis, turn_deg):
    turning, turn = Turning(axis, FOV, WIDTH, HEIGHT), np.radians(turn_deg)
    angles = {"pan": turn} if axis == "pan" else {"pan": 0.0, "tilt": turn}
    before, after = turning.flat(picture(room, 0.0)), turning.flat(picture(room, **angles, seed=1))
    found = turning.between(before, after)
    assert np.degrees(found) == pytest.approx(turn_deg, abs=0.02 + 0.005 * abs(turn_deg))


def test_a_moving_person_does_not_bias_the_rotation(room):
    turning = Turning("pan", FOV, WIDTH, HEIGHT)
    before = turning.flat(picture(room, 0.0, person=60))
    after = turning.flat(picture(room, np.radians(2.0), person=180, seed=1))
    assert np.degrees(turning.between(before, after)) == pytest.approx(2.0, abs=0.05)


def test_a_dark_picture_is_reported(room):
    with pytest.raises(IdentificationError, match="dark"):
        Turning("pan", FOV, WIDTH, HEIGHT).flat(picture(room, 0.0, share=0.01))


def test_pictures_without_overlap_have_no_rotation(room):
    turning = Turning("pan", FOV, WIDTH, HEIGHT)
    assert np.isnan(turning.between(turning.flat(picture(room, 0.0)), turning.flat(picture(room, 1.5, seed=1))))


def servo(time_s, on_s, off_s, speed, delay_s, wn):
    """Joint that follows the integral of a held speed behind dead time and servo."""
    grid = np.arange(0.0, time_s[-1] + 1e-3, 1e-3)
    turned = speed * np.clip(grid - on_s - delay_s, 0.0, off_s - on_s)
    _, angles, _ = signal.lsim(([wn**2], [1.0, 2.0 * wn, wn**2]), turned, grid)
    return np.interp(time_s, grid, angles)


def pulses(delay_s=0.5, wn=15.0, sign=1.0, noise_deg=0.01, seed=0):
    rng = np.random.default_rng(seed)
    made = []
    for step, deg_s in ((1, 2.0), (2, 9.0), (3, 30.0), (-1, -1.8), (-2, -8.0), (-3, -26.0)):
        time_s = np.arange(0.0, 2.2, 0.1) + rng.uniform(0.0, 0.1)
        angle = servo(time_s, 0.2, 0.7, sign * np.radians(deg_s), delay_s, wn)
        made.append(Pulse(step, 0.2, 0.7, time_s, angle + np.radians(rng.normal(0.0, noise_deg, time_s.size))))
    return made


@pytest.mark.parametrize(("delay_s", "sign"), [(0.15, 1), (0.6, -1)])
def test_delay_lag_sign_and_speeds_are_identified(delay_s, sign):
    found = estimate_turns(pulses(delay_s=delay_s, sign=sign), 1.5)
    assert found.delay_s.value == pytest.approx(delay_s, abs=0.004)
    assert found.natural_frequency_rad_s.value == pytest.approx(15.0, rel=0.05)
    assert found.sign == sign
    for step, deg_s in ((1, 2.0), (2, 9.0), (3, 30.0), (-1, -1.8), (-2, -8.0), (-3, -26.0)):
        assert np.degrees(found.speeds_rad_s[step].value) == pytest.approx(sign * deg_s, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize(("share", "exposure_s"), [(1.0, 1.0 / 15.0), (0.2, 0.0)], ids=["motion blur", "dim light"])
def test_motion_blur_and_dim_light_are_tolerated(room, share, exposure_s):
    """A blurred edge at 20 deg/s is 6 pixels wide; in dim light the noise is a sixth of the contrast."""
    rng, seen = np.random.default_rng(0), []
    for step, deg_s in ((1, 6.0), (-1, -6.0), (2, 20.0), (-2, -20.0)):
        time_s = np.arange(0.0, 1.8, 0.1) + rng.uniform(0.0, 0.1)
        ends = [servo(time_s + half_s, 0.2, 0.7, np.radians(deg_s), 0.5, 15.0) for half_s in (-0.05, 0.0, 0.05)]
        blur = exposure_s / 0.1 * np.abs(ends[2] - ends[0]) * FOCAL
        shots = zip(ends[1], blur, range(time_s.size), strict=True)
        greys = [picture(room, pan, share=share, blur=px, seed=seed) for pan, px, seed in shots]
        angle_rad = turned_rad(Turning("pan", FOV, WIDTH, HEIGHT), greys, np.radians(12.0))
        seen.append(Pulse(step, 0.2, 0.7, time_s, angle_rad))
    found = estimate_turns(seen, 1.5)
    assert found.delay_s.value == pytest.approx(0.5, abs=0.015)
    for step, deg_s in ((1, 6.0), (-1, -6.0), (2, 20.0), (-2, -20.0)):
        assert np.degrees(found.speeds_rad_s[step].value) == pytest.approx(deg_s, rel=0.03)


def test_the_delay_interval_covers_the_truth():
    found = [estimate_turns(pulses(noise_deg=0.1, seed=seed), 1.0).delay_s for seed in range(5)]
    assert sum(each.low <= 0.5 <= each.high for each in found) >= 4


def test_a_scene_uncorrelated_with_commands_is_refused():
    rng = np.random.default_rng(1)
    wandering = [
        Pulse(p.step, p.on_s, p.off_s, p.time_s, np.cumsum(rng.normal(0, 0.01, p.time_s.size))) for p in pulses()
    ]
    with pytest.raises(IdentificationError):
        estimate_turns(wandering, 1.5)


def test_odometry_accumulates_a_turn_wider_than_the_picture(room):
    greys = [picture(room, np.radians(turn_deg), seed=int(turn_deg)) for turn_deg in np.arange(0.0, 90.0, 8.0)]
    found_rad = turned_rad(Turning("pan", FOV, WIDTH, HEIGHT), greys, np.radians(12.0))
    assert np.degrees(found_rad[-1]) == pytest.approx(88.0, abs=0.5)


# ---------------------------------------------------------------- the command on the emulated camera


PTZ = load_neck("ptz")


def turn_estimate(delay_s, speeds):
    known = {step: Interval(value, value, value) for step, value in sorted(speeds.items())}
    wn = Interval(20.0, 19.0, 21.0)
    return TurnEstimate(Interval(delay_s, delay_s, delay_s), wn, known, 0.01)


@pytest.mark.parametrize(("answers", "dead_time_s"), [(True, 0.3), (False, 0.5)])
def test_the_neck_file_has_the_measured_table(answers, dead_time_s, tmp_path):
    """Speeds from position answers, else from pictures. The camera turns right at step 1."""
    left, right = {1: 0.09, 2: 0.4, 3: 0.6}, {1: 0.1, 3: 0.5}
    speeds = {k: -v for k, v in right.items()} | {-k: v for k, v in left.items()}
    by_picture = {step: speed * (1.05 if answers else 1.0) for step, speed in speeds.items()}
    # Position answers have the sign of the command, as on the robot.
    by_answers = turn_estimate(0.3, {k: -v for k, v in speeds.items()}) if answers else None
    axes = [TurnedAxis(name, turn_estimate(0.5, by_picture), by_answers, 3) for name in ("pan", "tilt")]
    path, view_rad = tmp_path / "measured.toml", np.radians([60.0, 36.0])
    path.write_text(turned_toml(PTZ, axes, tuple(view_rad), "measured", "a test"))
    neck = load_neck(path)
    assert neck.pan.dead_time_s == dead_time_s
    assert neck.pan.speed_steps.positive_rad_s == pytest.approx((0.09, 0.4, 0.6))
    assert neck.pan.speed_steps.negative_rad_s == pytest.approx((0.1, 0.3, 0.5))
    assert neck.pan.velocity_max_rad_s == pytest.approx(0.5)
    assert neck.head_view_deg == (60.0, 36.0)
    assert "sign -1" in turned_table(axes, view_rad[0])


def test_the_command_to_use_has_the_options_and_the_measured_signs():
    """Pan had the wrong sign, tilt the right one, which differs from the default."""
    turned = [
        TurnedAxis(name, turn_estimate(0.5, {1: sign * 0.2, -1: -sign * 0.2}), None, 1)
        for name, sign in (("pan", -1), ("tilt", 1))
    ]
    options = RobotOptions.model_validate({"visca": {"directions": (1, -1), "counts_per_deg": 20.0}})
    words = " ".join(option_words("visca:192.0.2.8", options, turned))
    assert "--options.visca.directions -1 -1" in words
    assert "--options.visca.counts-per-deg 20.0" in words
    assert option_words("visca:192.0.2.8", RobotOptions(), turned[1:] * 2) == []


@pytest.mark.slow
def test_the_emulated_camera_is_identified(tmp_path, capsys, real_time):
    pytest.importorskip("mujoco")
    out = tmp_path / "found.toml"
    few = {
        "pan": SpeedSteps(positive_rad_s=[0.4, 0.8], negative_rad_s=[0.3, 0.8]),
        "tilt": SpeedSteps(positive_rad_s=[0.8], negative_rad_s=[0.8]),
    }
    axes = {
        name: getattr(PTZ, name).model_copy(update={"speed_steps": steps, "velocity_max_rad_s": 0.8})
        for name, steps in few.items()
    }
    given = tmp_path / "given.toml"
    given.write_text(as_toml(PTZ.model_copy(update=axes).model_dump(exclude_none=True)))
    words = ["--robot", f"visca:emulator:{given}", "--source", "camera:emulator", "--neck", str(given)]
    assert main([*words, "--camera.fov-deg", "65", "--dead-time-max-s", "0.8", "--out", str(out)]) == 0
    neck, text = load_neck(out), capsys.readouterr().out
    for name in ("pan", "tilt"):
        axis = getattr(neck, name)
        assert axis.dead_time_s == pytest.approx(PTZ.pan.dead_time_s, abs=0.015)
        np.testing.assert_allclose(axis.speed_steps.levels_rad_s, few[name].levels_rad_s, rtol=0.03)
    assert neck.head_view_deg == pytest.approx((60.0, 36.0), abs=1.0)
    latency_ms = float(text.rsplit("--camera.latency-ms ", 1)[1].split()[0])
    assert latency_ms == pytest.approx(1e3 * LATENCY_S, abs=30.0)


@pytest.mark.parametrize("guess_deg", [45.0, 80.0])
def test_the_lens_angle_follows_from_position_replies(room, guess_deg):
    turns = np.radians([8.0, -5.0])
    motions = [(np.array([0.0, turn]), picture(room, 0.0), picture(room, turn, seed=1)) for turn in turns]
    assert np.degrees(lens_angle_rad(motions, np.radians(guess_deg))) == pytest.approx(60.0, abs=0.5)
    silent = [(np.array([]), before, after) for _, before, after in motions]
    assert np.degrees(lens_angle_rad(silent, np.radians(guess_deg))) == pytest.approx(guess_deg)


@pytest.mark.parametrize(("reply_deg", "turn_deg"), [(120.0, 120.0), (0.0, 8.0)])
def test_pictures_without_overlap_and_constant_replies_have_no_lens_angle(room, reply_deg, turn_deg):
    motion = np.radians([0.0, reply_deg]), picture(room, 0.0), picture(room, np.radians(turn_deg), seed=1)
    with pytest.raises(IdentificationError, match=r"--camera\.fov-deg"):
        lens_angle_rad([motion], np.radians(60.0))
