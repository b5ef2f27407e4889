"""Draw the view of sensors of a walk: `python -m experiments.sensor_example --replay subject03_R4 --out out/sensors`.

A panel for each sensor, seen from above with the robot at the origin: the true path, what the sensor saw, and at one
instant the forecast from all that had arrived by then. Ellipses should hold 95 % of its errors.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pydantic import Field

from experiments.engine.choices import each_sensor
from experiments.engine.command import Command
from experiments.forecast.errors import in_order
from gazempc.errors import SettingsError
from gazempc.loop.build import Person, make_predictor
from gazempc.parts import PREDICTOR, name_of
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.recordings.recording import Recording
from gazempc.recordings.truth import TrueHead
from gazempc.results.figures.style import COLOURS
from gazempc.results.forecast_metrics import squared_radius
from gazempc.results.log import FORECAST_HORIZONS_S
from gazempc.settings import DEFAULT_PREDICTOR, PredictorChoice, PredictorSettings
from gazempc.sim.scene import SceneSettings, natural_placement
from gazempc.sim.sensor import SensorSpec
from gazempc.types import FloatArray
from predictors import Predictor

SHARE = 0.95


@dataclass(frozen=True)
class SeenWalk:
    """Observations of a walk by one sensor, and the forecast from them at one instant, from above.

    Attributes:
        sensor: Its name.
        walk: The walk, in the base frame.
        truth: The true head of it.
        capture_s: Capture times of what arrived in order, shape (F,), seconds.
        observed_base_m: The heads that were seen, shape (F, 3), metres.
        now_s: The instant, seconds.
        means_base_m: Forecast for `FORECAST_HORIZONS_S` from now, shape (3, 2), metres: x, y.
        covariances_m2: Its covariances, shape (3, 2, 2), square metres.
        radius: Half axes of the ellipse that should hold `SHARE` of the errors, in standard deviations.
        true_base_m: Where the head then was, shape (3, 2), metres; NaN where that is not known.
    """

    sensor: str
    walk: Recording
    truth: TrueHead
    capture_s: FloatArray
    observed_base_m: FloatArray
    now_s: float
    means_base_m: FloatArray
    covariances_m2: FloatArray
    radius: float
    true_base_m: FloatArray

    def error_rms_mm(self) -> tuple[float, float]:
        """RMS error of the seen heads along the line of sight, and on an axis across it, millimetres."""
        true_m = self.truth(self.capture_s)
        error_m = self.observed_base_m - true_m
        sight = true_m / np.linalg.norm(true_m, axis=1, keepdims=True)
        along_m = np.sum(error_m * sight, axis=1)
        across_m = error_m - along_m[:, None] * sight
        mean_m2 = np.mean(along_m**2), 0.5 * np.mean(np.sum(across_m**2, axis=1))
        return 1e3 * float(np.sqrt(mean_m2[0])), 1e3 * float(np.sqrt(mean_m2[1]))


def see(walk: Recording, sensor: SensorSpec, predictor: Predictor, now_s: float, seed: int) -> SeenWalk:
    """See a walk through a sensor, and forecast from what has arrived by an instant.

    Args:
        walk: The walk, in the base frame.
        sensor: The sensor.
        predictor: Forecasts; reset first.
        now_s: The instant, seconds.
        seed: Seed of the sensor's errors.

    Returns:
        What was seen and forecast.

    Raises:
        SettingsError: If no observation had arrived by the instant.
    """
    predictor.reset()
    truth = TrueHead(walk)
    sightings = in_order(walk, sensor, seed)
    arrived = [each.observation for each in sightings if each.arrival_s <= now_s]
    if not arrived:
        raise SettingsError(f"--at-s {now_s:g}: sensor {sensor.name!r} had no observation yet; use a later instant")
    for observation in arrived:
        predictor.update(observation)
    times_s = now_s + np.array(FORECAST_HORIZONS_S)
    forecast = predictor.forecast(times_s)
    return SeenWalk(
        sensor=sensor.name,
        walk=walk,
        truth=truth,
        capture_s=np.array([each.observation.capture_time_s for each in sightings]),
        observed_base_m=np.array([each.observation.head_position_base_m for each in sightings]),
        now_s=now_s,
        means_base_m=forecast.means_base_m[:, :2],
        covariances_m2=forecast.covariances_m2[:, :2, :2],
        radius=float(np.sqrt(squared_radius(forecast.degrees_of_freedom, SHARE, axes=2))),
        true_base_m=np.where(truth.known(times_s)[:, None], truth(times_s), np.nan)[:, :2],
    )


_TRUE, _FAINT = "0.25", "0.6"
_FORECAST, _SEEN = COLOURS[0], COLOURS[4]
# What the near view shows of the time before the instant, and room around that and the ellipses.
_PAST_S, _ROOM_M = 0.6, 0.12
_PANELS_A_ROW = 3
_DPI = 110


def draw_overview(all_seen: Sequence[SeenWalk], about: str, path: Path) -> None:
    """Draw the instant as each sensor saw it, on one scale.

    Args:
        all_seen: What each sensor saw of the same walk.
        about: Second line of the title.
        path: PNG file to write.
    """
    columns = min(len(all_seen), _PANELS_A_ROW)
    rows = -(-len(all_seen) // columns)
    figure = Figure(figsize=(3.9 * columns, 4.2 * rows + 1.1), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    window = _window(all_seen)
    for ax, seen in zip(axes, all_seen, strict=False):
        _draw(ax, seen, window)
        along_mm, across_mm = seen.error_rms_mm()
        ax.set_title(f"{seen.sensor}\nRMS {along_mm:.0f} mm along, {across_mm:.0f} mm across sight", fontsize="medium")
    for ax in axes[len(all_seen) :]:
        ax.set_axis_off()
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    walk, now_s = all_seen[0].walk, all_seen[0].now_s
    group = f" ({walk.labels.group})" if walk.labels.group else ""
    data = " walk" if walk.kind == "synthetic" else ""
    figure.suptitle(f"{walk.name}{group}, {walk.kind}{data}, at {now_s:.1f} s\n{about}", fontsize="medium")
    figure.savefig(path, dpi=_DPI)


def _window(all_seen: Sequence[SeenWalk]) -> tuple[FloatArray, float]:
    """Middle, metres, and half the side of the square that holds path and ellipses around the instant."""
    points = []
    for seen in all_seen:
        points.append(seen.truth(seen.now_s + np.linspace(-_PAST_S, max(FORECAST_HORIZONS_S), 20))[:, :2])
        reach = seen.radius * np.sqrt(np.einsum("hii->hi", seen.covariances_m2))
        points += [seen.means_base_m - reach, seen.means_base_m + reach]
    low, high = np.concatenate(points).min(axis=0), np.concatenate(points).max(axis=0)
    return 0.5 * (low + high), 0.5 * float(np.max(high - low)) + _ROOM_M


def _draw(ax: Axes, seen: SeenWalk, window: tuple[FloatArray, float]) -> None:
    """Draw a walk from above; the page's axes are y and x."""
    walked = seen.truth(np.linspace(0.0, float(seen.walk.times_s[-1]), 400))
    observed, head = seen.observed_base_m, seen.truth([seen.now_s])[0]
    mean, true = seen.means_base_m, seen.true_base_m
    ax.plot(walked[:, 1], walked[:, 0], color=_TRUE, lw=1.5, zorder=4, label="true head")
    ax.plot(observed[:, 1], observed[:, 0], "o", color=_SEEN, ms=4, mew=0, zorder=3, label="what the sensor saw")
    ax.plot([0.0, head[1]], [0.0, head[0]], ":", color=_FAINT, lw=1.2, zorder=1, label="line of sight")
    ax.plot(head[1], head[0], "D", color=_TRUE, ms=7.8, mec="w", mew=0.5, ls="", zorder=6, label="true head now")
    circle = np.stack([np.cos(np.linspace(0.0, 2.0 * np.pi, 73)), np.sin(np.linspace(0.0, 2.0 * np.pi, 73))])
    for covariance, at in zip(seen.covariances_m2, mean, strict=True):
        values, vectors = np.linalg.eigh(covariance)
        x_m, y_m = at[:, None] + seen.radius * (vectors * np.sqrt(np.maximum(values, 0.0))) @ circle
        ax.fill(y_m, x_m, fc=(_FORECAST, 0.15), ec=(_FORECAST, 0.8), lw=1.0, zorder=2)
    ax.plot([mean[:, 1], true[:, 1]], [mean[:, 0], true[:, 0]], color=_TRUE, lw=0.8, zorder=5)
    then = "true head 0.25, 0.5 and 1 s later"
    ax.plot(true[:, 1], true[:, 0], "o", mfc="w", mec=_TRUE, mew=1.2, ms=9, ls="", zorder=5, label=then)
    label = f"its forecast, with the stated {100 * SHARE:.0f} %"
    ax.plot(mean[:, 1], mean[:, 0], "o", color=_FORECAST, ms=6, mew=0, ls="", zorder=6, label=label)
    (middle_x_m, middle_y_m), half_m = window
    ax.set(xlabel="to the robot's left, y (m)", ylabel="ahead of the robot, x (m)", aspect="equal")
    ax.set(xlim=(middle_y_m + half_m, middle_y_m - half_m), ylim=(middle_x_m - half_m, middle_x_m + half_m))
    ax.grid(color="0.9", lw=0.6)
    ax.set_axisbelow(True)


