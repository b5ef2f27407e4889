"""Figures of a comparison."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.aggregate import paired_differences
from experiments.clips import figure_name, groups_of, sensors_of
from gazempc.results.figures.style import SeriesLook, readable, series_look, style, styles

Row = dict[str, Any]


def draw_all(rows: Sequence[Row], runs: Sequence[Row], out: Path) -> list[Path]:
    """Draw all figures of a comparison, those of one sensor after the other.

    Args:
        rows: Means, as made by `experiments.aggregate.summarise`.
        runs: The runs behind them.
        out: Folder to write PNG files to.

    Returns:
        The files.
    """
    sensors = sensors_of(rows)
    drawn: list[Path] = []
    for sensor in sensors:
        of_sensor = [row for row in rows if row["sensor"] == sensor and row["kind"] == "all"]

        def path(figure: str, sensor: str = sensor) -> Path:
            drawn.append(out / figure_name(figure, sensor, sensors))
            return drawn[-1]

        _draw_sensor(of_sensor, [run for run in runs if run["sensor"] == sensor], path)
    return drawn


def _draw_sensor(rows: Sequence[Row], runs: Sequence[Row], path: Callable[[str], Path]) -> None:
    data_kinds = Counter({run["source"]: run["data_kind"] for run in runs}.values())
    data = ", ".join(f"{n} recordings, {kind}" for kind, n in sorted(data_kinds.items()))
    data += f"; sensor {rows[0]['sensor']}"
    _bars(rows, data, "gaze_error_rms_deg", "RMS gaze error (deg)", 1.0, path("gaze_error"))
    _bars(rows, data, "eye_contact_2p6", "eye contact within 2.6 deg (% of the time)", 100.0, path("eye_contact"))
    if any(row["gap_closed"] is not None for row in rows):
        _bars(rows, data, "gap_closed", "gap between reactive and perfect closed", 1.0, path("gap_closed"))
    _error_against_acceleration(rows, data, path("error_against_acceleration"))
    differences = paired_differences(runs, "gaze_error_rms_deg", "mpc", "lookahead")
    if by_group := [d for d in differences if d["kind"] == "all"]:
        _paired(runs, data, by_group, path("mpc_minus_lookahead"))


def _looks(series: Sequence[tuple[str, str, str]]) -> list[tuple[str, SeriesLook]]:
    """Colour of each by its controller, and what tells it from the others of that controller."""
    colours = styles(dict.fromkeys(controller for controller, _, _ in series))
    before: Counter[str] = Counter()
    looks = []
    for controller, _, _ in series:
        looks.append((colours[controller].colour, series_look(before[controller])))
        before[controller] += 1
    return looks


def _series(rows: Sequence[Row]) -> list[tuple[str, str, str]]:
    return list(dict.fromkeys((r["controller"], r["predictor"], r["neck"]) for r in rows))


def _name(series: tuple[str, str, str], all_series: Sequence[tuple[str, str, str]]) -> str:
    controller, predictor, neck = series
    parts = [style(controller).label]
    # Said only where it tells series apart.
    if controller != "perfect" and len({p for c, p, _ in all_series if c != "perfect"}) > 1:
        parts.append(predictor)
    if len({n for _, _, n in all_series}) > 1:
        parts.append(neck)
    return ", ".join(parts)


def _bars(rows: Sequence[Row], data: str, figure: str, label: str, factor: float, path: Path) -> None:
    groups, series = groups_of(r for r in rows if r["group"] != "all"), _series(rows)
    width_inches = max(8.5, 3.0 + 0.35 * len(groups) * len(series))
    with readable(width_inches):
        plot = Figure(figsize=(width_inches, 4.2), layout="constrained")
        ax = plot.subplots()
        width = 0.8 / len(series)
        for i, (one, (colour, look)) in enumerate(zip(series, _looks(series), strict=True)):
            chosen = {r["group"]: r for r in rows if (r["controller"], r["predictor"], r["neck"]) == one}
            present = [g for g in groups if g in chosen and chosen[g][figure] is not None]
            x = np.array([groups.index(g) for g in present]) + (i - (len(series) - 1) / 2) * width
            means = np.array([factor * chosen[g][figure] for g in present])
            intervals = [chosen[g][f"{figure}_ci95"] for g in present]
            ax.bar(x, means, width * 0.92, color=colour, hatch=look.hatch, label=_name(one, series))
            for at, mean, interval in zip(x, means, intervals, strict=True):
                if interval is not None:  # one person alone has no spread over people
                    ends = np.maximum([[mean - factor * interval[0]], [factor * interval[1] - mean]], 0.0)
                    ax.errorbar([at], [mean], ends, fmt="none", color="black", capsize=2, linewidth=1)
        ax.set_xticks(range(len(groups)), [_group_label(rows, g) for g in groups])
        ax.set_ylabel(label)
        plot.legend(frameon=False, fontsize="small", loc="outside right upper")
        ax.set_title("means over clips, 95 % intervals over people", fontsize="medium")
        plot.supxlabel(data, fontsize="small", color="0.4")
        plot.savefig(path, dpi=150)


def _group_label(rows: Sequence[Row], group: str) -> str:
    row = next(r for r in rows if r["group"] == group)
    return f"{group}\n{row['n_clips']} clips, {row['n_people']} people"


def _error_against_acceleration(rows: Sequence[Row], data: str, path: Path) -> None:
    groups, series = groups_of(r for r in rows if r["group"] != "all"), _series(rows)
    width_inches = 3.2 * len(groups) + 1.0
    with readable(width_inches):
        plot = Figure(figsize=(width_inches, 3.6), layout="constrained")
        axes = np.atleast_1d(plot.subplots(1, len(groups), sharey=True))
        for ax, group in zip(axes, groups, strict=True):
            for one, (colour, look) in zip(series, _looks(series), strict=True):
                for r in rows:
                    if r["group"] == group and (r["controller"], r["predictor"], r["neck"]) == one:
                        x, y = r["rms_acceleration_rad_s2"], r["gaze_error_rms_deg"]
                        ax.plot(x, y, look.marker, color=colour, label=_name(one, series))
            ax.set_title(group)
            ax.set_xlabel("RMS acceleration (rad/s²)")
            ax.set_xlim(left=0)
            ax.set_ylim(bottom=0)
            ax.grid(alpha=0.3)
        axes[0].set_ylabel("RMS gaze error (deg)")
        axes[-1].legend(frameon=False, fontsize="small")
        plot.supxlabel(data, fontsize="small", color="0.4")
        plot.savefig(path, dpi=150)


def _paired(runs: Sequence[Row], data: str, differences: Sequence[Row], path: Path) -> None:
    combinations = list(dict.fromkeys((d["predictor"], d["neck"]) for d in differences))
    with readable(7.0):
        plot = Figure(figsize=(7.0, 3.2 * len(combinations)), layout="constrained")
        axes = np.atleast_1d(plot.subplots(len(combinations), 1))
        rng = np.random.default_rng(0)
        for ax, (predictor, neck) in zip(axes, combinations, strict=True):
            chosen = [d for d in differences if (d["predictor"], d["neck"]) == (predictor, neck)]
            for x, d in enumerate(chosen):
                values = [
                    a["gaze_error_rms_deg"] - b["gaze_error_rms_deg"]
                    for a in runs
                    for b in runs
                    if a["controller"] == "mpc"
                    and b["controller"] == "lookahead"
                    and all(a[k] == b[k] for k in ("source", "predictor", "neck", "seed"))
                    and (a["predictor"], a["neck"]) == (predictor, neck)
                    and d["group"] in {"all", a["group"]}
                ]
                ax.plot(x + rng.uniform(-0.15, 0.15, len(values)), values, ".", color="0.6", markersize=4)
                ax.plot([x], [d["difference"]], "o", color=style("mpc").colour)
                if d["ci95"] is not None:
                    ends = np.maximum([[d["difference"] - d["ci95"][0]], [d["ci95"][1] - d["difference"]]], 0.0)
                    ax.errorbar([x], [d["difference"]], ends, fmt="none", color=style("mpc").colour, capsize=4)
            ax.axhline(0.0, color="black", linewidth=0.8)
            ax.set_xticks(range(len(chosen)), [f"{d['group']}\n{d['n_clips']} clips" for d in chosen])
            ax.set_ylabel("MPC minus look-ahead,\nRMS gaze error (deg)")
            ax.set_title(f"forecast by {predictor}, neck {neck}; below 0 the MPC is better", fontsize="medium")
        plot.supxlabel(data, fontsize="small", color="0.4")
        plot.savefig(path, dpi=150)
