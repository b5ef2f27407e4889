"""Draw what sensors see of a walk: `python -m experiments.sensor_example --replay subject03_R4 --out out/sensors`.

A picture a sensor, seen from above with the robot at the origin. It has the true path, what the sensor saw, and at some
instants the forecast from all that had arrived by then. Ellipses should hold 95 % of its errors. With several sensors
one more, `all_sensors.png`, shows the instant in the middle as each saw it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from pydantic import Field

from experiments.engine.choices import each_sensor
from experiments.engine.command import Command
from experiments.sensor_example.seen import SeenWalk, see
from gazempc.errors import SettingsError
from gazempc.loop.build import Person, make_predictor
from gazempc.parts import PREDICTOR, name_of
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.recordings.truth import TrueHead
from gazempc.results.log import FORECAST_HORIZONS_S
from gazempc.settings import DEFAULT_PREDICTOR, PredictorChoice, PredictorSettings
from gazempc.sim.scene import SceneSettings, natural_placement
from gazempc.types import FloatArray

# A walk is known by then, and the last forecast ends with the recording.
_FIRST_S, _INSTANTS = 1.0, 3
OVERVIEW = "all_sensors.png"


class SensorExampleSettings(PredictorSettings):
    """Settings of `python -m experiments.sensor_example`."""

    replay: str = Field(default="subject03_R4", description="Synthetic name or path of a recording")
    sensors: tuple[str, ...] = Field(
        default=("reference", "body_tracker", "azure_kinect", "face_camera", "street"),
        min_length=1,
        description="Shipped sensors or .toml files",
    )
    predictor: PredictorChoice = Field(default=DEFAULT_PREDICTOR, description="Forecasts; module:Class for your own")
    at_s: tuple[float, ...] = Field(
        default=(), description="Instants of the forecasts, seconds from the first frame; without them three"
    )
    options: Annotated[dict[str, Any], tyro.conf.Suppress] = Field(
        default={}, description="Options of a predictor of your own: --options.KEY VALUE"
    )
    seed: int = Field(default=0, ge=0, description="Seed of the sensors' errors")
    out: Path = Field(default=Path("out/sensors"), description="Folder to write to")


def sensor_example(settings: SensorExampleSettings) -> list[SeenWalk]:
    """See the walk through each sensor, and draw.

    Args:
        settings: Which walk, sensors and instants.

    Returns:
        What each sensor saw, in the order of the settings.

    Raises:
        GazempcError: On bad input.
    """
    recording = load(settings.replay)
    scene = SceneSettings()
    walk = place(recording, natural_placement(recording), scene.distance_m, scene.height_m)
    sensors = [by_name[str(word)] for word, by_name in each_sensor(settings.sensors).items()]
    instants_s = _instants(settings.at_s, float(walk.times_s[-1]))
    person = Person(walk.labels.subject, TrueHead(walk))
    predictor = make_predictor(settings.predictor, settings, person, settings.options)
    all_seen = [see(walk, sensor, predictor, instants_s.tolist(), settings.seed) for sensor in sensors]

    from experiments.sensor_example.figure import draw_overview  # noqa: PLC0415  (slow to import)

    settings.out.mkdir(parents=True, exist_ok=True)
    about = f"predictor {name_of(PREDICTOR, predictor)}; seed {settings.seed}"
    draw_overview(all_seen, about, settings.out / OVERVIEW)
    return all_seen


def _run(settings: SensorExampleSettings, _: str) -> int:
    all_seen = sensor_example(settings)
    walk = all_seen[0].walk
    instants = ", ".join(f"{instant.now_s:.1f}" for instant in all_seen[0].instants)
    print(f"{walk.name} ({walk.kind}), forecasts at {instants} s; RMS error of the seen heads on each axis:")
    for seen in all_seen:
        along_mm, across_mm = seen.error_rms_mm()
        errors = f"{along_mm:5.0f} mm along, {across_mm:4.0f} mm across the line of sight"
        print(f"  {seen.sensor:16} {seen.capture_s.size:4d} frames, {errors}")
    print(f"Written to {settings.out}/: {OVERVIEW}")
    return 0


def _instants(chosen_s: Sequence[float], end_s: float) -> FloatArray:
    latest_s = end_s - max(FORECAST_HORIZONS_S)
    wrong = [at_s for at_s in chosen_s if not 0.0 <= at_s <= latest_s]
    if wrong or latest_s < _FIRST_S:
        asked = f"--at-s {wrong[0]:g}: " if wrong else ""
        raise SettingsError(
            f"{asked}the recording lasts {end_s:.2f} s and forecasts reach {max(FORECAST_HORIZONS_S):g} s ahead; "
            f"accepted: 0 to {max(latest_s, 0.0):.2f} s"
        )
    return np.unique(np.array(chosen_s)) if chosen_s else np.linspace(_FIRST_S, latest_s, _INSTANTS)


main = Command("sensor_example", SensorExampleSettings, __doc__, _run).main
