"""The room of the paper's experiment, from above: walls, partitions, three desks and what the sensor sees.

From Tamaru et al. (2021) are the size of the room, the number of the desks, that partitions hide each of them from
the others, and the camera. Where all this stands is our layout, because the paper's text gives no coordinates. The
walks of `gazempc.recordings.synthetic.walks` do not depend on it.

All positions are horizontal, x and y in metres in the base frame: the sensor is the origin, x forward, y left. Paths
are joined from point to point by straight lines.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gazempc.types import FloatArray

Point = tuple[float, float]


@dataclass(frozen=True)
class Landmark:
    """A desk at which routes begin and end.

    Attributes:
        name: As in `ROUTE_LANDMARKS`.
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
        partitions: Ends of thin walls that hide the desks from each other.
        sensor_range_m: Smallest and largest distance at which the sensor sees people.
        sensor_half_angle_rad: Half of the sensor's horizontal angle of view.
    """

    x_m: tuple[float, float]
    y_m: tuple[float, float]
    landmarks: tuple[Landmark, ...]
    partitions: tuple[tuple[Point, Point], ...]
    sensor_range_m: tuple[float, float]
    sensor_half_angle_rad: float


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
        ((1.5, 3.45), (3.2, 3.45)),
        ((1.5, -3.45), (3.2, -3.45)),
        ((5.7, -0.8), (5.7, 0.8)),
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
"""Desks at which each route starts and ends. A left turn toward the robot ends on the robot's right."""


def way(desk: str, point_m: Point) -> FloatArray:
    """Way from a desk to a point, round the end of its partition that makes it shorter.

    Args:
        desk: Name of a landmark of `PAPER_ROOM`.
        point_m: Where to, x and y in metres.

    Returns:
        Shape (3, 2), metres.
    """
    landmark = next(landmark for landmark in PAPER_ROOM.landmarks if landmark.name == desk)
    ways = [np.array([landmark.position_m, opening, point_m]) for opening in landmark.openings_m]
    return min(ways, key=lambda points: float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()))
