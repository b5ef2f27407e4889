"""The text of a comparison of forecasts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def report(rows: Sequence[dict[str, Any]], kinds: str, sensor: str | None) -> str:
    """The rows as a Markdown table.

    Args:
        rows: As made by `summarise`.
        kinds: What kinds of recordings they are from.
        sensor: The sensor that was asked for.

    Returns:
        The text.
    """

    def show(value: float | None, digits: int = 0) -> str:
        return "-" if value is None else f"{value:.{digits}f}"

    lines = [
        "# Forecast errors",
        "",
        f"{kinds}; sensor {sensor or 'that fits each recording'}. Distance from the true head: mean over clips with "
        "its 95 % bootstrap interval over people, and percentiles over frames. To filtered: distance from the "
        "position that a constant-velocity filter has at that time. Along and across the direction of travel and "
        "vertical: RMS. Within 68 and 95 %: share of frames inside the stated ellipsoid. NEES: 3 if the covariance "
        "is honest. Ratio: error over that of constant_velocity. Cues: which orientations the predictor is shown.",
    ]
    if seen := max(r["n_people_seen_in_fitting"] for r in rows):
        lines += [
            "",
            f"walker was fitted on {_count(seen)} of those who walk here, which flatters it: for errors on people "
            "left out see --walker.fitted.",
        ]
    lines += [
        "",
        "| predictor | cues | group | clips | horizon [s] | error [mm] | ratio | p50 | p95 | to filtered [mm] | along "
        "| across | vertical | within 68 % | within 90 % | within 95 % | NEES | update [us] |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        interval = r["error_true_mm_ci95"]
        error = show(r["error_true_mm"]) + (f" [{interval[0]:.0f}, {interval[1]:.0f}]" if interval else "")
        lines.append(
            f"| {r['predictor']} | {r['cues']} | {r['group']} | {r['n_clips']} | {r['horizon_s']:g} | {error} "
            f"| {show(r['ratio_to_constant_velocity'], 2)} | {show(r['error_true_p50_mm'])} "
            f"| {show(r['error_true_p95_mm'])} | {show(r['error_filtered_mm'])} "
            f"| {show(r['error_along_rms_mm'])} | {show(r['error_across_rms_mm'])} "
            f"| {show(r['error_vertical_rms_mm'])} "
            f"| {show(r['coverage_68'], 2)} | {show(r['coverage_90'], 2)} | {show(r['coverage_95'], 2)} "
            f"| {show(r['nees'], 1)} "
            f"| {show(r['update_us'])} |"
        )
    return "\n".join([*lines, ""])


def _count(people: int) -> str:
    return "one person" if people == 1 else f"{people} people"
