"""Head and body, where the gaze is shared with eyes or with a body that turns: figures show them beside the gaze."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gazempc.neck.kinematics import gaze_ray, head_angles_rad
from gazempc.results.log import Log
from gazempc.results.metrics import gaze_error_deg
from gazempc.types import FloatArray

# Of what points elsewhere than the gaze; its colour is that of its controller.
HEAD_LINE: Any = (0, (6, 1.5, 1.5, 1.5))
_BODY_LINE: Any = (0, (1.5, 1.5))


@dataclass(frozen=True)
class Part:
    """What points somewhere beside the gaze.

    Attributes:
        label: Name for people.
        direction: Where it points in the base frame at each tick, shape (M, 3), unit; NaN where it is not known.
        line: Line style, as matplotlib takes it.
        line_name: What the line is called.
        marker: Marker, as matplotlib takes it.
        level: Whether it turns about the vertical only.
    """

    label: str
    direction: FloatArray
    line: Any
    line_name: str
    marker: str
    level: bool


def parts(log: Log) -> tuple[Part, ...]:
    """The parts that point elsewhere than the gaze.

    Args:
        log: The run.

    Returns:
        The head of a neck with eyes, and the body of one that turns; none of pan and tilt.
    """
    neck, joints = log.neck, log.joint_position_rad
    found = []
    if neck.eyes is not None:
        _, direction = gaze_ray(neck.geometry, head_angles_rad(joints))
        found.append(Part("robot's head", direction, HEAD_LINE, "dashed", "s", level=False))
    if neck.body is not None:
        yaw = joints[:, neck.joint_names.index("body_yaw")]
        forward = np.stack([np.cos(yaw), np.sin(yaw), 0.0 * yaw], axis=-1)
        found.append(Part("robot's body", forward, _BODY_LINE, "dotted", "^", level=True))
    return tuple(found)


def head_alone(log: Log) -> Log | None:
    """The run as if the eyes looked where the head points; None for a neck without eyes."""
    neck = log.neck
    if neck.eyes is None:
        return None
    plain = neck.model_copy(update={"eyes": None, "body": None})
    return replace(
        log,
        run=log.run.model_copy(update={"neck": plain}),
        joint_position_rad=head_angles_rad(log.joint_position_rad),
        joint_velocity_rad_s=head_angles_rad(log.joint_velocity_rad_s),
        command_position_rad=head_angles_rad(log.command_position_rad),
        command_velocity_rad_s=head_angles_rad(log.command_velocity_rad_s),
        command_acceleration_rad_s2=head_angles_rad(log.command_acceleration_rad_s2),
    )


def head_error_deg(log: Log) -> FloatArray | None:
    """Angle between where the head points and the true head, shape (M,), degrees; None for a neck without eyes."""
    alone = head_alone(log)
    return None if alone is None else gaze_error_deg(alone)
