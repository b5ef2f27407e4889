"""The room of the paper's experiment, from above: walls, partitions, three desks and what the sensor sees.

From Tamaru et al. (2021) are the size of the room, the number of the desks, that partitions hide each of them from
the others, and the camera. Where all this stands is our layout, because the paper's text gives no coordinates. The
walks of `gazempc.recordings.synthetic.walks` do not depend on it.

All positions are horizontal, x and y in metres in the base frame: the sensor is the origin, x forward, y left. Paths
are joined from point to point by straight lines.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gazempc.types import FloatArray

Point = tuple[float, float]

BODY_CLEARANCE_M = 0.25
"""What a person's head keeps from walls and partitions: half the breadth of the shoulders."""


@dataclass(frozen=True)
class Partition:
    """A thin wall too high to look over.

    Attributes:
        start_m: One end, x and y.
        end_m: The other end.
    """

    start_m: Point
    end_m: Point


@dataclass(frozen=True)
class Landmark:
    """A desk at which routes begin and end.

    Attributes:
        name: What `ROUTE_LANDMARKS` calls it.
        position_m: Its middle, x and y.
        openings_m: Where people pass the ends of the partition before it.
    """

    name: str
    position_m: Point
    openings_m: tuple[Point, ...]


@dataclass(frozen=True)
class Room:
    """A rectangular room with the sensor at the origin, facing along x.

    Attributes:
        x_m: Walls behind and ahead of the sensor.
        y_m: Walls on its right and left.
        landmarks: The desks.
        partitions: What hides them from each other.
        sensor_range_m: Smallest and largest distance at which the sensor sees people.
        sensor_half_angle_rad: Half of the sensor's horizontal angle of view.
    """

    x_m: tuple[float, float]
    y_m: tuple[float, float]
    landmarks: tuple[Landmark, ...]
    partitions: tuple[Partition, ...]
    sensor_range_m: tuple[float, float]
    sensor_half_angle_rad: float

    def landmark(self, name: str) -> Landmark:
        """The desk of this name.

        Args:
            name: One of the landmarks' names.

        Returns:
            The desk.

        Raises:
            KeyError: There is none of this name.
        """
        return {landmark.name: landmark for landmark in self.landmarks}[name]


# The partitions stand just outside of what the camera sees: beyond 5.46 m, and beside 37.5 deg up to there. On the
# left and on the right is the same.
PAPER_ROOM = Room(
    x_m=(-0.3, 7.0),
    y_m=(-4.5, 4.5),
    landmarks=(
        Landmark("left", (2.3, 4.05), ((3.9, 3.75), (0.8, 3.75))),
        Landmark("right", (2.3, -4.05), ((3.9, -3.75), (0.8, -3.75))),
        Landmark("far", (6.35, 0.0), ((6.1, 2.0), (6.1, -2.0))),
    ),
    partitions=(
        Partition((1.5, 3.45), (3.2, 3.45)),
        Partition((1.5, -3.45), (3.2, -3.45)),
        Partition((5.7, -0.8), (5.7, 0.8)),
    ),
    sensor_range_m=(0.5, 5.46),  # Azure Kinect, NFOV 2x2 binned, as in the paper
    sensor_half_angle_rad=math.radians(37.5),  # its depth camera sees 75 deg x 65 deg in this mode
)
"""Size, number of desks and camera are the paper's; the layout is ours."""

ROUTE_LANDMARKS = {
    "R1": ("right", "left"),
    "R2": ("left", "right"),
    "R3": ("far", "right"),
    "R4": ("far", "left"),
    "R5": ("far", "right"),
    "R6": ("far", "left"),
}
"""Desks at which each route starts and ends. Who comes toward the robot and turns left ends on the robot's right."""


def crosses(path_base_m: ArrayLike, partition: Partition) -> bool:
    """Whether a path crosses or touches a partition.

    Args:
        path_base_m: Shape (N, 2), N at least 2, metres.
        partition: The partition.

    Returns:
        True where they have a point in common.

    Raises:
        ValueError: The path has another shape, or numbers that are not finite.
    """
    path = _checked(path_base_m)
    a, b = path[:-1], path[1:]
    c, d = np.array(partition.start_m), np.array(partition.end_m)
    apart = np.any((np.maximum(a, b) < np.minimum(c, d)) | (np.maximum(c, d) < np.minimum(a, b)), axis=1)
    # Signs, because products of small numbers could vanish. For segments on one line the boxes above decide.
    divided = np.sign(_turn(c, d, a)) * np.sign(_turn(c, d, b)) <= 0
    dividing = np.sign(_turn(a, b, c)) * np.sign(_turn(a, b, d)) <= 0
    return bool(np.any(~apart & divided & dividing))


def visible(a: Point, b: Point, partitions: Iterable[Partition]) -> bool:
    """Whether one can see from one point to another.

    Args:
        a: Where from, x and y in metres.
        b: Where to; the other way round is the same.
        partitions: What may stand between them; a line of sight that touches one is blocked.

    Returns:
        True where none does.

    Raises:
        ValueError: A coordinate is not finite.
    """
    # In a fixed order, so that rounding is the same both ways.
    sight = np.array(sorted([tuple(a), tuple(b)]))
    return not any(crosses(sight, partition) for partition in partitions)


