"""Narrowed limits: by a region, a speed, the field of view, and human motion."""

import math

import numpy as np
import pytest
from builders.replays import at_100_hz

import gazempc as gz
from gazempc.controllers.chain import EyeAim
from gazempc.errors import SettingsError
from gazempc.neck.limits import eye_velocity_rad_s, head_velocity_rad_s, motor_scale, narrowed, with_motion
from gazempc.neck.picture import FramedPicture, Framing
from gazempc.neck.servo import DelayedServo
from gazempc.neck.spec import load_neck, neck_names

REGION = (-20.0, 30.0, -5.0, 15.0)


def sums(neck, angles_deg):
    """Pan and tilt of the gaze: sums of the yaw joints and of the pitch joints."""
    by_name = dict(zip(neck.joint_names, angles_deg.T, strict=True))
    about = [by_name[name] for name in ("pan", "eye_pan", "body_yaw") if name in by_name]
    up = [by_name[name] for name in ("tilt", "eye_tilt") if name in by_name]
    return sum(about), sum(up)


@pytest.mark.parametrize("region", [REGION, (10.0, 40.0, 3.0, 15.0)])
@pytest.mark.parametrize("name", neck_names())
def test_joints_at_any_end_of_their_ranges_keep_the_gaze_in_the_region(name, region):
    neck = gz.load_neck(name)
    narrow = narrowed(neck, region, 0.3)
    ends = np.rad2deg(np.stack([narrow.position_min_rad, narrow.position_max_rad]))
    pan, tilt = sums(narrow, ends)
    assert pan == pytest.approx(region[:2])
    assert tilt == pytest.approx(region[2:])
    upper = [
        joint for joint, each in enumerate(neck.joint_names) if each.startswith("eye_") or (neck.body and each == "pan")
    ]
    assert np.all(ends[0, upper] < 0.0)
    assert np.all(ends[1, upper] > 0.0)
    assert np.all(narrow.position_min_rad >= neck.position_min_rad - 1e-12)
    assert np.all(narrow.position_max_rad <= neck.position_max_rad + 1e-12)
    assert np.all(narrow.velocity_max_rad_s == np.minimum(neck.velocity_max_rad_s, 0.3))
    assert narrowed(neck, None, None) == neck


def test_an_offset_beyond_the_range_of_the_lowest_joint_is_left_to_the_others():
    neck = gz.load_neck("reference_eyes")  # pan to 80 deg, eyes 35 deg further
    narrow = narrowed(neck, (95.0, 110.0, -60.0, -45.0), None)
    pan, tilt = sums(narrow, np.rad2deg(np.stack([narrow.position_min_rad, narrow.position_max_rad])))
    assert pan == pytest.approx([95.0, 110.0])
    assert tilt == pytest.approx([-60.0, -45.0])
    assert np.all(narrow.position_min_rad >= neck.position_min_rad - 1e-12)
    assert np.all(narrow.position_max_rad <= neck.position_max_rad + 1e-12)
    assert np.rad2deg(narrow.position_max_rad[0]) == pytest.approx(80.0)


@pytest.mark.parametrize("region", [(30.0, 20.0, -5.0, 5.0), (-20.0, 20.0, 60.0, 70.0)])
def test_an_unreachable_region_is_refused(region):
    with pytest.raises(SettingsError, match=r"gaze_region_deg: neck 'reference', (pan|tilt) of the gaze.*accepted"):
        narrowed(gz.load_neck("reference"), region, None)


@pytest.mark.parametrize(
    ("neck", "controller"), [(at_100_hz("reference_eyes"), "mpc"), (load_neck("reachy_mini_body"), "lookahead")]
)
def test_a_replay_keeps_the_region_and_the_speed(neck, controller):
    region, speed = (-10.0, 15.0, -3.0, 6.0), 0.2
    loop = {"gaze_region_deg": region, "speed_max_rad_s": speed}
    log = gz.replay("subject03_R4", neck=neck, controller=controller, predictor="constant_velocity", loop=loop)
    pan, tilt = sums(log.neck, np.rad2deg(log.joint_position_rad))
    for angle, low, high in ((pan, *region[:2]), (tilt, *region[2:])):
        assert low - 1e-6 <= angle.min() <= angle.max() <= high + 1e-6
    moved_rad_s = np.diff(log.joint_position_rad, axis=0) * log.neck.servo_rate_hz
    assert np.abs(moved_rad_s).max() <= speed * (1 + 1e-6)
    assert np.ptp(pan) > 10.0  # it does look about
    assert gz.measure(log).limit_violations == 0


