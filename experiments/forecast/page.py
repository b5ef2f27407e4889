"""Averages, plots, tables and report of a comparison of forecasts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.aggregate import clips_of, grouped, groups_of, sensors_of, with_interval
from experiments.pages import seen_in_fitting, table_of, with_ends
from experiments.plots import Line, Plot, share_of_clips
from gazempc.recordings.readers.labels import STANDING
from gazempc.recordings.recording import truth_of
from gazempc.results.contact import of_known, p95
from gazempc.results.figures.style import COLOURS
from gazempc.results.metrics import inside
from gazempc.results.page.content import Chart, Page, PageTable, Unusual
from gazempc.results.run_summary import without_nan
from gazempc.types import FloatArray

_Row = Mapping[str, Any]
_BASELINES = ("constant_velocity", "last_position")
_PARTS = ("along", "across", "vertical")
_SHARES = (0.68, 0.90, 0.95)


def summarise(results: Sequence[_Row]) -> list[dict[str, Any]]:
    """Means by sensor, predictor, group or kind, and horizon.

    Means, coverage and NEES are means over clips of the mean over frames; percentiles are over all frames. The ratios
    to `constant_velocity` and `last_position` are over the clips of both.

    Args:
        results: Successful rows of `experiments.forecast.command.forecast`.

    Returns:
        One row per combination; None for NaN.
    """
    rows = []
    for sensor in sensors_of(results):
        seen = [r for r in results if r["sensor"] == sensor]
        baselines = {name: {r["recording"]: r for r in reversed(seen) if r["predictor"] == name} for name in _BASELINES}
        for (predictor, cues), own in grouped(seen, "predictor", "cues").items():
            for clips in clips_of(seen):
                named = {"sensor": sensor, "predictor": predictor, "cues": cues, **vars(clips)}
                chosen = [r for r in own if clips.hold(r)]
                for i, horizon_s in enumerate(chosen[0]["horizons_s"] if chosen else ()):
                    ratios = {f"ratio_to_{name}": _ratio(chosen, other, i) for name, other in baselines.items()}
                    rows.append({**named, "horizon_s": float(horizon_s), **_figures(chosen, i), **ratios})
    return rows


def _ratio(chosen: Sequence[_Row], baseline: Mapping[str, _Row], i: int) -> float | None:
    pairs = [(_error_m(r, i), _error_m(baseline[r["recording"]], i)) for r in chosen if r["recording"] in baseline]
    known = np.array([pair for pair in pairs if np.isfinite(pair).all()])
    if not known.size or not known[:, 1].any():
        return None
    own_m, baseline_m = known.mean(axis=0)
    return float(own_m / baseline_m)


def _error_m(result: _Row, i: int) -> float:
    """Mean distance from the true head at the i-th horizon, metres; NaN without scored frames."""
    return of_known(np.linalg.norm(result["difference_m"][:, i], axis=-1))


def _figures(chosen: Sequence[_Row], i: int) -> dict[str, Any]:
    people = [r["subject"] for r in chosen]
    differences = [1e3 * r["difference_m"][:, i] for r in chosen]
    distances = [np.linalg.norm(d, axis=-1) for d in differences]
    frames = np.concatenate(distances)

    def over_clips(values: Sequence[FloatArray]) -> float:
        return of_known(np.array([of_known(v) for v in values]))

    figures: dict[str, Any] = without_nan(
        {
            "error_true_p50_mm": of_known(frames, np.median),
            "error_true_p95_mm": of_known(frames, p95),
            "error_filtered_mm": over_clips([1e3 * r["error_filtered_m"][:, i] for r in chosen]),
            **{f"error_{name}_rms_mm": _rms(differences, k) for k, name in enumerate(_PARTS)},
            **{f"coverage_{round(100 * p)}": over_clips([_inside(r, i, p) for r in chosen]) for p in _SHARES},
            "nees": over_clips([r["nees"][:, i] for r in chosen]),
            "update_us": float(np.median(np.concatenate([r["update_us"] for r in chosen]))),
            "n_clips": sum(bool(np.isfinite(d).any()) for d in distances),
            "n_people": len(set(people)),
            "n_frames": int(np.isfinite(frames).sum()),
            "n_people_seen_in_fitting": len({r["subject"] for r in chosen if r["seen"]}),
        }
    )
    return with_interval("error_true_mm", [of_known(d) for d in distances], people) | figures


def _rms(differences: Sequence[FloatArray], part: int) -> float:
    return math.sqrt(of_known(np.concatenate([d[:, part] for d in differences]) ** 2))


def _inside(result: _Row, i: int, share: float) -> FloatArray:
    nees = result["nees"][:, i]
    return np.where(np.isfinite(nees), inside(nees, result["degrees_of_freedom"], share), np.nan)


def plots_of(rows: Sequence[_Row], sensor: str) -> list[Plot]:
    """Mean error against horizon, one plot per group; for the first of several cues.

    Args:
        rows: Result of `summarise`.
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
            lines.append(Line(predictor, COLOURS[k % len(COLOURS)], x, y, ends=np.reshape(ends, (-1, 2))))
        clips = max(r["n_clips"] for r in rows if r["group"] == group)
        title = f"{group} ({clips} clips)"
        plots.append(Plot(title, "horizon from capture (s)", "mean error (mm), logarithmic", tuple(lines)))
    return plots


