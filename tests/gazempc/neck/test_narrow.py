"""Narrowed necks: the gaze stays in the region, and no joint is faster."""

import numpy as np
import pytest

import gazempc as gz
from gazempc.errors import SettingsError
from gazempc.neck.narrow import narrowed
from gazempc.neck.spec import neck_names

REGION = (-20.0, 30.0, -5.0, 15.0)


def sums(neck, angles_deg):
    """Pan and tilt of the gaze: the sums of the joints about the vertical, and of those up and down."""
    by_name = dict(zip(neck.joint_names, angles_deg.T, strict=True))
    about = [by_name[name] for name in ("pan", "eye_pan", "body_yaw") if name in by_name]
    up = [by_name[name] for name in ("tilt", "eye_tilt") if name in by_name]
    return sum(about), sum(up)


@pytest.mark.parametrize("name", neck_names())
def test_joints_at_any_end_of_their_ranges_keep_the_gaze_in_the_region(name):
    neck = gz.load_neck(name)
    narrow = narrowed(neck, REGION, 0.3)
    ends = np.rad2deg(np.stack([narrow.position_min_rad, narrow.position_max_rad]))
    pan, tilt = sums(narrow, ends)
    assert pan == pytest.approx(REGION[:2])
    assert tilt == pytest.approx(REGION[2:])
    assert np.all(narrow.position_min_rad >= neck.position_min_rad - 1e-12)
    assert np.all(narrow.position_max_rad <= neck.position_max_rad + 1e-12)
    assert np.all(narrow.velocity_max_rad_s == np.minimum(neck.velocity_max_rad_s, 0.3))
    assert narrowed(neck, None, None) == neck


@pytest.mark.parametrize("region", [(30.0, 20.0, -5.0, 5.0), (-20.0, 20.0, 60.0, 70.0)])
def test_a_region_that_the_neck_cannot_look_into_is_refused(region):
    with pytest.raises(SettingsError, match=r"gaze_region_deg: neck 'reference', (pan|tilt) of the gaze.*accepted"):
        narrowed(gz.load_neck("reference"), region, None)


@pytest.mark.parametrize(("name", "controller"), [("reference_eyes", "mpc"), ("reachy_mini_body", "lookahead")])
def test_a_replay_keeps_the_region_and_the_speed(name, controller):
    region, speed = (-10.0, 15.0, -3.0, 6.0), 0.2
    loop = {"gaze_region_deg": region, "speed_max_rad_s": speed}
    log = gz.replay("subject03_R4", neck=name, controller=controller, predictor="constant_velocity", loop=loop)
    pan, tilt = sums(log.neck, np.rad2deg(log.joint_position_rad))
    for angle, low, high in ((pan, *region[:2]), (tilt, *region[2:])):
        assert low - 1e-6 <= angle.min() <= angle.max() <= high + 1e-6
    moved_rad_s = np.diff(log.joint_position_rad, axis=0) * log.neck.servo_rate_hz
    assert np.abs(moved_rad_s).max() <= speed * (1 + 1e-6)
    assert np.ptp(pan) > 10.0  # it does look about
    assert gz.measure(log).limit_violations == 0