def inside(path_base_m: ArrayLike, room: Room) -> bool:
    """Whether a path stays within the walls; on a wall counts as within.

    Args:
        path_base_m: Shape (N, 2), N at least 2, metres.
        room: The room.

    Returns:
        True where it never leaves the room.

    Raises:
        ValueError: The path has another shape, or numbers that are not finite.
    """
    return _wall_gap_m(_checked(path_base_m), room) >= 0


def clearance_m(path_base_m: ArrayLike, room: Room) -> float:
    """Smallest distance of a path from walls and partitions.

    Args:
        path_base_m: Shape (N, 2), N at least 2, metres.
        room: The room.

    Returns:
        Metres; 0 where it crosses a partition, negative where it leaves the room.

    Raises:
        ValueError: The path has another shape, or numbers that are not finite.
    """
    path = _checked(path_base_m)
    return min([_wall_gap_m(path, room), *(_gap_m(path, partition) for partition in room.partitions)])


def in_view(path_base_m: ArrayLike, room: Room) -> bool:
    """Whether the sensor sees every point of a path: near enough, far enough, and no partition in between.

    Args:
        path_base_m: Shape (N, 2), N at least 2, metres; at the sensor's height.
        room: The room.

    Returns:
        True where it sees them all.

    Raises:
        ValueError: The path has another shape, or numbers that are not finite.
    """
    path = _checked(path_base_m)
    distance_m = np.hypot(path[:, 0], path[:, 1])
    bearing_rad = np.abs(np.arctan2(path[:, 1], path[:, 0]))
    nearest_m, farthest_m = room.sensor_range_m
    in_range = (nearest_m <= distance_m) & (distance_m <= farthest_m)
    in_angle = bearing_rad <= room.sensor_half_angle_rad
    there_and_back = np.zeros((2 * len(path), 2))
    there_and_back[1::2] = path
    return bool(np.all(in_range & in_angle)) and not any(crosses(there_and_back, p) for p in room.partitions)


def way(landmark: Landmark, point_m: Point, room: Room) -> FloatArray:
    """Shortest way from a desk to a point, straight or with a corner at one of the desk's openings.

    Args:
        landmark: Where from.
        point_m: Where to, x and y in metres.
        room: The room.

    Returns:
        Shape (2, 2) or (3, 2), metres; keeps `BODY_CLEARANCE_M` from walls and partitions.

    Raises:
        ValueError: There is no such way, or a coordinate is not finite.
    """
    corners: tuple[tuple[Point, ...], ...] = ((), *((opening,) for opening in landmark.openings_m))
    ways = [np.array([landmark.position_m, *corner, point_m]) for corner in corners]
    free = [w for w in ways if clearance_m(w, room) >= BODY_CLEARANCE_M]
    if not free:
        raise ValueError(f"no way with at most one corner from desk {landmark.name} to {point_m}")
    return min(free, key=lambda w: float(np.linalg.norm(np.diff(w, axis=0), axis=1).sum()))


def _checked(path_base_m: ArrayLike) -> FloatArray:
    path = np.asarray(path_base_m, dtype=np.float64)
    if path.ndim != 2 or path.shape[0] < 2 or path.shape[1] != 2 or not np.isfinite(path).all():
        raise ValueError(f"a path needs two or more points x, y, all finite; got shape {path.shape}")
    return path


def _turn(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Positive where c lies to the left of the line from a to b; shapes (..., 2) to (...)."""
    ab, ac = b - a, c - a
    return np.asarray(ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0])


def _distance_m(points: FloatArray, starts: FloatArray, ends: FloatArray) -> FloatArray:
    """Distances of points from segments; shapes (..., 2) to (...)."""
    along = ends - starts
    length2 = np.maximum((along**2).sum(axis=-1), np.finfo(np.float64).tiny)
    part = np.clip(((points - starts) * along).sum(axis=-1) / length2, 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - starts - part[..., None] * along, axis=-1))


def _gap_m(path: FloatArray, partition: Partition) -> float:
    """Smallest distance between a path, shape (N, 2), and a partition."""
    if crosses(path, partition):
        return 0.0
    # Segments that do not cross are nearest to each other at an end of one of them.
    ends = np.array([partition.start_m, partition.end_m])
    from_path_m = _distance_m(path, ends[0], ends[1])
    from_ends_m = _distance_m(ends[:, None], path[:-1], path[1:])
    return float(min(from_path_m.min(), from_ends_m.min()))


def _wall_gap_m(path: FloatArray, room: Room) -> float:
    """Smallest distance of a path, shape (N, 2), from the walls; negative outside."""
    # Between two points of a path, no point is nearer to a wall than both of them.
    low, high = np.array([room.x_m[0], room.y_m[0]]), np.array([room.x_m[1], room.y_m[1]])
    return float(np.minimum(path - low, high - path).min())
