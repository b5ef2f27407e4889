"""Compare forecasts over many recordings: `python -m experiments.forecast --recordings synthetic`."""

from __future__ import annotations

import itertools
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from pydantic import Field

from experiments.clips import figure_name, sensors_of
from experiments.engine.command import (
    NOT_SAVED,
    WorkSettings,
    check,
    command_of,
    exit_status,
    parse,
    run_command,
)
from experiments.engine.engine import Engine
from experiments.engine.job import Row
from experiments.engine.own_parts import check_parts, name_parts, options_of
from experiments.engine.recordings import find_recordings, in_place
from experiments.engine.replays import each_sensor
from experiments.forecast.errors import RUN_IN_S, Cues
from experiments.forecast.jobs import ClipView, ForecastJob, clip_result
from experiments.forecast.page import forecast_page
from experiments.forecast.report import AT_RATE, FAILED, LEFT_OUT, report
from experiments.forecast.summary import ClipResult, summarise
from gazempc.errors import GazempcError
from gazempc.files.whole import write_whole
from gazempc.loop.build import Person, make_predictor, walker_model
from gazempc.parts import PREDICTOR, name_of
from gazempc.recordings.load import load
from gazempc.recordings.recording import Recording
from gazempc.results.page.write import write_page
from gazempc.results.run_summary import versions
from gazempc.settings import DEFAULT_PREDICTOR, PredictorChoice, PredictorSettings
from gazempc.sim.sensor import SensorSpec
from predictors import Predictor


