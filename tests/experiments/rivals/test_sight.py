"""Directions and points from a place in the image, against the plant's own geometry."""

import numpy as np
import pytest
from builders.rival_bench import CAMERA, offset_of

from experiments.rivals.laws.cameras import OneEuro
from experiments.rivals.rival import Detection, FrameRate, bearing_rad, point_base_m
from gazempc.neck.kinematics import gaze_ray, look_at_rad
from gazempc.neck.spec import load_neck


@pytest.mark.parametrize("head_deg", [(0.0, 0.0), (50.0, -20.0), (-170.0, 30.0)])
def test_the_bearing_is_the_persons_whatever_the_heads_angles(head_deg):
    person_deg = np.add(head_deg, [-18.0, 11.0])
    head_rad = np.deg2rad(head_deg)
    found = bearing_rad(CAMERA, offset_of(person_deg, head_rad, CAMERA), head_rad)
    np.testing.assert_allclose(np.rad2deg(found), person_deg, atol=1e-9)


def test_the_point_is_where_the_eye_sees_it():
    geometry = load_neck("pr2").geometry
    point_m, head_rad = np.array([1.5, 0.4, 0.3]), look_at_rad(geometry, np.array([1.5, 0.4, 0.3]))
    range_m = float(np.linalg.norm(point_m - gaze_ray(geometry, head_rad)[0]))
    detection = Detection(0.0, 0.1, np.zeros(2), range_m, np.array([90.0, 120.0]))
    np.testing.assert_allclose(point_base_m(geometry, CAMERA, detection, head_rad), point_m, atol=1e-9)


def test_a_detector_takes_every_third_frame_of_thirty_a_second_for_ten():
    frames = tuple(Detection(k / 30, k / 30, np.zeros(2), 1.0, np.ones(2)) for k in range(10))
    taken = [round(d.capture_time_s * 30) for d in FrameRate(0.1).take(frames)]
    assert taken == [0, 3, 6, 9]


def test_the_one_euro_filter_of_a_step_is_a_low_pass_of_its_cutoff():
    """With beta = 0 each step closes the share w / (w + 1), w = 2 pi f dt."""
    one_euro = OneEuro(1.1, 0.0, 1.0)
    one_euro.update(np.zeros(1), 0.1)
    w = 2.0 * np.pi * 1.1 * 0.1
    for k in range(1, 5):
        assert one_euro.update(np.ones(1), 0.1)[0] == pytest.approx(1.0 - (1.0 - w / (w + 1.0)) ** k)
    opened = OneEuro(1.1, 0.5, 1.0)
    opened.update(np.zeros(1), 0.1)
    assert opened.update(np.ones(1), 0.1)[0] > w / (w + 1.0)
