"""The camera on the head against trigonometry by hand."""

import math

import numpy as np
import pytest

from experiments.rivals.rival import HeadCamera
from experiments.rivals.simulate import camera_of, detect, on_the_head
from gazempc.neck.spec import Geometry
from gazempc.sim.sensing.tables import FieldOfView
from gazempc.sim.sensor import load_sensor
from gazempc.types import Sighting
from predictors import HeadObservation

CAMERA = HeadCamera(math.radians(45.0), math.radians(30.0), 1000, 600, 30.0, 0.1, 0.0)
POINT = Geometry()


def seen(position_m: list[float], joints_deg: tuple[float, float] = (0.0, 0.0), geometry: Geometry = POINT):
    sighting = Sighting(1.1, HeadObservation(1.0, np.array(position_m)))
    return detect(CAMERA, geometry, np.deg2rad(joints_deg), sighting, np.random.default_rng(0))


def test_the_face_is_where_a_pinhole_shows_it() -> None:
    face = seen([2.0, 0.5, -0.2])
    # tan 45 deg is 1; tan 30 deg is 0.577. Left is negative x, down is positive y.
    np.testing.assert_allclose(face.offset, [-0.25, 0.1 / math.tan(math.radians(30.0))])
    assert (face.capture_time_s, face.arrival_time_s) == (1.0, 1.1)
    assert face.range_m == pytest.approx(math.sqrt(4.0 + 0.25 + 0.04))
    # 0.24 m at 2 m, of an image 2 * 2 * tan 30 deg = 2.31 m high.
    assert face.box_px[1] == pytest.approx(600.0 * 0.24 / (4.0 * math.tan(math.radians(30.0))))


@pytest.mark.parametrize("position_m", [[2.0, 2.1, 0.0], [2.0, 0.0, -1.3], [-2.0, 0.1, 0.0]])
def test_who_is_out_of_view_is_not_seen(position_m: list[float]) -> None:
    assert seen(position_m) is None


def test_a_sensor_is_put_on_the_head_and_keeps_a_view_of_its_own() -> None:
    on_base = load_sensor("face_camera")
    moved = on_the_head(on_base)
    assert moved.view == FieldOfView(on="head", horizontal_deg=102.0, vertical_deg=67.0)
    assert moved.model_copy(update={"view": on_base.view}) == on_base
    narrow = on_base.model_copy(update={"view": FieldOfView(on="head", horizontal_deg=60.0, vertical_deg=40.0)})
    assert on_the_head(narrow) == narrow
    camera = camera_of(narrow)
    assert (camera.half_width_rad, camera.half_height_rad) == pytest.approx((math.radians(30.0), math.radians(20.0)))
    assert (camera.rate_hz, camera.latency_s) == (narrow.rate_hz, narrow.latency_s)
