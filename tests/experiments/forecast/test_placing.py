"""Where the robot stands in a comparison of forecasts."""

import numpy as np

from experiments.forecast.errors import placed_for
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.recordings.recording import Recording
from gazempc.sim.sensor import load_sensor


def elsewhere():
    """A synthetic walk as motion capture gives it: nobody says where a robot stood."""
    walk = load("subject01_R4")
    return Recording(**vars(walk) | {"has_robot": False})


def test_the_recordings_own_frame_serves_where_nothing_depends_on_the_place():
    walk = elsewhere()
    for name in ("perfect", "reference", "body_tracker", "street"):
        assert placed_for(walk, load_sensor(name)) is walk


def test_a_sensor_with_a_line_of_sight_stands_beside_the_walk_or_where_one_stood():
    camera = load_sensor("face_camera")
    walk = elsewhere()
    expected = place(walk, "side", 2.5, 1.2).truth.head_position_m
    np.testing.assert_array_equal(placed_for(walk, camera).truth.head_position_m, expected)
    own = load("subject01_R4")
    np.testing.assert_array_equal(placed_for(own, camera).truth.head_position_m, own.truth.head_position_m)
