"""What a user may tell the readers about a file that the file does not say itself."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class ReadOptions(BaseModel):
    """Options of all readers; each reader uses those that begin with its format's name."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    kinect_body_id: int | None = Field(
        default=None, description="Body to read from a body tracking file; default: the one seen longest."
    )
    kinect_head_joint: Literal["nose", "head"] = Field(
        default="nose", description="Joint that stands for the head: nose, or head (the base of the skull)."
    )
    kinect_camera_pitch_deg: float = Field(
        default=0.0,
        gt=-90.0,
        lt=90.0,
        description="Pitch of the camera in degrees, positive where it looks up; turns its frame level.",
    )
    bvh_unit_m: float | None = Field(
        default=None,
        gt=0.0,
        description="Metres per unit of a BVH file; default: inferred from the person's height.",
    )
    bvh_frame_rate_hz: float | None = Field(
        default=None, gt=0.0, description="Frames per second of a BVH file; default: its own Frame Time."
    )
    bvh_head_joint: str | None = Field(
        default=None, description="Name of the head's joint in a BVH file; default: found by its name."
    )
    bvh_hips_joint: str | None = Field(
        default=None,
        description="Name of the hips' joint in a BVH file; default: found by name, or the root.",
    )
    bvh_up_axis: Literal["y", "z"] | None = Field(
        default=None,
        description="Axis of a BVH file that points up; default: where the head is, seen from the hips.",
    )
