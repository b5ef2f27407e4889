"""Options of the source `camera`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from gazempc.settings import Settings

# Webcams have 55 to 78 degrees.
LIKELY_FOV_DEG = 65.0


class CameraOptions(Settings):
    """Source `camera`; see `gazempc.live.sources.camera.source.CameraSource`."""

    fov_deg: float | None = Field(
        default=None,
        gt=5,
        lt=170,
        description=f"Horizontal field of view; default {LIKELY_FOV_DEG:.0f}, with a note",
    )
    calibration: Path | None = Field(
        default=None, description="OpenCV's or ROS's calibration file (.yml, .yaml, .xml, .json), in place of fov-deg"
    )
    width: int = Field(default=640, ge=64, le=4096, description="Requested width, pixels")
    height: int = Field(default=480, ge=64, le=4096, description="Requested height, pixels")
    fps: float = Field(default=30.0, gt=0, le=240, description="Requested pictures a second")
    latency_ms: float = Field(
        default=0.0, ge=0, le=2000, description="Time from the exposure of a picture to its time stamp"
    )
