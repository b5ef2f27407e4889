"""The text of a comparison of forecasts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.clips import sensors_of
from gazempc.recordings.readers.labels import STANDING
from gazempc.recordings.recording import truth_of
from gazempc.results.page.content import PageTable

# What `summary.json` says of a forecast that failed.
FAILED = ("recording", "predictor", "cues", "sensor", "failed")
# And of a recording that was left out.
LEFT_OUT = ("recording", "sensor", "left_out")
# How the name of a sensor that is thinned ends.
AT_RATE = " at {:g} Hz"


def about(summary: Mapping[str, Any]) -> list[str]:
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


def report(summary: Mapping[str, Any]) -> str:
    """The rows as Markdown tables, one a sensor.

    Args:
        summary: What is in `summary.json`.

    Returns:
        The text.
    """
    rows = summary["rows"]
    lines = ["# Forecast errors", "", *about(summary)]
    if seen := max((r["n_people_seen_in_fitting"] for r in rows), default=0):
        lines += [
            "",
            f"walker was fitted on {_count(seen)} of those who walk here, which flatters it: for errors on people "
            "left out see --walker.fitted.",
        ]
    for sensor in sensors_of(rows):
        lines += [
            "",
            f"## Sensor {sensor}",
            "",
            *forecast_table([r for r in rows if r["sensor"] == sensor], "").markdown(),
        ]
    for table in rate_tables(rows, summary["settings"]["rates"]):
        lines += ["", f"## {table.title}", "", *table.markdown()]
    lines += ["", *_left_out(summary["left_out"])] if summary["left_out"] else []
    lines += ["", *_failures(summary["failed"])] if summary["failed"] else []
    return "\n".join([*lines, ""])


def forecast_table(rows: Sequence[Mapping[str, Any]], title: str) -> PageTable:
    """The rows of one sensor.

    Args:
        rows: As of `experiments.forecast.summary.summarise`.
        title: What stands above.

    Returns:
        The table.
    """

    def show(value: float | None, digits: int = 0) -> str:
        return "-" if value is None else f"{value:.{digits}f}"

    # Most recordings do not say of what kind they are.
    has_kinds = any(r["kind"] != "all" for r in rows)
    # A forecast of people who stand has to beat the position where they are.
    stand = any(r["group"] == STANDING for r in rows)
    columns = [
        *(
            "predictor",
            "cues",
            "group",
            *(["kind"] if has_kinds else []),
            "clips",
            "horizon [s]",
            "error [mm]",
            "ratio",
            *(["ratio to last_position"] if stand else []),
        ),
        *("p50", "p95", "to filtered [mm]", "along", "across", "vertical"),
        *("within 68 %", "within 90 %", "within 95 %", "NEES", "update [us]"),
    ]
    lines = []
    for r in rows:
        interval = r["error_true_mm_ci95"]
        cells = [
            *(r["predictor"], r["cues"], r["group"], *([r["kind"]] if has_kinds else [])),
            str(r["n_clips"]),
            f"{r['horizon_s']:g}",
            show(r["error_true_mm"]) + (f" [{interval[0]:.0f}, {interval[1]:.0f}]" if interval else ""),
            show(r["ratio_to_constant_velocity"], 2),
            *([show(r["ratio_to_last_position"] if r["group"] == STANDING else None, 2)] if stand else []),
            *(show(r[f"error_{name}_mm"]) for name in ("true_p50", "true_p95", "filtered")),
            *(show(r[f"error_{name}_rms_mm"]) for name in ("along", "across", "vertical")),
            *(show(r[f"coverage_{share}"], 2) for share in (68, 90, 95)),
            show(r["nees"], 1),
            show(r["update_us"]),
        ]
        lines.append(tuple(cells))
    return PageTable(title, tuple(columns), tuple(lines))


def rate_tables(rows: Sequence[Mapping[str, Any]], rates_hz: Sequence[float]) -> list[PageTable]:
    """Errors over the frame rate.

    Args:
        rows: As of `experiments.forecast.summary.summarise`; those of all clips are shown.
        rates_hz: The rates to which the sensors were thinned; none makes no table.

    Returns:
        A table for each sensor: a line for each predictor, cues and horizon, and a column for each rate with the error
        and its ratio to `constant_velocity` at that rate.
    """
    every = [r for r in rows if (r["group"], r["kind"]) == ("all", "all")]
    rates_hz = sorted(set(rates_hz))
    endings = [AT_RATE.format(rate_hz) for rate_hz in rates_hz]
    # Of each sensor and rate by what stands in a line.
    found: dict[str, dict[tuple[Any, ...], dict[str, str]]] = {}
    for r, ending in ((r, ending) for r in every for ending in endings if r["sensor"].endswith(ending)):
        error_mm, ratio = r["error_true_mm"], r["ratio_to_constant_velocity"]
        cell = "-" if error_mm is None else f"{error_mm:.0f}" + ("" if ratio is None else f" ({ratio:.2f})")
        line = r["predictor"], r["cues"], f"{r['horizon_s']:g}"
        found.setdefault(r["sensor"].removesuffix(ending), {}).setdefault(line, {})[ending] = cell
    columns = ("predictor", "cues", "horizon [s]", *(f"{rate_hz:g} Hz" for rate_hz in rates_hz))
    return [
        PageTable(
            f"By frame rate, sensor {sensor}: error [mm] (ratio to constant_velocity)",
            columns,
            tuple((*line, *(cells.get(ending, "-") for ending in endings)) for line, cells in lines.items()),
        )
        for sensor, lines in found.items()
    ]


def _left_out(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    # Where no sensor was named, the recording says which one would have seen it.
    sensors = [f", sensor {row['sensor']}" if row["sensor"] else "" for row in rows]
    return [
        f"- left out {Path(row['recording']).stem}{sensor}: {row['left_out']}"
        for row, sensor in zip(rows, sensors, strict=True)
    ]


def _failures(failed: Sequence[Mapping[str, Any]]) -> list[str]:
    """Each reason once, with the predictor and the recording where it came first."""
    where: dict[str, list[str]] = {}
    for row in failed:
        where.setdefault(row["failed"], []).append(f"{row['predictor']} on {Path(row['recording']).stem}")
    return [
        f"- failed {places[0]}{f' and {len(places) - 1} more' if len(places) > 1 else ''}: {reason}"
        for reason, places in where.items()
    ]


def _count(people: int) -> str:
    return "one person" if people == 1 else f"{people} people"
