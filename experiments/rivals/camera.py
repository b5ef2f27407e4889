"""A camera on the moving head: what it makes of what a sensor saw.

Rivals and ours see the same people with the same errors, losses and delays. The sensor's observations are put back into
the image of a camera that was where the head was.
"""

from __future__ import annotations

import math

import numpy as np

from experiments.rivals.rival import Detection, HeadCamera
from gazempc.neck.poses import seen_from_head
from gazempc.neck.spec import Geometry
from gazempc.sim.sensing.tables import FieldOfView
from gazempc.sim.sensor import SensorSpec
from gazempc.types import FloatArray, Sighting

# Field of view and aspect of the Raspberry Pi Camera Module 3 Wide, as on Reachy Mini: 102 by 67 degrees.
HORIZONTAL_DEG, VERTICAL_DEG = 102.0, 67.0
WIDTH_PX, HEIGHT_PX = 1280, 720
# Of the box's edges: as the PTZ simulator of Frigate.
BOX_NOISE_PX = 2.0
# A face is narrower than it is high.
_WIDTH_TO_HEIGHT = 0.75


def on_the_head(sensor: SensorSpec) -> SensorSpec:
    """A sensor with the same errors that sits beside the eye and turns with it.

    Args:
        sensor: The sensor; its own field of view is kept if it is on a head.

    Returns:
        The sensor, with a limited field of view on the head.
    """
    if sensor.view.on == "head" and sensor.view.horizontal_deg < 180.0 and sensor.view.vertical_deg < 180.0:
        return sensor
    view = FieldOfView(on="head", horizontal_deg=HORIZONTAL_DEG, vertical_deg=VERTICAL_DEG)
    return sensor.model_copy(update={"view": view})


def camera_of(sensor: SensorSpec) -> HeadCamera:
    """The camera that a sensor on the head is.

    Args:
        sensor: A sensor as `on_the_head` makes it.

    Returns:
        The camera. Its noise is that of the box alone: the sensor's errors are in the place of the face already.
    """
    return HeadCamera(
        half_width_rad=math.radians(sensor.view.horizontal_deg) / 2.0,
        half_height_rad=math.radians(sensor.view.vertical_deg) / 2.0,
        width_px=WIDTH_PX,
        height_px=HEIGHT_PX,
        rate_hz=sensor.rate_hz,
        latency_s=sensor.latency_s,
        pixel_noise_px=BOX_NOISE_PX,
    )


def detect(
    camera: HeadCamera, geometry: Geometry, joints_rad: FloatArray, sighting: Sighting, rng: np.random.Generator
) -> Detection | None:
    """What a camera on the head shows of a sighting.

    Args:
        camera: The camera; it sits in the eye.
        geometry: The neck's geometry.
        joints_rad: Where pan and tilt were at the capture, shape (2,), radians.
        sighting: What the sensor saw.
        rng: Draws the noise of the box.

    Returns:
        The face in the image; None if it is out of view.
    """
    seen_m = seen_from_head(geometry, joints_rad, sighting.observation.head_position_base_m)
    ahead_m, left_m, up_m = seen_m.tolist()
    if ahead_m <= 0.0:
        return None
    half_image = np.tan([camera.half_width_rad, camera.half_height_rad])
    offset = -np.array([left_m, up_m]) / ahead_m / half_image
    if np.any(np.abs(offset) > 1.0):
        return None
    range_m = float(np.linalg.norm(seen_m))
    height_px = camera.face_height_m / ahead_m / half_image[1] * camera.height_px / 2.0
    box_px = np.array([_WIDTH_TO_HEIGHT * height_px, height_px]) + rng.normal(0.0, camera.pixel_noise_px, 2)
    return Detection(
        capture_time_s=sighting.observation.capture_time_s,
        arrival_time_s=sighting.arrival_s,
        offset=offset,
        range_m=range_m,
        box_px=np.maximum(box_px, 1.0),
    )
