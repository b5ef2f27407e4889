"""The head-mounted camera, and directions and points from image positions, compared with trigonometry by hand."""

import math

import numpy as np
import pytest
from builders.rival_bench import CAMERA, offset_of

from experiments.rivals.laws.cameras import OneEuro
from experiments.rivals.rival import Detection, FrameRate, HeadCamera, bearing_rad, point_base_m
from experiments.rivals.simulate import camera_of, detect, on_the_head
from gazempc.neck.kinematics import gaze_ray, look_at_rad
from gazempc.neck.spec import Geometry, load_neck
from gazempc.sim.sensing.spec import FieldOfView
from gazempc.sim.sensor import load_sensor
from gazempc.types import Sighting
from predictors import HeadObservation

RIGHT_ANGLED = HeadCamera(math.radians(45.0), math.radians(30.0), 1000, 600, 30.0, 0.1, 0.0)
POINT = Geometry()


def seen(position_m: list[float], joints_deg: tuple[float, float] = (0.0, 0.0), geometry: Geometry = POINT):
    sighting = Sighting(1.1, HeadObservation(1.0, np.array(position_m)))
    return detect(RIGHT_ANGLED, geometry, np.deg2rad(joints_deg), sighting, np.random.default_rng(0))


def test_the_face_is_at_its_pinhole_projection() -> None:
    face = seen([2.0, 0.5, -0.2])
    # tan 45 deg is 1; tan 30 deg is 0.577. Left is negative x, down is positive y.
    np.testing.assert_allclose(face.offset, [-0.25, 0.1 / math.tan(math.radians(30.0))])
    assert (face.capture_time_s, face.arrival_time_s) == (1.0, 1.1)
    assert face.range_m == pytest.approx(math.sqrt(4.0 + 0.25 + 0.04))
    # 0.24 m at 2 m, of an image 2 * 2 * tan 30 deg = 2.31 m high.
    assert face.box_px[1] == pytest.approx(600.0 * 0.24 / (4.0 * math.tan(math.radians(30.0))))


@pytest.mark.parametrize("position_m", [[2.0, 2.1, 0.0], [2.0, 0.0, -1.3], [-2.0, 0.1, 0.0]])
def test_people_outside_the_view_are_not_detected(position_m: list[float]) -> None:
    assert seen(position_m) is None


def test_a_sensor_moves_to_the_head_and_keeps_its_field_of_view() -> None:
    on_base = load_sensor("face_camera")
    moved = on_the_head(on_base)
    assert moved.view == FieldOfView(on="head", horizontal_deg=102.0, vertical_deg=67.0)
    assert moved.model_copy(update={"view": on_base.view}) == on_base
    narrow = on_base.model_copy(update={"view": FieldOfView(on="head", horizontal_deg=60.0, vertical_deg=40.0)})
    assert on_the_head(narrow) == narrow
    camera = camera_of(narrow)
    assert (camera.half_width_rad, camera.half_height_rad) == pytest.approx((math.radians(30.0), math.radians(20.0)))
    assert (camera.rate_hz, camera.latency_s) == (narrow.rate_hz, narrow.latency_s)


@pytest.mark.parametrize("head_deg", [(0.0, 0.0), (50.0, -20.0), (-170.0, 30.0)])
def test_the_bearing_is_independent_of_the_head_angles(head_deg):
    person_deg = np.add(head_deg, [-18.0, 11.0])
    head_rad = np.deg2rad(head_deg)
    found = bearing_rad(CAMERA, offset_of(person_deg, head_rad, CAMERA), head_rad)
    np.testing.assert_allclose(np.rad2deg(found), person_deg, atol=1e-9)


def test_the_point_is_on_the_line_of_sight_of_the_eye():
    geometry = load_neck("pr2").geometry
    point_m, head_rad = np.array([1.5, 0.4, 0.3]), look_at_rad(geometry, np.array([1.5, 0.4, 0.3]))
    range_m = float(np.linalg.norm(point_m - gaze_ray(geometry, head_rad)[0]))
    detection = Detection(0.0, 0.1, np.zeros(2), range_m, np.array([90.0, 120.0]))
    np.testing.assert_allclose(point_base_m(geometry, CAMERA, detection, head_rad), point_m, atol=1e-9)


def test_a_10_hz_detector_takes_every_third_frame_at_30_hz():
    frames = tuple(Detection(k / 30, k / 30, np.zeros(2), 1.0, np.ones(2)) for k in range(10))
    taken = [round(d.capture_time_s * 30) for d in FrameRate(0.1).take(frames)]
    assert taken == [0, 3, 6, 9]


def test_the_one_euro_filter_of_a_step_is_a_low_pass_of_its_cutoff():
    """With beta = 0 the smoothing factor is w / (w + 1), w = 2 pi f dt."""
    one_euro = OneEuro(1.1, 0.0, 1.0)
    one_euro.update(np.zeros(1), 0.1)
    w = 2.0 * np.pi * 1.1 * 0.1
    for k in range(1, 5):
        assert one_euro.update(np.ones(1), 0.1)[0] == pytest.approx(1.0 - (1.0 - w / (w + 1.0)) ** k)
    opened = OneEuro(1.1, 0.5, 1.0)
    opened.update(np.zeros(1), 0.1)
    assert opened.update(np.ones(1), 0.1)[0] > w / (w + 1.0)
