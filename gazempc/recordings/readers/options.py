"""Options of the readers: facts about a file that are not in it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro
from pydantic import BaseModel, ConfigDict, Field


class ReadOptions(BaseModel):
    """Options of all readers; those that begin with the name of a format are for it alone."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    columns: str | None = Field(
        default=None,
        description="Meaning of a table's columns, such as 't=stamp:ns, head=[px,py,pz]:mm, axes=y-up'; see the "
        "page Tables as exported",
    )
    mapping: Path | None = Field(
        default=None, description="TOML file with the meaning of the columns; default: the file beside the table"
    )
    guess: Annotated[bool, tyro.conf.arg(aliases=["--guess"])] = Field(
        default=False, description="Infer the meaning of the columns, and print it"
    )
    person: str | None = Field(
        default=None, description="Person to read, of several; default: the person with the longest track"
    )
    kinect_body_id: int | None = Field(
        default=None, description="Body to read from a body tracking file; default: the body in most frames."
    )
    kinect_head_joint: Literal["nose", "head"] = Field(
        default="nose", description="Joint used as the head: nose, or head (the base of the skull)."
    )
    kinect_camera_pitch_deg: float = Field(
        default=0.0,
        gt=-90.0,
        lt=90.0,
        description="Pitch of the camera in degrees, positive upwards; levels its frame.",
    )
    bvh_unit_m: float | None = Field(
        default=None, gt=0.0, description="Metres per unit of a BVH file; default: inferred from the person's height."
    )
    bvh_frame_rate_hz: float | None = Field(
        default=None, gt=0.0, description="Frames per second of a BVH file; default: from its Frame Time."
    )
    bvh_head_joint: str | None = Field(
        default=None, description="Head's joint in a BVH file; default: by its name, else the upper end of the spine."
    )
    bvh_hips_joint: str | None = Field(
        default=None, description="Hips' joint in a BVH file; default: by its name, else where both legs start."
    )
    bvh_facing: Literal["x", "-x", "y", "-y", "z", "-z"] | None = Field(
        default=None,
        description="Axis that the person faces in a BVH file's rest pose; default: by left and right joints, else "
        "by the feet, else by the direction of travel.",
    )
    bvh_up_axis: Literal["y", "z"] | None = Field(
        default=None, description="Up axis of a BVH file; default: from the hips to the head."
    )
    bag_topic: str | None = Field(
        default=None, description="Topic of a ROS 2 bag with the head; default: the topic with the longest track."
    )
    bag_frame: str | None = Field(
        default=None, description="Frame of a ROS 2 bag in which the robot stands; default: the sensor's."
    )
    bag_axes: Literal["optical", "forward"] | None = Field(
        default=None,
        description="Axes of bag_frame: z forward, y down (optical) or x forward, z up; default: by its name, or by "
        "the positions of people.",
    )
