"""Compare forecasts over many recordings: `python -m experiments.forecast --recordings synthetic`."""

from __future__ import annotations

import itertools
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from pydantic import Field

from experiments.engine.command import NOT_SAVED, WorkSettings, check, parse, run_command
from experiments.engine.engine import Engine
from experiments.engine.job import Row
from experiments.engine.own_parts import check_parts, name_parts, options_of
from experiments.engine.recordings import find_recordings, in_place
from experiments.engine.replays import sensors_by_name
from experiments.forecast.errors import RUN_IN_S, Cues
from experiments.forecast.glance import turn_head
from experiments.forecast.jobs import ForecastJob, View, clip_result
from experiments.forecast.placing import placed_for
from experiments.forecast.report import report
from experiments.forecast.summary import ClipResult, summarise
from gazempc.errors import GazempcError
from gazempc.loop.build import Person, make_predictor, walker_model
from gazempc.parts import PREDICTOR, name_of
from gazempc.recordings.load import load
from gazempc.recordings.truth import TrueHead
from gazempc.results.report import versions
from gazempc.settings import DEFAULT_PREDICTOR, PredictorChoice, PredictorSettings
from gazempc.sim.sensor import default_sensor
from predictors import Predictor


class ForecastSettings(PredictorSettings, WorkSettings):
    """Settings of `python -m experiments.forecast`."""

    recordings: tuple[str, ...] = Field(
        min_length=1, description="'synthetic' (14 x 6), folders, files or synthetic names"
    )
    predictors: tuple[PredictorChoice | Literal["default"], ...] = Field(
        default=("last_position", "constant_velocity", "head_pose", "pelvis_pursuit", "walker"),
        min_length=1,
        description="What to compare; module:Class for your own",
    )
    options: Annotated[dict[str, Any], tyro.conf.Suppress] = Field(
        default={}, description="Options of parts of your own: --options.KEY VALUE, for a parameter of the constructor"
    )
    sensor: str | None = Field(
        default=None, description="Shipped sensor or .toml file; without it what fits each recording"
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
        Exit status: 0, 2 on bad input, 130 if interrupted.
    """
    return run_command("forecast", lambda: _run(parse(ForecastSettings, "forecast", __doc__, arguments)))


def forecast(**settings: Any) -> list[ClipResult]:
    """Run every predictor over every recording.

    Args:
        **settings: Any of `ForecastSettings`, such as ``recordings=["synthetic"], predictors=["walker"]``.

    Returns:
        One result for each predictor, cues and recording; see `experiments.forecast.summary.summarise`.

    Raises:
        GazempcError: On bad input; if a recording cannot be read, then after the others are done.
    """
    return _forecast(check(ForecastSettings, "forecast", settings))


def _run(settings: ForecastSettings) -> int:
    results = _forecast(settings)
    rows = summarise(results)
    summary = {
        "rows": rows,
        "scored": f"frames from {RUN_IN_S} s after the first one whose horizon ends within the recording",
        "settings": settings.model_dump(mode="json", exclude={*NOT_SAVED}),
        "versions": versions(),
    }
    (settings.out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    kinds = ", ".join(dict.fromkeys(r.kind for r in results))
    text = report(rows, kinds, settings.sensor)
    (settings.out / "summary.md").write_text(text, encoding="utf-8")
    _draw(settings, rows, kinds)
    print(text)
    print(f"Written to {settings.out}/: summary.json, summary.md and figures")
    return 0


def _forecast(settings: ForecastSettings) -> list[ClipResult]:
    if not all(0 < horizon_s < float("inf") for horizon_s in settings.horizons):
        raise GazempcError(f"horizons must be positive, got {list(settings.horizons)}")
    recordings = find_recordings(settings.recordings)
    view = View(sensors_by_name(settings.sensor), settings.sensor, settings.seed, settings.glance, settings.glance_from)
    predictors = dict.fromkeys(DEFAULT_PREDICTOR if p == "default" else p for p in settings.predictors)
    check_parts((), predictors, settings.options)
    if settings.walker.fitted is not None and "walker" in predictors:
        walker_model(settings.walker.fitted, "")  # before anything runs
    if settings.example is not None:
        load(settings.example)
    parts = PredictorSettings(**{name: getattr(settings, name) for name in PredictorSettings.model_fields})
    asked = list(itertools.product(recordings, predictors, dict.fromkeys(settings.cues)))
    jobs = [
        ForecastJob(
            in_place(name), predictor, cues, settings.horizons, view, parts, options_of("", predictor, settings.options)
        )
        for name, predictor, cues in asked
    ]
    with Engine(settings.out / "runs", settings.jobs, settings.dask) as engine:
        results = engine.run(jobs)
    if reasons := _reasons(asked, results):
        raise GazempcError("\n".join(reasons))
    rows: list[Row] = [
        {"predictor": predictor, "cues": cues, **row} for (_, predictor, cues), row in zip(asked, results, strict=True)
    ]
    name_parts(rows, "predictor")
    return [clip_result(row) for row in rows]


def _reasons(asked: Sequence[tuple[str, str, str]], results: Sequence[Row]) -> list[str]:
    """Why there are results missing, each reason once, with the predictor and the recordings."""
    where: dict[str, list[tuple[str, str]]] = {}
    for (name, predictor, _), row in zip(asked, results, strict=True):
        if reason := row["failed"] or row["left_out"]:
            where.setdefault(reason, []).append((predictor, Path(name).stem))
    return [
        f"{places[0][0]} on {places[0][1]}{f' and {len(places) - 1} more' if len(places) > 1 else ''}: {reason}"
        for reason, places in where.items()
    ]


def _draw(settings: ForecastSettings, rows: list[Row], kinds: str) -> None:
    from experiments.forecast.figures import draw, draw_coverage, draw_cues  # noqa: PLC0415  (slow to import)

    draw(rows, kinds, settings.out / "forecast_error.png")
    draw_coverage(rows, kinds, settings.out / "coverage.png")
    middle_s = sorted(settings.horizons)[len(settings.horizons) // 2]
    if len(set(settings.cues)) > 1:
        draw_cues(rows, kinds, settings.out / "cues.png", middle_s)
    if settings.example is not None:
        _draw_example(settings, settings.example, middle_s)


def _draw_example(settings: ForecastSettings, name: str, horizon_s: float) -> None:
    from experiments.forecast.example import draw_example  # noqa: PLC0415  (slow to import)

    walk = turn_head(load(name), settings.glance, settings.glance_from)
    sensor = sensors_by_name(settings.sensor or default_sensor(walk)).popitem()[1]
    recording = placed_for(walk, sensor)
    person = Person(recording.labels.subject, TrueHead(recording))
    shown: dict[str, Predictor] = {}
    for choice in dict.fromkeys(DEFAULT_PREDICTOR if p == "default" else p for p in settings.predictors):
        predictor = make_predictor(choice, settings, person, settings.options)
        shown[name_of(PREDICTOR, predictor)] = predictor
    draw_example(recording, shown, sensor, settings.seed, horizon_s, settings.out / "example.png")


if __name__ == "__main__":
    sys.exit(main())
