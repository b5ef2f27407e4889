"""Compare forecasts over many recordings: `python -m experiments.forecast --recordings synthetic`."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from experiments.aggregate import file_name, sensors_of
from experiments.engine.command import ChoiceSettings, Command, each_sensor, exit_status, name_parts, options_of
from experiments.engine.engine import Engine
from experiments.engine.job import Row
from experiments.forecast.errors import RUN_IN_S, ClipView, Cues, ForecastJob
from experiments.forecast.page import forecast_page, plots_of, summarise
from experiments.pages import write_results
from experiments.plots import draw
from gazempc.errors import GazempcError
from gazempc.results.run_summary import versions
from gazempc.settings import PredictorChoice, PredictorSettings
from gazempc.sim.sensor import SensorSpec


class ForecastSettings(PredictorSettings, ChoiceSettings):
    """Settings of `python -m experiments.forecast`."""

    predictors: tuple[PredictorChoice | Literal["default"], ...] = Field(
        default=("last_position", "constant_velocity", "head_pose", "pelvis_pursuit", "walker"),
        min_length=1,
        description="Predictors to compare; module:Class for a user-defined one",
    )
    rates: tuple[float, ...] = Field(
        default=(), description="Reduce the sensors' frame rates to these (1/s); default: the sensors' own rates"
    )
    truth_smoothing: float = Field(
        default=0.0,
        ge=0,
        le=2,
        description="Window to smooth the truth (s), for tracks measured by a tracker; observations are not smoothed",
    )
    horizons: tuple[float, ...] = Field(default=(0.25, 0.5, 1.0), min_length=1, description="Seconds from capture")
    cues: tuple[Cues, ...] = Field(default=("both",), min_length=1, description="Orientations in the observations")
    seed: int = Field(default=0, ge=0, description="Seed of the sensor's noise")
    out: Path = Field(default=Path("out/forecast"), description="Output folder; an interrupted run resumes from it")
    figures: bool = Field(default=True, description="Draw figures")


def forecast(**settings: Any) -> list[Row]:
    """Evaluate every predictor on every recording.

    Args:
        **settings: Any of `ForecastSettings`, such as ``recordings=["synthetic"], predictors=["walker"]``.

    Returns:
        One row per recording, sensor, predictor and cues: labels, ``left_out`` and ``failed`` (a reason or None), and
        the arrays of `experiments.forecast.errors.ForecastErrors`.

    Raises:
        GazempcError: On invalid input, before any run.
    """
    return _forecast(ForecastSettings.of("forecast", settings))


def _run(settings: ForecastSettings, command: str) -> int:
    found = _forecast(settings)
    results = [row for row in found if not row["failed"] and not row["left_out"]]
    # One entry for all predictors: the reason is independent of them.
    left_out = {(row["recording"], row["sensor"]): _of(row, _LEFT_OUT) for row in found if row["left_out"]}
    rows = summarise(results)
    data_kinds = ", ".join(dict.fromkeys(row["data_kind"] for row in results))
    summary = {
        "rows": rows,
        "data_kinds": data_kinds,
        "n_left_out": len(left_out),
        "left_out": list(left_out.values()),
        "failed": [_of(row, _FAILED) for row in found if row["failed"]],
        "scored": f"frames from {RUN_IN_S} s after the first one whose horizon ends within the recording",
        "settings": settings.saved("figures"),
        "versions": versions(),
    }
    pictures = _draw(settings, rows, data_kinds) if settings.figures else []
    print(write_results(forecast_page(summary, results, pictures, command), settings.out, summary))
    drawn = " and figures" if pictures else ""
    print(f"Written to {settings.out}/: report.html, summary.json, summary.md{drawn}")
    return exit_status(False, bool(summary["failed"]))


# Columns of `summary.json` for failed forecasts, and for left-out recordings.
_FAILED = ("recording", "predictor", "cues", "sensor", "failed")
_LEFT_OUT = ("recording", "sensor", "left_out")


def _forecast(settings: ForecastSettings) -> list[Row]:
    for what, values in (("horizons", settings.horizons), ("rates", settings.rates)):
        if not all(0 < value < float("inf") for value in values):
            raise GazempcError(f"{what} must be positive, got {list(values)}")
    recordings = settings.recordings_in_place()
    views = _views(settings)
    predictors = settings.checked_predictors()
    parts = PredictorSettings(**{name: getattr(settings, name) for name in PredictorSettings.model_fields})
    combinations = list(itertools.product(recordings, views, predictors, dict.fromkeys(settings.cues)))
    jobs = []
    for name, view, predictor, cues in combinations:
        options = options_of("", predictor, settings.options)
        jobs.append(ForecastJob(recordings[name], predictor, cues, settings.horizons, view, parts, options))
    with Engine(settings.out / "runs", settings.jobs, settings.dask) as engine:
        results = engine.run(jobs)
    rows: list[Row] = [
        {"recording": name, "sensor": view.sensor_name, "predictor": predictor, "cues": cues, **row}
        for (name, view, predictor, cues), row in zip(combinations, results, strict=True)
    ]
    name_parts(rows, "predictor")
    return rows


def _of(row: Row, names: Sequence[str]) -> Row:
    return {name: row[name] for name in names}


def _views(settings: ForecastSettings) -> list[ClipView]:
    # Subsampling by a slower sensor: the noise of the remaining frames is unchanged.
    return [
        ClipView(
            {key: sensor if rate_hz is None else _slowed(sensor, rate_hz) for key, sensor in sensors.items()},
            *(name, settings.seed, settings.truth_smoothing),
        )
        for name, sensors in each_sensor(settings.sensors).items()
        for rate_hz in dict.fromkeys(settings.rates or (None,))
    ]


def _slowed(sensor: SensorSpec, rate_hz: float) -> SensorSpec:
    name = f"{sensor.name} at {rate_hz:g} Hz"
    return sensor.model_copy(update={"name": name, "rate_hz": min(sensor.rate_hz, rate_hz)})


def _draw(settings: ForecastSettings, rows: list[Row], data_kinds: str) -> list[Path]:
    sensors, drawn = sensors_of(rows), []
    for sensor in sensors:
        drawn.append(settings.out / file_name("forecast_error", *([sensor] if len(sensors) > 1 else [])))
        draw(plots_of(rows, sensor), drawn[-1], f"{data_kinds}; sensor {sensor}", log_y=True)
    return drawn


main = Command("forecast", ForecastSettings, __doc__, _run).main
