"""Where a robot stands whose forecasts are compared, and what its predictors get to see."""

from __future__ import annotations

from gazempc.recordings.placement import place
from gazempc.recordings.recording import Recording
from gazempc.sim.scene import SceneSettings, natural_placement
from gazempc.sim.sensor import SensorSpec, observe
from predictors import HeadObservation

_SCENE = SceneSettings()


def placed_for(recording: Recording, sensor: SensorSpec) -> Recording:
    """A recording in the frame in which a sensor sees it.

    Where nothing depends on the robot's place, the recording's own frame serves: errors are then the same everywhere.
    Otherwise the robot stands where a replay puts it if nobody says anything: where the recording's sensor stood, or
    2.5 m beside the walk.

    Args:
        recording: The recording, in its own frame.
        sensor: The sensor.

    Returns:
        The recording, in the base frame if that matters.

    Raises:
        PlacementError: If the head comes too near to the robot.
    """
    if not sensor.depends_on_place:
        return recording
    return place(recording, natural_placement(recording), _SCENE.distance_m, _SCENE.height_m)


def observations_of(recording: Recording, sensor: SensorSpec, seed: int) -> list[HeadObservation]:
    """What a predictor gets to see: as in the loop, a frame that was overtaken by a newer one is dropped.

    Args:
        recording: The recording, as `placed_for` gives it.
        sensor: The sensor.
        seed: Seed of its errors.

    Returns:
        The observations in order of capture.
    """
    newer: list[HeadObservation] = []
    for sighting in observe(recording, sensor, seed):
        if not newer or sighting.observation.capture_time_s > newer[-1].capture_time_s:
            newer.append(sighting.observation)
    return newer