# A walk is known by then.
_FIRST_S = 1.0
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
    at_s: float | None = Field(
        default=None, description="Instant of the forecast, seconds from the first frame; without it in the middle"
    )
    seed: int = Field(default=0, ge=0, description="Seed of the sensors' errors")
    out: Path = Field(default=Path("out/sensors"), description="Folder to write to")


def sensor_example(settings: SensorExampleSettings) -> list[SeenWalk]:
    """See the walk through each sensor, and draw.

    Args:
        settings: Which walk, sensors and instant.

    Returns:
        What each sensor saw, in the order of the settings.

    Raises:
        GazempcError: On bad input.
    """
    recording = load(settings.replay)
    scene = SceneSettings()
    walk = place(recording, natural_placement(recording), scene.distance_m, scene.height_m)
    sensors = [by_name[str(word)] for word, by_name in each_sensor(settings.sensors).items()]
    now_s = _instant(settings.at_s, float(walk.times_s[-1]))
    person = Person(walk.labels.subject, TrueHead(walk))
    predictor = make_predictor(settings.predictor, settings, person, {})
    all_seen = [see(walk, sensor, predictor, now_s, settings.seed) for sensor in sensors]
    settings.out.mkdir(parents=True, exist_ok=True)
    about = f"predictor {name_of(PREDICTOR, predictor)}; seed {settings.seed}"
    draw_overview(all_seen, about, settings.out / OVERVIEW)
    return all_seen