# ---------------------------------------------------------------- the picture


NECK = gz.load_neck("ptz")


def picture(**values):
    return FramedPicture.of(Framing(view_deg=(60.0, 30.0), **values), NECK)


@pytest.mark.parametrize(("headroom", "above_deg"), [(0.5, 0.0), (0.4, 3.0), (0.0, 15.0)])
def test_the_head_stands_above_the_middle_by_the_headroom(headroom, above_deg):
    aim = picture(headroom=headroom).aim_rad(np.radians([[10.0, 5.0]]), 0.0)
    np.testing.assert_allclose(np.degrees(aim), [[10.0, 5.0 - above_deg]])


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_lead_room_applies_to_walkers_only(way):
    framed = picture(lead_room=0.1)
    ahead = np.degrees(framed.aim_rad(np.zeros(2), way * np.radians(60.0))[0])
    assert 5.9 < way * ahead < 6.0  # 0.1 of 60 deg
    assert framed.aim_rad(np.zeros(2), 0.0)[0] == 0.0


def test_delay_and_deviation_widen_the_zone_against_reversals():
    framed = picture(zone=(0.4, 0.4), hysteresis_per_s=0.5)  # pan: 12 deg of 30, tilt: 6 of 15
    wider = [framed.turns_back_rad(axis, 1.2, np.radians([0.0, 2.0, 20.0])) for axis in (0, 1)]
    np.testing.assert_allclose(np.degrees(wider), [[7.2, 10.2, 18.0], [3.6, 6.6, 9.0]])


def test_the_zone_spans_the_picture_until_a_long_excursion():
    framed = picture(zone=(0.4, 0.4))  # 12 deg of 30
    waits = [framed.widening_rad(0, 0.0, share) for share in (0.0, 0.5, 1.0)]
    np.testing.assert_allclose(np.degrees(waits), [18.0, 9.0, 0.0])
    assert np.degrees(framed.widening_rad(0, np.radians(60.0), 0.0)) < 0.1  # a walker crosses the picture
    assert framed.excursion_s(1.2) == pytest.approx(1.8)


def test_limits_scale_with_the_field_of_view():
    wide = narrowed(NECK, None, None, Framing(view_deg=(60.0, 34.0), acceleration_max=0.5))
    close = narrowed(NECK, None, None, Framing(view_deg=(6.0, 3.4), acceleration_max=0.5))
    assert wide.pan.acceleration_max_rad_s2 == pytest.approx(np.radians(30.0))
    assert close.pan.acceleration_max_rad_s2 == pytest.approx(np.radians(3.0))
    assert narrowed(NECK, None, None, Framing(subject="no")) == NECK


def test_the_field_of_view_is_in_the_neck_file_or_required():
    seen = NECK.model_copy(update={"head_view_deg": (50.0, 30.0)})
    assert FramedPicture.of(Framing(), seen).view_rad[0] == np.radians(50.0)
    assert FramedPicture.of(Framing(subject="no"), NECK) is None
    with pytest.raises(gz.GazempcError, match="view_deg"):
        gz.Mpc(NECK, framing=Framing())


# ---------------------------------------------------------------- human-like motion


NECKS = [load_neck(name) for name in ("reference_eyes", "furhat", "icub")]


def strong(axis):
    """An axis with very high limits and a fast servo."""
    limits = {"velocity_max_rad_s": 50.0, "acceleration_max_rad_s2": 5000.0, "jerk_max_rad_s3": 1e7}
    return axis.model_copy(update=limits | {"natural_frequency_rad_s": 250.0})


