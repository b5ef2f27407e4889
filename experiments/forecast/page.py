"""Plots, tables and report of a comparison of forecasts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.aggregate import groups_of, sensors_of
from experiments.forecast.summary import ClipResult, error_m
from experiments.pages import count, table_of, with_ends
from experiments.plots import Line, Plot, share_of_clips
from gazempc.recordings.readers.labels import STANDING
from gazempc.recordings.recording import truth_of
from gazempc.results.figures.style import COLOURS
from gazempc.results.page.content import Chart, Page, PageTable, Unusual

_Row = Mapping[str, Any]


def plots_of(rows: Sequence[_Row], sensor: str) -> list[Plot]:
    """Mean error against horizon, a plot for each group; of several cues the first.

    Args:
        rows: As of `experiments.forecast.summary.summarise`.
        sensor: The sensor.
    """
    rows = [r for r in rows if r["sensor"] == sensor and r["cues"] == rows[0]["cues"] and r["kind"] == "all"]
    predictors = list(dict.fromkeys(r["predictor"] for r in rows))
    plots = []
    for group in groups_of(r for r in rows if r["group"] != "all"):
        lines = []
        for k, predictor in enumerate(predictors):
            own = [r for r in rows if (r["group"], r["predictor"]) == (group, predictor) and r["error_true_mm"]]
            own.sort(key=lambda r: float(r["horizon_s"]))
            x, y = (np.array([row[name] for row in own], float) for name in ("horizon_s", "error_true_mm"))
            ends = [row["error_true_mm_ci95"] or (np.nan, np.nan) for row in own]
            lines.append(Line(predictor, COLOURS[k % len(COLOURS)], x, y, np.reshape(ends, (-1, 2))))
        clips = max(r["n_clips"] for r in rows if r["group"] == group)
        title = f"{group} ({clips} clips)"
        plots.append(Plot(title, "horizon from capture (s)", "mean forecast error (mm), logarithmic", tuple(lines)))
    return plots


# What `summary.json` says of a forecast that failed.
FAILED = ("recording", "predictor", "cues", "sensor", "failed")
# And of a recording that was left out.
LEFT_OUT = ("recording", "sensor", "left_out")


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
            "how": " ".join(about(summary)),
        },
        tables=(
            *(
                forecast_table([row for row in rows if row["sensor"] == sensor], f"Sensor {sensor}")
                for sensor in sensors_of(rows)
            ),
        ),
        charts=(*_over_horizon(rows), *_by_clip(results)),
        pictures={path: path.stem.replace("_", " ") for path in pictures},
        unusual=tuple(_unusual(summary)),
        command=command,
        settings=chosen,
    )


def _answers(overall: Sequence[_Row]) -> Iterator[str]:
    for sensor, cues, horizon_s in dict.fromkeys((r["sensor"], r["cues"], r["horizon_s"]) for r in overall):
        here = [r for r in overall if (r["sensor"], r["cues"], r["horizon_s"]) == (sensor, cues, horizon_s)]
        known = sorted((r for r in here if r["error_true_mm"] is not None), key=lambda r: float(r["error_true_mm"]))
        errors = ", ".join(f"{r['predictor']} {r['error_true_mm']:.0f} mm" for r in known)
        yield f"Mean error {horizon_s:g} s ahead, sensor {sensor}, cues {cues}: {errors}."


def _over_horizon(rows: Sequence[_Row]) -> Iterator[Chart]:
    for sensor in sensors_of(rows):
        yield replace(
            plots_of(rows, sensor)[-1], title=f"Error over horizon: sensor {sensor}", y_label="mean error (mm)"
        ).chart()


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
        label = f"mean error {horizons_s[middle]:g} s ahead (mm)"
        yield share_of_clips(f"Clips by error: sensor {sensor}", label, clips).chart()


def _name(predictor: str, cues: str, looks: Iterable[tuple[str, str]]) -> str:
    return f"{predictor}, {cues}" if len({cues for _, cues in looks}) > 1 else predictor


def _unusual(summary: _Row) -> Iterator[Unusual]:
    if seen := max((row["n_people_seen_in_fitting"] for row in summary["rows"]), default=0):
        yield Unusual(
            f"the predictor walker was fitted on {count(seen, 'person', 'people')} of these recordings",
            "Its errors are optimistic; for people left out see --walker.fitted.",
        )
    for row in summary["failed"]:
        yield Unusual(f"failed: {row['predictor']} on {Path(row['recording']).stem}", row["failed"])
    for row in summary["left_out"]:
        yield Unusual(f"left out {Path(row['recording']).stem}", row["left_out"])


def about(summary: _Row) -> list[str]:
    """What a reader must know of the numbers.

    Args:
        summary: What is in `summary.json`.

    Returns:
        The sentences.
    """
    smoothing_s = summary["settings"]["truth_smoothing"]
    smoothed = f", smoothed by a centred moving average over {smoothing_s:g} s," if smoothing_s else ""
    return [
        f"{summary['data_kinds'] or 'No recordings'}. Distance from the true head{smoothed}: mean over clips with "
        "its 95 % bootstrap interval over people, and percentiles over frames. To filtered: distance from the "
        "position that a constant-velocity filter has at that time. Along and across the direction of travel and "
        "vertical: RMS. Within 68, 90 and 95 %: share of frames inside the stated ellipsoid, which is that of a "
        "multivariate t distribution where the forecast states its degrees of freedom, else of a normal one. NEES: 3 "
        "if the covariance is honest. Ratio: error over that of constant_velocity, and for people who stand also over "
        "that of last_position, on the same clips. Cues: which orientations the predictor is shown.",
        *(
            f"The true head of {kind} recordings is {truth_of(kind)}."
            for kind in summary["data_kinds"].split(", ")
            if truth_of(kind)
        ),
    ]


def forecast_table(rows: Sequence[_Row], title: str) -> PageTable:
    """The rows of one sensor.

    Args:
        rows: As of `experiments.forecast.summary.summarise`.
        title: What stands above.

    Returns:
        The table.
    """
    # Most recordings do not say of what kind they are.
    has_kinds = any(r["kind"] != "all" for r in rows)
    # A forecast of people who stand has to beat the position where they are.
    stand = any(r["group"] == STANDING for r in rows)

    def value(name: str, form: str = ".0f") -> Callable[[_Row], str]:
        return lambda r: with_ends(r[name], None, form)

    columns: dict[str, Callable[[_Row], str]] = {
        "predictor": lambda r: r["predictor"],
        "cues": lambda r: r["cues"],
        "group": lambda r: r["group"],
        **({"kind": lambda r: r["kind"]} if has_kinds else {}),
        "clips": lambda r: str(r["n_clips"]),
        "horizon [s]": lambda r: f"{r['horizon_s']:g}",
        "error [mm]": lambda r: with_ends(r["error_true_mm"], r["error_true_mm_ci95"], ".0f"),
        "ratio": value("ratio_to_constant_velocity", ".2f"),
    }
    if stand:
        last = value("ratio_to_last_position", ".2f")
        columns["ratio to last_position"] = lambda r: last(r) if r["group"] == STANDING else "-"
    columns |= {
        "p50": value("error_true_p50_mm"),
        "p95": value("error_true_p95_mm"),
        "to filtered [mm]": value("error_filtered_mm"),
        **{name: value(f"error_{name}_rms_mm") for name in ("along", "across", "vertical")},
        **{f"within {share} %": value(f"coverage_{share}", ".2f") for share in (68, 90, 95)},
        "NEES": value("nees", ".1f"),
        "update [us]": value("update_us"),
    }
    return table_of(title, rows, columns)
