"""Compare the fronts of two gazes in a sweep: `python -m experiments.fronts out/sweep/fronts`.

Each case of the sweep has swept what trades exactness against smoothness. At every point of the rival's front that the
other's front reaches (not smoother than its smoothest point), the two are compared at the same RMS acceleration:
the error as a ratio, the eye contact as a difference. The line of a table is the point where the case does worst.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from matplotlib.figure import Figure
from pydantic import BaseModel, ConfigDict, Field

from experiments.engine.command import run_command
from gazempc.errors import SettingsError

SMOOTHNESS = "rms_acceleration_rad_s2"
ERROR, CONTACT = "gaze_error_rms_deg", "eye_contact_2p6"
GROUPS = ("straight", "turn", "sharp", "all")
Row = dict[str, Any]
Points = list[tuple[float, float]]


class FrontsSettings(BaseModel):
    """Settings of `python -m experiments.fronts`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    sweep: Annotated[Path, tyro.conf.Positional] = Field(description="What `experiments.sweep` wrote to (a folder)")
    case: str = Field(default="mpc", description="Case that is to be on or better than the rival's front")
    rival: str = Field(default="lookahead", description="Case to compare with")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status: 0, 2 on bad input.
    """
    settings = tyro.cli(FrontsSettings, args=arguments, prog="python -m experiments.fronts", description=__doc__)
    return run_command("fronts", lambda: fronts(settings))


def fronts(settings: FrontsSettings) -> int:
    """Compare, print, and write ``fronts.json`` and ``fronts.png`` beside the sweep's tables.

    Args:
        settings: Which sweep and cases.

    Returns:
        0.

    Raises:
        SettingsError: If the folder holds no such sweep or cases.
    """
    table = _read(settings.sweep / "table.csv")
    cases = sorted({row["case"] for row in table})
    for name in (settings.case, settings.rival):
        if name not in cases:
            raise SettingsError(f"{settings.sweep / 'table.csv'}: no case {name!r}; there are {', '.join(cases)}")
    by = [name for name in ("neck", "predictor") if name in table[0]]
    margins = []
    for place in sorted({tuple(row[name] for name in by) for row in table}):
        here = [row for row in table if tuple(row[name] for name in by) == place]
        for group in (g for g in GROUPS if any(row["group"] == g for row in here)):
            of = {
                case: [row for row in here if row["group"] == group and row["case"] == case]
                for case in (settings.case, settings.rival)
            }
            margins.append(dict(zip(by, place, strict=True)) | {"group": group} | _margins(*of.values()))
    (settings.sweep / "fronts.json").write_text(json.dumps(margins, indent=2) + "\n", encoding="utf-8")
    _draw(table, by, settings).savefig(settings.sweep / "fronts.png", dpi=110)
    print(f"{settings.case} against {settings.rival} at the same RMS acceleration, where {settings.case} does worst:")
    head = [*by, "group", "points", "RMS error", "eye contact 2.6 deg"]
    rows = [
        [
            *(str(m[name]) for name in (*by, "group", "points")),
            f"{100 * (m['error_ratio'] - 1):+.1f} %",
            f"{100 * m['contact_difference']:+.1f} points",
        ]
        for m in margins
    ]
    widths = [max(len(line[i]) for line in [head, *rows]) for i in range(len(head))]
    for line in [head, *rows]:
        print("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip())
    print(f"Written to {settings.sweep}/: fronts.json, fronts.png")
    return 0


def front(points: Points, sign: float) -> Points:
    """The points that no other beats in both smoothness and value, smoothest first.

    Args:
        points: Pairs of smoothness (less is better) and value.
        sign: 1 if less of the value is better, -1 if more is.

    Returns:
        The front.
    """
    best: Points = []
    for smoothness, value in sorted(points, key=lambda p: (p[0], sign * p[1])):
        if not best or sign * value < sign * best[-1][1]:
            best.append((smoothness, value))
    return best


def at(points: Points, smoothness: float) -> float:
    """Value of a front at a smoothness: between its points on the line between them, past its last point as there.

    Args:
        points: A front.
        smoothness: Where.

    Returns:
        The value; NaN where the front does not reach.
    """
    if smoothness < points[0][0]:
        return math.nan
    return float(np.interp(smoothness, [p[0] for p in points], [p[1] for p in points]))


def _margins(case: Sequence[Row], rival: Sequence[Row]) -> dict[str, Any]:
    def compared(metric: str, sign: float) -> list[tuple[float, float]]:
        ours, theirs = (front([(row[SMOOTHNESS], row[metric]) for row in rows], sign) for rows in (case, rival))
        pairs = [(at(ours, smoothness), value) for smoothness, value in theirs]
        return [pair for pair in pairs if not math.isnan(pair[0])]

    errors, contacts = compared(ERROR, 1.0), compared(CONTACT, -1.0)
    return {
        "points": len(errors),
        "error_ratio": max((ours / theirs for ours, theirs in errors), default=math.nan),
        "contact_difference": min((ours - theirs for ours, theirs in contacts), default=math.nan),
    }


def _read(path: Path) -> list[Row]:
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows: list[Row] = list(csv.DictReader(file))
    except FileNotFoundError:
        raise SettingsError(f"{path}: no such file; run python -m experiments.sweep first") from None
    needed = ("case", "group", SMOOTHNESS, ERROR, CONTACT)
    if not rows or (missing := [name for name in needed if name not in rows[0]]):
        what = f"lacks {', '.join(missing)}" if rows else "is empty"
        raise SettingsError(f"{path}: {what}; a sweep's metrics must include {', '.join(needed[2:])}")
    for number, row in enumerate(rows, start=2):
        for name in needed[2:]:
            try:
                row[name] = float(row[name])
            except ValueError:
                raise SettingsError(f"{path}, row {number}: {name} is not a number: {row[name]!r}") from None
    return rows


def _draw(table: Sequence[Row], by: Sequence[str], settings: FrontsSettings) -> Figure:
    places = sorted({tuple(row[name] for name in by) for row in table})
    groups = [g for g in GROUPS if g != "all" and any(row["group"] == g for row in table)] or ["all"]
    figure = Figure(figsize=(3.6 * len(groups), 2.7 * len(places)), layout="constrained")
    axes = figure.subplots(len(places), len(groups), squeeze=False)
    for i, place in enumerate(places):
        for j, group in enumerate(groups):
            ax = axes[i, j]
            for case, style in ((settings.rival, "s--"), (settings.case, "o-")):
                rows = [
                    row
                    for row in table
                    if (row["case"], row["group"]) == (case, group) and tuple(row[name] for name in by) == place
                ]
                points = sorted((row[SMOOTHNESS], row[ERROR]) for row in rows)
                dots = ax.plot(*zip(*points, strict=True), style[0], ms=3, alpha=0.5)
                ends = front(points, 1.0)
                ax.plot(*zip(*ends, strict=True), style[1:], color=dots[0].get_color(), label=case)
            ax.set_title(", ".join((*place, group)), fontsize=9)
            ax.set_ylim(bottom=0.9 * min(p[1] for p in ends))
            ax.grid(alpha=0.3)
    axes[0, 0].legend()
    figure.supxlabel("RMS acceleration of the joints [rad/s²]")
    figure.supylabel("RMS gaze error [deg]")
    return figure


if __name__ == "__main__":
    raise SystemExit(main())