def forecast_page(summary: _Row, results: Sequence[_Row], pictures: Iterable[Path], command: str) -> Page:
    """The report of a comparison.

    Args:
        summary: Content of `summary.json`.
        results: Rows that it summarises.
        pictures: Figures.
        command: Command line that reproduces it.

    Returns:
        The report.
    """
    rows, chosen = summary["rows"], summary["settings"]
    overall = [row for row in rows if (row["group"], row["kind"]) == ("all", "all")]
    return Page(
        title="Comparison of forecasts",
        question="How large is the error of the head's forecast?",
        answer=tuple(_answers(overall)),
        setup={
            "recordings": ", ".join(chosen["recordings"]),
            "sensors": ", ".join(sensors_of(rows)),
            "scored": summary["scored"],
            "seed": str(chosen["seed"]),
            "how": " ".join(about(summary)),
        },
        tables=tuple(
            forecast_table([row for row in rows if row["sensor"] == sensor], f"Sensor {sensor}")
            for sensor in sensors_of(rows)
        ),
        charts=(*_over_horizon(rows), *_by_clip(results)),
        pictures={path: path.stem.replace("_", " ") for path in pictures},
        unusual=tuple(_unusual(summary)),
        command=command,
        settings=chosen,
    )


def _answers(overall: Sequence[_Row]) -> Iterator[str]:
    for (sensor, cues, horizon_s), here in grouped(overall, "sensor", "cues", "horizon_s").items():
        known = sorted((r for r in here if r["error_true_mm"] is not None), key=lambda r: float(r["error_true_mm"]))
        errors = ", ".join(f"{r['predictor']} {r['error_true_mm']:.0f} mm" for r in known)
        yield f"Mean error {horizon_s:g} s ahead, sensor {sensor}, cues {cues}: {errors}."


def _over_horizon(rows: Sequence[_Row]) -> Iterator[Chart]:
    for sensor in sensors_of(rows):
        title = f"Error over horizon: sensor {sensor}"
        yield replace(plots_of(rows, sensor)[-1], title=title, y_label="mean error (mm)")


def _by_clip(results: Sequence[_Row]) -> Iterator[Chart]:
    looks = dict.fromkeys((r["predictor"], r["cues"]) for r in results)
    several = len({cues for _, cues in looks}) > 1
    named = {look: (", ".join(look) if several else look[0], COLOURS[k % len(COLOURS)]) for k, look in enumerate(looks)}
    for sensor in sensors_of(results):
        here = [r for r in results if r["sensor"] == sensor]
        horizons_s = here[0]["horizons_s"]
        middle = int(np.argsort(horizons_s)[len(horizons_s) // 2])
        clips: dict[tuple[str, str], dict[str, float]] = {}
        for r in here:
            if np.isfinite(error_mm := 1e3 * _error_m(r, middle)):
                clips.setdefault(named[r["predictor"], r["cues"]], {})[Path(r["recording"]).stem] = error_mm
        label = f"mean error {horizons_s[middle]:g} s ahead (mm)"
        yield share_of_clips(f"Clips by error: sensor {sensor}", label, clips)


def _unusual(summary: _Row) -> Iterator[Unusual]:
    yield from seen_in_fitting(max((row["n_people_seen_in_fitting"] for row in summary["rows"]), default=0))
    for row in summary["failed"]:
        yield Unusual(f"failed: {row['predictor']} on {Path(row['recording']).stem}", row["failed"])
    for row in summary["left_out"]:
        yield Unusual(f"left out {Path(row['recording']).stem}", row["left_out"])


def about(summary: _Row) -> list[str]:
    """Notes on the definition of the numbers.

    Args:
        summary: Content of `summary.json`.

    Returns:
        The sentences.
    """
    smoothing_s = summary["settings"]["truth_smoothing"]
    smoothed = f", smoothed by a centred moving average over {smoothing_s:g} s," if smoothing_s else ""
    return [
        f"{summary['data_kinds'] or 'No recordings'}. Distance from the true head{smoothed}: mean over clips with "
        "its 95 % bootstrap interval over people, and percentiles over frames. To filtered: distance from the "
        "position of a constant-velocity filter at that time. Along and across the direction of travel and "
        "vertical: RMS. Within 68, 90 and 95 %: share of frames inside the stated ellipsoid, which is from a "
        "multivariate t distribution where the forecast states its degrees of freedom, else of a normal one. NEES: 3 "
        "if the covariance is consistent. Ratio: error relative to constant_velocity, and for standing people also to "
        "last_position, on the same clips. Cues: orientations in the observations.",
        *(
            f"The true head of {kind} recordings is {truth_of(kind)}."
            for kind in summary["data_kinds"].split(", ")
            if truth_of(kind)
        ),
    ]


def forecast_table(rows: Sequence[_Row], title: str) -> PageTable:
    """The rows of one sensor.

    Args:
        rows: Result of `summarise`.
        title: Heading.

    Returns:
        The table.
    """
    # Most recordings have no kind.
    has_kinds = any(r["kind"] != "all" for r in rows)
    # For standing people the last position is the baseline.
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
        **{name: value(f"error_{name}_rms_mm") for name in _PARTS},
        **{f"within {share} %": value(f"coverage_{share}", ".2f") for share in (68, 90, 95)},
        "NEES": value("nees", ".1f"),
        "update [us]": value("update_us"),
    }
    return table_of(title, rows, columns)
