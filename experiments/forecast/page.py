"""The report of a comparison of forecasts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.clips import sensors_of
from experiments.forecast.report import about, forecast_table, rate_tables
from experiments.forecast.summary import ClipResult, error_m
from experiments.page_parts import shares
from gazempc.results.figures.style import COLOURS
from gazempc.results.page.content import Chart, Curve, Page, Unusual

_Row = Mapping[str, Any]


def forecast_page(summary: _Row, results: Sequence[ClipResult], pictures: Iterable[Path], command: str) -> Page:
    """The report of a comparison.

    Args:
        summary: What is in `summary.json`.
        results: What it was made from.
        pictures: Figures.
        command: What repeats it.

    Returns:
        The report.
    """
    rows, chosen = summary["rows"], summary["settings"]
    overall = [row for row in rows if (row["group"], row["kind"]) == ("all", "all")]
    return Page(
        title="Comparison of forecasts",
        question="How far from where the head will be is its forecast?",
        answer=tuple(_answers(overall)),
        setup={
            "recordings": ", ".join(chosen["recordings"]),
            "sensors": ", ".join(sensors_of(rows)),
            "scored": summary["scored"],
            "seed": str(chosen["seed"]),
            "numbers": " ".join(about(summary)),
        },
        tables=(
            *rate_tables(rows, chosen["rates"]),
            *(
                forecast_table([row for row in rows if row["sensor"] == sensor], f"Sensor {sensor}")
                for sensor in sensors_of(rows)
            ),
        ),
        charts=(*_over_horizon(overall), *_by_clip(results)),
        pictures={path: path.stem.replace("_", " ") for path in pictures},
        unusual=tuple(_unusual(summary)),
        command=command,
        settings=chosen,
    )


def _answers(overall: Sequence[_Row]) -> Iterator[str]:
    for sensor, cues, horizon_s in dict.fromkeys((r["sensor"], r["cues"], r["horizon_s"]) for r in overall):
        here = [r for r in overall if (r["sensor"], r["cues"], r["horizon_s"]) == (sensor, cues, horizon_s)]
        known = sorted((r for r in here if r["error_true_mm"] is not None), key=lambda r: float(r["error_true_mm"]))
        said = ", ".join(f"{r['predictor']} {r['error_true_mm']:.0f} mm" for r in known)
        yield f"Mean error {horizon_s:g} s ahead, sensor {sensor}, cues {cues}: {said}."


def _over_horizon(overall: Sequence[_Row]) -> Iterator[Chart]:
    for sensor in sensors_of(overall):
        curves = []
        looks = dict.fromkeys((r["predictor"], r["cues"]) for r in overall)
        for k, (predictor, cues) in enumerate(looks):
            own = [r for r in overall if (r["sensor"], r["predictor"], r["cues"]) == (sensor, predictor, cues)]
            own.sort(key=lambda r: float(r["horizon_s"]))
            x, y = (np.array([row[name] for row in own], float) for name in ("horizon_s", "error_true_mm"))
            curves.append(Curve(_name(predictor, cues, looks), COLOURS[k % len(COLOURS)], x, y))
        yield Chart(f"Error over horizon: sensor {sensor}", "horizon (s)", "mean error (mm)", tuple(curves))


def _by_clip(results: Sequence[ClipResult]) -> Iterator[Chart]:
    looks = dict.fromkeys((r.predictor, r.cues) for r in results)
    colours = {look: COLOURS[k % len(COLOURS)] for k, look in enumerate(looks)}
    for sensor in dict.fromkeys(r.sensor for r in results):
        horizons_s = next(r.errors.horizons_s for r in results if r.sensor == sensor)
        middle = int(np.argsort(horizons_s)[len(horizons_s) // 2])
        clips: dict[tuple[str, str], dict[str, float]] = {}
        for r in (r for r in results if r.sensor == sensor):
            if np.isfinite(error_mm := 1e3 * error_m(r, middle)):
                look = _name(r.predictor, r.cues, looks), colours[r.predictor, r.cues]
                clips.setdefault(look, {})[Path(r.recording).stem] = error_mm
        yield shares(f"Clips by error: sensor {sensor}", f"mean error {horizons_s[middle]:g} s ahead (mm)", clips)


def _name(predictor: str, cues: str, looks: Iterable[tuple[str, str]]) -> str:
    return f"{predictor}, {cues}" if len({cues for _, cues in looks}) > 1 else predictor


def _unusual(summary: _Row) -> Iterator[Unusual]:
    if seen := max((row["n_people_seen_in_fitting"] for row in summary["rows"]), default=0):
        yield Unusual(
            f"walker was fitted on {seen} of those who walk here, which flatters it",
            "For errors on people left out see --walker.fitted.",
        )
    for row in summary["failed"]:
        yield Unusual(f"failed: {row['predictor']} on {Path(row['recording']).stem}", row["failed"])
    for row in summary["left_out"]:
        yield Unusual(f"left out {Path(row['recording']).stem}", row["left_out"])
