"""The room of the paper's experiment: all walks fit into it."""

import numpy as np
import pytest

from gazempc.recordings.synthetic.room import PAPER_ROOM, ROUTE_LANDMARKS
from gazempc.recordings.synthetic.routes import ROUTES
from gazempc.recordings.synthetic.walks import generate, synthetic_names

CLEARANCE_M = 0.25  # half the breadth of the shoulders


@pytest.fixture(scope="module")
def heads():
    return {name: generate(name).truth.head_position_m for name in synthetic_names()}


def partition_points():
    ends = np.array(PAPER_ROOM.partitions)
    share = np.linspace(0.0, 1.0, 100)[:, None, None]
    return ((1 - share) * ends[:, 0] + share * ends[:, 1]).reshape(-1, 2)


def test_every_walk_keeps_clear_of_walls_and_partitions(heads):
    low, high = np.array([PAPER_ROOM.x_m, PAPER_ROOM.y_m]).T
    for head in heads.values():
        path = head[:, :2]
        assert np.minimum(path - low, high - path).min() >= CLEARANCE_M
        assert np.linalg.norm(path[:, None] - partition_points(), axis=-1).min() >= CLEARANCE_M


def test_every_walk_is_in_the_sensors_view_and_no_partition_is(heads):
    def in_view(x, y, distance):
        nearest_m, farthest_m = PAPER_ROOM.sensor_range_m
        beside = np.abs(np.arctan2(y, x)) <= PAPER_ROOM.sensor_half_angle_rad
        return beside & (nearest_m <= distance) & (distance <= farthest_m)

    for head in heads.values():
        assert in_view(head[:, 0], head[:, 1], np.linalg.norm(head, axis=1)).all()
    x, y = partition_points().T
    assert not in_view(x, y, np.hypot(x, y)).any()


def test_routes_end_on_the_side_to_which_they_go():
    assert ROUTE_LANDMARKS.keys() == ROUTES.keys()
    for name, (start, end) in ROUTE_LANDMARKS.items():
        path = generate(f"subject01_{name}").truth.head_position_m
        assert (start == "far") == (ROUTES[name].group != "straight")
        assert np.sign(path[-1, 1] - path[0, 1]) == (1 if end == "left" else -1)
