"""The scene of a replay: walk, robot's place, neck, sensor and seed, with one set of defaults."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field

from gazempc.errors import SettingsError
from gazempc.neck.kinematics import head_angles_rad, look_at_rad
from gazempc.neck.limits import MOTION_MEANS, Motion, with_motion
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.recordings.load import MARK, load, load_together
from gazempc.recordings.placement import Placement, place_together
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.recording import Recording
from gazempc.settings import Settings
from gazempc.sim.sensing.spec import FieldOfView
from gazempc.sim.sensor import SensorSpec, default_sensor, load_sensor
from gazempc.types import FloatArray


class PlaceSettings(Settings):
    """Settings of a scene except neck and sensor; the default of None depends on the recording."""

    placement: Placement | None = Field(
        default=None,
        description="Where the robot stands; default: where the recording's sensor stood, "
        "or at the side if there was no sensor",
    )
    distance_m: float = Field(default=2.5, gt=0, le=100, description="Distance from the walk, for placement side")
    height_m: float = Field(default=1.2, ge=-100, le=100, description="Height above the floor, for placement side")
    seed: int = Field(default=0, ge=0, description="Seed of the sensor's noise")
    start_offset_deg: float = Field(
        default=0.0, ge=-360, le=360, description="Pan at the start, relative to the first observed head"
    )
    reading: ReadOptions = ReadOptions()


class StageSettings(PlaceSettings):
    """Settings of a scene except the neck; the default of None depends on the recording."""

    sensor: str | None = Field(
        default=None,
        description="Shipped sensor or a .toml file; default: the recording's own for body tracking and tracked "
        "people, else reference",
    )


class SceneSettings(StageSettings):
    """Settings of a scene."""

    neck: str = Field(default="reference", description="Shipped neck or a .toml file")
    motion: Motion = Field(default="robot", description=MOTION_MEANS)


@dataclass(frozen=True)
class Scene:
    """All inputs of a replay except predictor and controller.

    Attributes:
        walk: The recording in the robot's base frame, time starting at 0.
        neck: Model of the neck in controller and smoother.
        sensor: The sensor.
        placement: Pose of the robot.
        stands_at_sensor: Whether this is the pose of the recording's own sensor.
        seed: Seed of sensor noise and encoder noise.
        start_offset_deg: Initial pan relative to the first observed head, degrees.
        start_rad: Initial pan and tilt, radians; None for the first observed head plus `start_offset_deg`.
        robot_neck: The simulated neck, if it differs from `neck`; the rates must be equal.
        others: Recordings of other people, present at the same time.
    """

    walk: Recording
    neck: NeckSpec
    sensor: SensorSpec
    placement: Placement = "recorded"
    stands_at_sensor: bool = False
    seed: int = 0
    start_offset_deg: float = 0.0
    start_rad: tuple[float, float] | None = None
    robot_neck: NeckSpec | None = None
    others: tuple[Recording, ...] = ()

    @property
    def name(self) -> str:
        """Name of the recording, or of all of them."""
        return MARK.join(walk.name for walk in (self.walk, *self.others))

    def first_angles_rad(self, first_seen_base_m: FloatArray) -> FloatArray:
        """Initial joint angles.

        Args:
            first_seen_base_m: The first observed head, shape (3,), metres.

        Returns:
            Angles of all joints, shape (N,), radians: pan and tilt look at the head, the others rest; a body
            turns as far as needed for the range of the head.
        """
        start = self.neck.rest_rad.copy()
        if self.start_rad is not None:
            start[:2] = self.start_rad
            return start
        body_rad = head_angles_rad(start)[0] - start[0]
        start[:2] = look_at_rad(self.neck.geometry, first_seen_base_m)
        start[0] += np.deg2rad(self.start_offset_deg) - body_rad
        if self.neck.body is not None:
            # The body turns until the person is in the range of the head.
            limits = self.neck.command_limits
            beyond_rad = start[0] - np.clip(start[0], limits.position_min_rad[0], limits.position_max_rad[0])
            start[-1] = np.clip(start[-1] + beyond_rad, limits.position_min_rad[-1], limits.position_max_rad[-1])
            start[0] -= beyond_rad
        return start


def make_scene(
    recording: Recording | str | Path,
    settings: SceneSettings = SceneSettings(),  # noqa: B008  (frozen)
    neck: NeckSpec | None = None,
    sensor: SensorSpec | None = None,
    all_people: bool = False,
) -> Scene:
    """Make a scene.

    Args:
        recording: A recording, the name of a synthetic one, or a path; with `all_people` any argument of
            `gazempc.recordings.load.load_together`.
        settings: All other settings.
        neck: Overrides the neck of the settings.
        sensor: Overrides the sensor of the settings.
        all_people: Whether all people of the recording are present, or one of them.

    Returns:
        The scene.

    Raises:
        GazempcError: If a name does not exist, a file is invalid, or the robot's place is infeasible.
    """
    if isinstance(recording, Recording):
        walks: tuple[Recording, ...] = (recording,)
    elif all_people:
        walks = load_together(recording, settings.reading)
    elif MARK in str(recording) and not Path(recording).exists():
        raise SettingsError(f"{recording}: several people: choose one by --attend, such as --attend nearest")
    else:
        walks = (load(recording, settings.reading),)
    walk = walks[0]
    placement = settings.placement or natural_placement(walk)
    neck = with_motion(neck or load_neck(settings.neck), settings.motion)
    placed = place_together(walks, placement, settings.distance_m, settings.height_m)
    return Scene(
        walk=placed[0],
        neck=neck,
        sensor=_on_robot(sensor or load_sensor(settings.sensor or default_sensor(walk)), neck),
        placement=placement,
        stands_at_sensor=placement == "recorded" and walk.has_robot,
        seed=settings.seed,
        start_offset_deg=settings.start_offset_deg,
        others=placed[1:],
    )


def _on_robot(sensor: SensorSpec, neck: NeckSpec) -> SensorSpec:
    """The sensor, with the field of view of the camera on the robot's head if it states none."""
    if neck.head_view_deg is None or sensor.view.limited:
        return sensor
    horizontal_deg, vertical_deg = neck.head_view_deg
    view = FieldOfView(on="head", horizontal_deg=horizontal_deg, vertical_deg=vertical_deg)
    return sensor.model_copy(update={"view": view})


def natural_placement(recording: Recording) -> Placement:
    """Default place of the robot: at the recording's sensor, else beside the walk."""
    return "recorded" if recording.has_robot else "side"