def _run(settings: SensorExampleSettings, _: str) -> int:
    all_seen = sensor_example(settings)
    walk = all_seen[0].walk
    print(
        f"{walk.name} ({walk.kind}), forecast at {all_seen[0].now_s:.1f} s; RMS error of the seen heads on each axis:"
    )
    for seen in all_seen:
        along_mm, across_mm = seen.error_rms_mm()
        errors = f"{along_mm:5.0f} mm along, {across_mm:4.0f} mm across the line of sight"
        print(f"  {seen.sensor:16} {seen.capture_s.size:4d} frames, {errors}")
    print(f"Written to {settings.out}/: {OVERVIEW}")
    return 0


def _instant(chosen_s: float | None, end_s: float) -> float:
    latest_s = end_s - max(FORECAST_HORIZONS_S)
    now_s = 0.5 * (_FIRST_S + latest_s) if chosen_s is None else chosen_s
    if latest_s < _FIRST_S or not 0.0 <= now_s <= latest_s:
        raise SettingsError(
            f"--at-s {now_s:g}: the recording lasts {end_s:.2f} s and forecasts reach {max(FORECAST_HORIZONS_S):g} s "
            f"ahead; accepted: 0 to {max(latest_s, 0.0):.2f} s"
        )
    return now_s


main = Command("sensor_example", SensorExampleSettings, __doc__, _run).main

if __name__ == "__main__":
    sys.exit(main())