def peak_rad_s(axis, amplitude_rad):
    """Peak velocity of a joint under the time-optimal symmetric motion within velocity and acceleration limits."""
    a, v, step_s = axis.acceleration_max_rad_s2, axis.velocity_max_rad_s, 0.5e-3
    top = min(v, math.sqrt(a * amplitude_rad))
    total_s = amplitude_rad / top + top / a
    servo = DelayedServo(axis.model_copy(update={"dead_time_s": 0.0}), 0.0, 0.0)
    speeds = []
    for k in range(math.ceil((total_s + 1.0) / step_s)):
        t = k * step_s
        servo.advance_to(t)
        speeds.append(servo.state[1])
        left_s = max(total_s - t, 0.0)
        ramp_s = top / a
        done = min(0.5 * a * t**2, amplitude_rad) if t < ramp_s else top * (t - 0.5 * ramp_s)
        servo.send(done if left_s > ramp_s else amplitude_rad - 0.5 * a * left_s**2)
    return max(speeds)


def test_a_strong_neck_has_human_peak_velocities():
    """Simulated with the servo: the head within a tenth for shifts of 20 to 70 deg, the eyes for 10 to 30 deg."""
    eyes = {"pan": strong(NECKS[0].eyes.pan), "tilt": strong(NECKS[0].eyes.tilt)}
    neck = NECKS[0].model_copy(update={"pan": strong(NECKS[0].pan), "tilt": strong(NECKS[0].tilt), "eyes": eyes})
    human = with_motion(neck, "human")
    for shift_deg in (20.0, 70.0):
        amplitude_rad = math.radians(0.69 * shift_deg)
        assert peak_rad_s(human.pan, amplitude_rad) == pytest.approx(head_velocity_rad_s(amplitude_rad), rel=0.1)
    for eye_deg in (10.0, 30.0):
        amplitude_rad = math.radians(eye_deg)
        assert peak_rad_s(human.eyes.pan, amplitude_rad) == pytest.approx(eye_velocity_rad_s(amplitude_rad), rel=0.1)


@pytest.mark.parametrize("neck", NECKS, ids=lambda neck: neck.name)
def test_human_like_limits_raise_none_and_are_idempotent(neck):
    human = with_motion(neck, "human")
    for name in ("velocity_max_rad_s", "acceleration_max_rad_s2", "jerk_max_rad_s3"):
        assert np.all(getattr(human, name) <= getattr(neck, name))
    for name in ("dead_time_s", "servo_lag_s"):
        np.testing.assert_array_equal(getattr(human, name), getattr(neck, name))
    assert with_motion(neck, "robot") is neck
    assert 0.2 < motor_scale(neck.pan) < 1.0


def test_a_neck_without_eyes_is_refused():
    with pytest.raises(SettingsError, match="neck 'reference' has no eyes"):
        with_motion(load_neck("reference"), "human")


def test_the_eyes_take_the_remaining_angle_up_to_0_8_of_their_range():
    aim = EyeAim(with_motion(NECKS[0], "human"), np.zeros(1))
    asked_deg = np.array([[40.0, 20.0], [-40.0, -20.0], [120.0, -35.0]])
    shared_deg = np.rad2deg(aim.head_share_rad(np.deg2rad(asked_deg)))
    most_deg = np.rad2deg(0.8 * NECKS[0].command_limits.position_max_rad[2:])
    expected = [[0.69 * 40, 0.52 * 20], [-0.69 * 40, -0.08 * 20], [120.0 - most_deg[0], -35.0 + most_deg[1]]]
    np.testing.assert_allclose(shared_deg, expected, atol=1e-9)
    plain = np.deg2rad(asked_deg)
    assert EyeAim(NECKS[0], np.zeros(1)).head_share_rad(plain) is plain


def test_a_field_of_view_of_zero_is_refused_and_a_narrow_one_keeps_the_least_limits():
    for view_deg in ((60.0, 0.0), (-60.0, -34.0)):
        with pytest.raises(ValueError, match="view_deg"):
            Framing(view_deg=view_deg)
    calm = narrowed(NECK, None, None, Framing(view_deg=(1.0, 1.0), acceleration_max=0.005, jerk_max=0.01))
    assert calm.pan.acceleration_max_rad_s2 > 0.0
