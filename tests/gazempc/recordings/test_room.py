"""The room of the paper's experiment: all walks fit into it, and its geometry is right."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from experiments.paper.routes_figure import draw_routes
from gazempc.recordings.recording import Recording
from gazempc.recordings.synthetic.room import (
    BODY_CLEARANCE_M,
    PAPER_ROOM,
    ROUTE_LANDMARKS,
    Landmark,
    Partition,
    Point,
    Room,
    clearance_m,
    crosses,
    in_view,
    inside,
    visible,
    way,
)
from gazempc.recordings.synthetic.routes import ROUTES
from gazempc.recordings.synthetic.walks import generate, synthetic_names

Array = NDArray[np.float64]

NAMES = [landmark.name for landmark in PAPER_ROOM.landmarks]
EMPTY = replace(PAPER_ROOM, partitions=())
WALL = Partition((1.0, -1.0), (1.0, 1.0))

# Eighths are exact, so that points often lie on lines and partitions.
coordinates = st.one_of(st.integers(-16, 16).map(lambda k: k / 8), st.floats(-5.0, 5.0))
points = st.tuples(coordinates, coordinates)
partitions = st.builds(Partition, points, points)


@pytest.fixture(scope="module")
def walks() -> dict[str, Recording]:
    return {name: generate(name) for name in synthetic_names()}


@pytest.fixture(scope="module")
def heads(walks: dict[str, Recording]) -> dict[str, Array]:
    return {name: walk.truth.head_position_m for name, walk in walks.items()}


@pytest.fixture(scope="module")
def paths(heads: dict[str, Array]) -> dict[str, Array]:
    return {name: head[:, :2] for name, head in heads.items()}


def sampled(path: Array, per_segment: int = 40) -> Array:
    parts = np.linspace(0.0, 1.0, per_segment + 1)[:, None, None]
    return ((1 - parts) * path[None, :-1] + parts * path[None, 1:]).reshape(-1, 2)


def sampled_gap_m(path: Array, partition: Partition) -> float:
    wall = sampled(np.array([partition.start_m, partition.end_m]), 400)
    return float(np.linalg.norm(sampled(path)[:, None] - wall[None], axis=-1).min())


# The room and the walks in it.


def test_the_room_has_the_papers_size_and_camera() -> None:
    sides_m = sorted([PAPER_ROOM.x_m[1] - PAPER_ROOM.x_m[0], PAPER_ROOM.y_m[1] - PAPER_ROOM.y_m[0]])
    assert sides_m == pytest.approx([7.3, 9.0], abs=1e-12)
    assert PAPER_ROOM.sensor_range_m == (0.5, 5.46)
    assert math.degrees(PAPER_ROOM.sensor_half_angle_rad) == pytest.approx(37.5)
    assert sorted(NAMES) == ["far", "left", "right"]


def test_the_room_is_the_same_on_the_left_and_on_the_right() -> None:
    def mirrored(point: Point) -> Point:
        return point[0], -point[1]

    def both_ends(partition: Partition) -> frozenset[Point]:
        return frozenset([partition.start_m, partition.end_m])

    assert PAPER_ROOM.y_m[0] == -PAPER_ROOM.y_m[1]
    ends = {both_ends(partition) for partition in PAPER_ROOM.partitions}
    assert {frozenset(map(mirrored, pair)) for pair in ends} == ends
    for name, other in (("left", "right"), ("far", "far")):
        desk, image = PAPER_ROOM.landmark(name), PAPER_ROOM.landmark(other)
        assert mirrored(desk.position_m) == image.position_m
        assert set(map(mirrored, desk.openings_m)) == set(image.openings_m)


def test_every_walk_keeps_clear_of_walls_and_partitions(paths: dict[str, Array]) -> None:
    assert len(paths) == 84
    for name, path in paths.items():
        assert inside(path, PAPER_ROOM), name
        assert clearance_m(path, PAPER_ROOM) >= BODY_CLEARANCE_M == 0.25, name
        assert not any(crosses(path, partition) for partition in PAPER_ROOM.partitions), name


def test_every_walk_is_seen_by_the_sensor_all_along(heads: dict[str, Array]) -> None:
    for name, head in heads.items():
        assert in_view(head[:, :2], PAPER_ROOM), name
        distance_m = np.linalg.norm(head, axis=1)
        assert distance_m.min() >= 0.5, name
        assert distance_m.max() <= 5.46, name


def test_no_partition_hides_anything_in_the_sensors_view() -> None:
    bearings = np.radians(np.linspace(-37.499, 37.499, 201))
    arc = 5.459 * np.column_stack([np.cos(bearings), np.sin(bearings)])
    assert in_view(arc, PAPER_ROOM)


def test_no_landmark_is_visible_from_another_nor_in_view() -> None:
    for i, a in enumerate(PAPER_ROOM.landmarks):
        assert not in_view(np.array([a.position_m] * 2), PAPER_ROOM)
        for b in PAPER_ROOM.landmarks[i + 1 :]:
            # Nor for eyes, or things on a desk, somewhat beside its middle.
            for dx, dy in ((0.0, 0.0), (0.2, 0.0), (-0.2, 0.0), (0.0, 0.2), (0.0, -0.2)):
                eye = (a.position_m[0] + dx, a.position_m[1] + dy)
                for ex, ey in ((0.0, 0.0), (0.2, 0.0), (-0.2, 0.0), (0.0, 0.2), (0.0, -0.2)):
                    thing = (b.position_m[0] + ex, b.position_m[1] + ey)
                    assert not visible(eye, thing, PAPER_ROOM.partitions), (a.name, b.name)


def test_landmarks_stand_free_in_the_room() -> None:
    for landmark in PAPER_ROOM.landmarks:
        spot = np.array([landmark.position_m] * 2)
        assert inside(spot, PAPER_ROOM)
        assert clearance_m(spot, PAPER_ROOM) >= 0.4


def test_every_walk_can_come_from_its_desk_and_go_on_to_its_other_desk(paths: dict[str, Array]) -> None:
    assert set(ROUTE_LANDMARKS) == set(ROUTES)
    for name, path in paths.items():
        start, end = ROUTE_LANDMARKS[name.split("_")[1]]
        assert start != end
        for desk, point in ((start, path[0]), (end, path[-1])):
            found = way(PAPER_ROOM.landmark(desk), tuple(point), PAPER_ROOM)
            assert len(found) in (2, 3), name
            np.testing.assert_array_equal(found[[0, -1]], [PAPER_ROOM.landmark(desk).position_m, point])
            assert not any(crosses(found, partition) for partition in PAPER_ROOM.partitions), name
            assert clearance_m(found, PAPER_ROOM) >= BODY_CLEARANCE_M, name


def test_routes_end_on_the_side_to_which_they_go(paths: dict[str, Array]) -> None:
    for name, path in paths.items():
        _, end = ROUTE_LANDMARKS[name.split("_")[1]]
        assert PAPER_ROOM.landmark(end).position_m[1] * path[-1, 1] > 0, name


# Geometry.


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ([(0, 0), (2, 0)], True),
        ([(2, 0.5), (0, -0.5)], True),
        ([(0, 2), (0, -2), (2, -2), (2, 2)], False),  # around it
        ([(0, 2), (0, 0), (2, 0), (2, 2)], True),  # in the second of three segments
        ([(0, 0), (0.999, 0)], False),
        ([(0, 0), (1, 0)], True),  # ends on it
        ([(0, 1), (2, 1)], True),  # touches its end
        ([(0, 1.001), (2, 1.001)], False),
        ([(0, 0), (2, 2)], True),  # likewise, aslant
        ([(0, 0.01), (2, 2.01)], False),
        ([(1, 0.5), (1, 3)], True),  # on its line, overlapping
        ([(1, 1.5), (1, 3)], False),  # on its line, beyond
        ([(1, 0.25), (1, 0.25)], True),  # standing in it
        ([(1, 1.25), (1, 1.25)], False),
        ([(1e-200, 0), (0, 1e-200)], False),
    ],
)
def test_crosses(path: list[Point], expected: bool) -> None:
    assert crosses(path, WALL) is expected
    assert crosses(path[::-1], WALL) is expected
    assert crosses(path, Partition(WALL.end_m, WALL.start_m)) is expected
    assert (clearance_m(path, replace(PAPER_ROOM, x_m=(-9, 9), partitions=(WALL,))) == 0) is expected


def test_visible_needs_all_partitions_out_of_the_way() -> None:
    screen = Partition((2.0, 0.5), (2.0, 3.0))
    assert visible((0, 0), (3, 0), [])
    assert visible((0, 0), (3, 0), [screen])
    assert not visible((0, 0), (3, 0), [screen, WALL])
    assert not visible((0, 2), (3, 2), [screen, WALL])
    assert visible((0, 0), (0.5, 0), [screen, WALL])


def test_clearance_is_to_the_nearest_wall_or_partition() -> None:
    room = Room((-1.0, 4.0), (-2.0, 2.0), (), (WALL,), (0.5, 5.0), 0.6)
    assert clearance_m([(1.5, 0), (2, 0)], room) == pytest.approx(0.5)
    assert clearance_m([(0, 1.3), (2, 1.3)], room) == pytest.approx(0.3)  # above the partition's end
    assert clearance_m([(2, 0), (3.9, 0)], room) == pytest.approx(0.1)
    assert clearance_m([(0.5, 0), (1.5, 0)], room) == 0
    assert clearance_m([(3, 0), (4.2, 0)], room) == pytest.approx(-0.2)
    assert inside([(3, 0), (4, 0)], room)
    assert not inside([(3, 0), (4.001, 0)], room)
    assert not inside([(3, 0), (3, -2.001)], room)


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((0.5, 0.0), True),
        ((0.499, 0.0), False),
        ((5.46, 0.0), True),
        ((5.461, 0.0), False),
        ((1.0, 0.76), True),  # 37.2 deg
        ((1.0, -0.78), False),  # 38.0 deg
        ((-1.0, 0.0), False),
    ],
)
def test_view_has_a_range_and_an_angle(point: Point, expected: bool) -> None:
    assert in_view([(2.0, 0.0), point], EMPTY) is expected


def test_who_is_behind_a_partition_is_not_in_view() -> None:
    assert in_view([(2.0, 1.4), (2.0, 0.0)], EMPTY)
    assert not in_view([(2.0, 1.4), (2.0, 0.0)], replace(EMPTY, partitions=(Partition((1, -0.1), (1, 0.1)),)))


def test_ways_are_straight_where_possible_and_else_go_through_the_nearer_opening() -> None:
    desk = Landmark("desk", (3.0, 0.0), ((1.0, 1.6), (1.0, -1.5)))
    room = replace(EMPTY, partitions=(WALL,))
    np.testing.assert_array_equal(way(desk, (2.0, 0.0), room), [(3, 0), (2, 0)])
    np.testing.assert_array_equal(way(desk, (0.0, 0.0), room), [(3, 0), (1, -1.5), (0, 0)])
    np.testing.assert_array_equal(way(desk, (0.0, 1.0), room), [(3, 0), (1, 1.6), (0, 1)])
    closed = replace(room, partitions=(Partition((1.0, -4.4), (1.0, 4.4)),))
    with pytest.raises(ValueError, match="desk desk"):
        way(desk, (0.0, 0.0), closed)


@pytest.mark.parametrize(
    "path", [[], [(0, 0)], [(0, 0, 0), (1, 1, 1)], [(0, 0), (math.nan, 1)], [(0, 0), (math.inf, 1)]]
)
def test_what_is_no_path_is_refused(path: list[Point]) -> None:
    for check in (inside, clearance_m, in_view):
        with pytest.raises(ValueError, match="two or more points"):
            check(path, PAPER_ROOM)
    with pytest.raises(ValueError, match="two or more points"):
        crosses(path, WALL)


def test_an_unknown_landmark_is_refused() -> None:
    with pytest.raises(KeyError, match="middle"):
        PAPER_ROOM.landmark("middle")


@given(points, points, st.lists(partitions, max_size=4))
def test_seeing_is_mutual(a: Point, b: Point, between: list[Partition]) -> None:
    assert visible(a, b, between) is visible(b, a, between[::-1])


@given(points, points, st.lists(partitions, max_size=4), partitions)
def test_one_more_partition_never_helps_to_see(a: Point, b: Point, between: list[Partition], more: Partition) -> None:
    assert visible(a, b, between) >= visible(a, b, [*between, more])


@given(st.lists(points, min_size=2, max_size=5), partitions)
def test_clearance_agrees_with_many_points_of_path_and_partition(path: list[Point], partition: Partition) -> None:
    room = replace(EMPTY, x_m=(-99.0, 99.0), y_m=(-99.0, 99.0), partitions=(partition,))
    found = clearance_m(path, room)
    dense = sampled_gap_m(np.array(path), partition)
    # Half the spacing of the samples on both, at most, lies between.
    spacing = (
        np.linalg.norm(np.diff(path, axis=0), axis=1).max() / 40 + math.dist(partition.start_m, partition.end_m) / 400
    )
    assert found <= dense + 1e-9
    assert dense <= found + 0.5 * spacing + 1e-9
    # Rounding may hide that a path just touches a partition, but no more than that.
    assert crosses(path, partition) == (found == 0.0) or found < 1e-9


# The figure.


@pytest.mark.slow
def test_the_figure_of_the_routes_is_drawn_for_synthetic_and_for_other_walks(
    walks: dict[str, Recording], tmp_path: Path
) -> None:
    synthetic = [walk for name, walk in walks.items() if name.startswith("subject01")]
    others = [replace(walk, name=f"walk{i}", kind="motion capture") for i, walk in enumerate(synthetic)]
    # A person who is lost at the start and at the end, and one who stands.
    track = others[3].truth
    lost = (np.arange(len(track.valid)) < 20) | (np.arange(len(track.valid)) > 100)
    head = np.where(lost[:, None], np.nan, track.head_position_m)
    others[3] = replace(others[3], truth=replace(track, head_position_m=head, valid=~lost))
    # Of no known group.
    standing = replace(track, head_position_m=np.tile([2.0, 0.0, 0.4], (len(lost), 1)))
    others[4] = replace(others[3], name="walk4", truth=standing, labels=replace(others[4].labels, group=None))
    pictures = []
    for name, chosen in (("synthetic", synthetic), ("others", others), ("both", [*synthetic, *others])):
        draw_routes(chosen, tmp_path / f"{name}.png")
        pictures.append((tmp_path / f"{name}.png").read_bytes())
    assert len(set(pictures)) == 3
    assert all(picture.startswith(b"\x89PNG") for picture in pictures)
    with pytest.raises(ValueError, match="no recordings"):
        draw_routes([], tmp_path / "none.png")