class ForecastSettings(PredictorSettings, WorkSettings):
    """Settings of `python -m experiments.forecast`."""

    recordings: tuple[str, ...] = Field(
        min_length=1, description="'synthetic' (14 x 6), 'everyday' (14 x 5), folders, files or synthetic names"
    )
    predictors: tuple[PredictorChoice | Literal["default"], ...] = Field(
        default=("last_position", "constant_velocity", "head_pose", "pelvis_pursuit", "walker"),
        min_length=1,
        description="What to compare; module:Class for your own",
    )
    options: Annotated[dict[str, Any], tyro.conf.Suppress] = Field(
        default={}, description="Options of parts of your own: --options.KEY VALUE, for a parameter of the constructor"
    )
    sensors: tuple[str, ...] = Field(
        default=(), description="Shipped sensors or .toml files; without them what fits each recording"
    )
    rates: tuple[float, ...] = Field(
        default=(), description="Thin what the sensors see to these rates (1/s); without them, the sensors' own rates"
    )
    truth_smoothing: float = Field(
        default=0.0,
        ge=0,
        le=2,
        description="Smooth the truth over this time (s), for tracks that are a tracker's own; what is seen stays raw",
    )
    horizons: tuple[float, ...] = Field(default=(0.25, 0.5, 1.0), min_length=1, description="Seconds from capture")
    cues: tuple[Cues, ...] = Field(
        default=("both",), min_length=1, description="Which orientations the predictors are shown"
    )
    glance: float = Field(
        default=0.0,
        ge=-180,
        le=180,
        description="Turn the recorded head aside by this angle (deg), as of who looks at something off their way",
    )
    glance_from: float = Field(default=0.0, ge=0, description="When the glance begins, seconds into the recording")
    example: str | None = Field(default=None, description="Recording to draw from above, with the forecasts")
    seed: int = Field(default=0, ge=0, description="Seed of the sensor's noise")
    out: Path = Field(default=Path("out/forecast"), description="Where to write; an interrupted run goes on there")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status: 0, 4 if a forecast failed, 2 on bad input, 130 if interrupted.
    """
    return run_command(
        "forecast",
        lambda: _run(parse(ForecastSettings, "forecast", __doc__, arguments), command_of("forecast", arguments)),
    )


@dataclass(frozen=True)
class Forecasts:
    """What came of a comparison of forecasts.

    Attributes:
        results: One for each recording, sensor, predictor and cues; see `experiments.forecast.summary.summarise`.
        failed: What could not be done: ``recording``, ``predictor``, ``cues``, ``sensor``, and ``failed``, the reason.
        left_out: With which recordings the experiment cannot be made: ``recording``, ``sensor``, and ``left_out``.
    """

    results: list[ClipResult]
    failed: list[Row]
    left_out: list[Row]


def forecast(**settings: Any) -> Forecasts:
    """Run every predictor over every recording.

    Args:
        **settings: Any of `ForecastSettings`, such as ``recordings=["synthetic"], predictors=["walker"]``.

    Returns:
        The results, and what failed.

    Raises:
        GazempcError: On bad input, before anything runs.
    """
    return _forecast(check(ForecastSettings, "forecast", settings))


def _run(settings: ForecastSettings, command: str) -> int:
    found = _forecast(settings)
    rows = summarise(found.results)
    data_kinds = ", ".join(dict.fromkeys(r.data_kind for r in found.results))
    summary = {
        "rows": rows,
        "data_kinds": data_kinds,
        "n_left_out": len(found.left_out),
        "left_out": found.left_out,
        "failed": found.failed,
        "scored": f"frames from {RUN_IN_S} s after the first one whose horizon ends within the recording",
        "settings": settings.model_dump(mode="json", exclude={*NOT_SAVED}),
        "versions": versions(),
    }
    write_whole(settings.out / "summary.json", json.dumps(summary, indent=2) + "\n")
    text = report(summary)
    write_whole(settings.out / "summary.md", text)
    pictures = _draw(settings, rows, data_kinds)
    write_page(forecast_page(summary, found.results, pictures, command), settings.out)
    print(text)
    drawn = " and figures" if rows else ""
    print(f"Written to {settings.out}/: report.html, summary.json, summary.md{drawn}")
    return exit_status(False, bool(found.failed))


def _forecast(settings: ForecastSettings) -> Forecasts:
    for what, values in (("horizons", settings.horizons), ("rates", settings.rates)):
        if not all(0 < value < float("inf") for value in values):
            raise GazempcError(f"{what} must be positive, got {list(values)}")
    recordings = find_recordings(settings.recordings)
    views = _views(settings)
    predictors = dict.fromkeys(DEFAULT_PREDICTOR if p == "default" else p for p in settings.predictors)
    check_parts((), predictors, settings.options)
    if settings.walker.fitted is not None and "walker" in predictors:
        walker_model(settings.walker.fitted, "")  # before anything runs
    if settings.example is not None:
        load(settings.example)
    parts = PredictorSettings(**{name: getattr(settings, name) for name in PredictorSettings.model_fields})
    asked = list(itertools.product(recordings, views, predictors, dict.fromkeys(settings.cues)))
    jobs = [
        ForecastJob(
            in_place(name), predictor, cues, settings.horizons, view, parts, options_of("", predictor, settings.options)
        )
        for name, view, predictor, cues in asked
    ]
    with Engine(settings.out / "runs", settings.jobs, settings.dask) as engine:
        results = engine.run(jobs)
    rows: list[Row] = [
        {"recording": name, "sensor": view.sensor_name, "predictor": predictor, "cues": cues, **row}
        for (name, view, predictor, cues), row in zip(asked, results, strict=True)
    ]
    name_parts(rows, "predictor")
    # Of all predictors, as the place has nothing to do with them.
    left_out = {(row["recording"], row["sensor"]): _of(row, LEFT_OUT) for row in rows if row["left_out"]}
    return Forecasts(
        [clip_result(row) for row in rows if not row["failed"] and not row["left_out"]],
        [_of(row, FAILED) for row in rows if row["failed"]],
        list(left_out.values()),
    )


def _of(row: Row, names: Sequence[str]) -> Row:
    return {name: row[name] for name in names}


def _views(settings: ForecastSettings) -> list[ClipView]:
    # A slower sensor: a frame's noise does not depend on which frames are taken.
    return [
        ClipView(
            {key: sensor if rate_hz is None else _slowed(sensor, rate_hz) for key, sensor in sensors.items()},
            *(name, settings.seed, settings.truth_smoothing, settings.glance, settings.glance_from),
        )
        for name, sensors in each_sensor(settings.sensors).items()
        for rate_hz in dict.fromkeys(settings.rates or (None,))
    ]


def _slowed(sensor: SensorSpec, rate_hz: float) -> SensorSpec:
    name = sensor.name + AT_RATE.format(rate_hz)
    return sensor.model_copy(update={"name": name, "rate_hz": min(sensor.rate_hz, rate_hz)})


def _draw(settings: ForecastSettings, rows: list[Row], data_kinds: str) -> list[Path]:
    from experiments.forecast.figures import draw, draw_coverage, draw_cues  # noqa: PLC0415  (slow to import)

    middle_s = sorted(settings.horizons)[len(settings.horizons) // 2]
    sensors = sensors_of(rows)
    drawn: list[Path] = []

    def path(figure: str, sensor: str) -> Path:
        drawn.append(settings.out / figure_name(figure, sensor, sensors))
        return drawn[-1]

    for sensor in sensors:
        own = [row for row in rows if row["sensor"] == sensor]
        about = f"{data_kinds}; sensor {sensor}"
        draw(own, about, path("forecast_error", sensor))
        draw_coverage(own, about, path("coverage", sensor))
        if len(set(settings.cues)) > 1:
            draw_cues(own, about, path("cues", sensor), middle_s)
    if settings.example is not None:
        drawn += _draw_examples(settings, load(settings.example), middle_s)
    return drawn


def _draw_examples(settings: ForecastSettings, recording: Recording, horizon_s: float) -> list[Path]:
    from experiments.forecast.example import draw_example  # noqa: PLC0415  (slow to import)

    views = [view.of(recording) for view in _views(settings)]
    drawn: list[Path] = []
    for seen in views:
        person = Person(recording.labels.subject, seen.true_head)
        shown: dict[str, Predictor] = {}
        for choice in dict.fromkeys(DEFAULT_PREDICTOR if p == "default" else p for p in settings.predictors):
            predictor = make_predictor(choice, settings, person, settings.options)
            shown[name_of(PREDICTOR, predictor)] = predictor
        drawn.append(settings.out / figure_name("example", seen.sensor.name, [view.sensor.name for view in views]))
        draw_example(seen, shown, settings.seed, horizon_s, drawn[-1])
    return drawn


if __name__ == "__main__":
    sys.exit(main())
