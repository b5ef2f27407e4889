"""Compare the fronts of two gazes in a sweep: `python -m experiments.fronts out/sweep/fronts`.

Each case of the sweep has swept what trades exactness against smoothness. At every point of the rival's front that the
other's front reaches (not smoother than its smoothest point), the two are compared at the same RMS acceleration. The
error is compared as a ratio, the eye contact as a difference. A line of the table is the mean over these points with
its 95 % interval over people, and the point where the case does worst. With eyes it is the acceleration of the head.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from matplotlib.figure import Figure
from pydantic import BaseModel, ConfigDict, Field

from experiments.aggregate import GROUP_ORDER
from experiments.engine.command import Command
from experiments.front_gaps import CONTACT, ERROR, HEAD, SMOOTHNESS, front, gaps, gaze
from gazempc.errors import SettingsError
from gazempc.files.whole import write_whole
from gazempc.results.figures.style import readable

GROUPS = (*GROUP_ORDER, "all")
Row = dict[str, Any]


class FrontsSettings(BaseModel):
    """Settings of `python -m experiments.fronts`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    sweep: Annotated[Path, tyro.conf.Positional] = Field(description="What `experiments.sweep` wrote to (a folder)")
    case: str = Field(default="mpc", description="Case that is to be on or better than the rival's front")
    rival: str = Field(default="lookahead", description="Case to compare with")


def fronts(settings: FrontsSettings, _: str = "") -> int:
    """Compare, print, and write ``fronts.json`` and ``fronts.png`` beside the sweep's tables.

    Args:
        settings: Which sweep and cases.

    Returns:
        0.

    Raises:
        SettingsError: If the folder holds no such sweep or cases.
    """
    runs = _read(settings.sweep / "results.csv")
    cases = sorted({row["case"] for row in runs})
    for name in (settings.case, settings.rival):
        if name not in cases:
            raise SettingsError(f"{settings.sweep / 'results.csv'}: no case {name!r}; there are {', '.join(cases)}")
    by = [name for name in ("neck", "sensor", "predictor") if name in runs[0]]
    found, drawn = [], []
    for place in sorted({tuple(row[name] for name in by) for row in runs}):
        here = [row for row in runs if tuple(row[name] for name in by) == place]
        of = [[row for row in here if row["case"] == case] for case in (settings.case, settings.rival)]
        for group in (g for g in GROUPS if g == "all" or any(row["group"] == g for row in here)):
            names = _common([row for row in [*of[0], *of[1]] if group in {"all", row["group"]}])
            gazes = [gaze(rows, names) for rows in of]
            found.append(dict(zip(by, place, strict=True)) | {"group": group} | gaps(*gazes))
            means = [each.means(np.ones(len(names)))[:, :2].tolist() for each in gazes]
            drawn.append((", ".join((*place, group)), means))
    write_whole(settings.sweep / "fronts.json", json.dumps(found, indent=2) + "\n")
    _draw(drawn, settings).savefig(settings.sweep / "fronts.png", dpi=110)
    print(f"{settings.case} against {settings.rival} at the same RMS acceleration, mean over the front [95 %, people]:")
    head = [*by, "group", "points", "RMS error, %", "worst", "eye contact 2.6 deg, points", "worst"]
    rows = [
        [
            *(str(m[name]) for name in (*by, "group", "points")),
            _cell(m, "error_ratio", -1.0),
            _one(m["error_ratio_worst"], -1.0),
            _cell(m, "contact_difference", 0.0),
            _one(m["contact_difference_worst"], 0.0),
        ]
        for m in found
    ]
    widths = [max(len(line[i]) for line in [head, *rows]) for i in range(len(head))]
    for line in [head, *rows]:
        print("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip())
    print(f"Written to {settings.sweep}/: fronts.json, fronts.png")
    return 0


def _one(value: float | None, add: float) -> str:
    return "-" if value is None else f"{100.0 * (value + add):+.1f}"


def _cell(margin: Row, name: str, add: float) -> str:
    text = _one(margin[name], add)
    if margin[f"{name}_low"] is None:
        return text
    return f"{text} [{_one(margin[f'{name}_low'], add)}, {_one(margin[f'{name}_high'], add)}]"


def _common(runs: Sequence[Row]) -> list[str]:
    """Recordings that every point of every case has."""
    names: dict[tuple[str, str], set[str]] = {}
    for row in runs:
        names.setdefault((row["case"], row["point"]), set()).add(row["recording"])
    return sorted(set.intersection(*names.values()))


def _read(path: Path) -> list[Row]:
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows: list[Row] = list(csv.DictReader(file))
    except FileNotFoundError:
        raise SettingsError(f"{path}: no such file; run python -m experiments.sweep first") from None
    needed = ("case", "point", "recording", "subject", "group", SMOOTHNESS, ERROR, CONTACT)
    if not rows or (missing := [name for name in needed if name not in rows[0]]):
        what = f"lacks {', '.join(missing)}" if rows else "is empty"
        raise SettingsError(f"{path}: {what}; needed are {', '.join(needed)}")
    # A run that was left out or failed has no figures.
    done = []
    for number, row in enumerate(rows, start=2):
        # Eyes are meant to be quick: with them only the head is to be smooth.
        row[SMOOTHNESS] = row.get(HEAD) or row[SMOOTHNESS]
        if not all(row[name] for name in (SMOOTHNESS, ERROR, CONTACT)):
            continue
        for name in (SMOOTHNESS, ERROR, CONTACT):
            try:
                row[name] = float(row[name])
            except ValueError:
                raise SettingsError(f"{path}, row {number}: {name} is not a number: {row[name]!r}") from None
        done.append(row)
    return done


def _draw(drawn: Sequence[tuple[str, list[list[list[float]]]]], settings: FrontsSettings) -> Figure:
    columns = min(4, len(drawn))
    lines = -(-len(drawn) // columns)
    width_inches = 3.2 * columns
    with readable(width_inches):
        figure = Figure(figsize=(width_inches, 2.7 * lines), layout="constrained")
        axes = figure.subplots(lines, columns, squeeze=False)
        for ax, (title, means) in zip(axes.flat, drawn, strict=False):
            for name, style, points in zip((settings.case, settings.rival), ("o-", "s--"), means, strict=True):
                dots = ax.plot(*zip(*sorted(points), strict=True), style[0], ms=3, alpha=0.5)
                ends = front([(p[0], p[1]) for p in points], 1.0)
                ax.plot(*zip(*ends, strict=True), style[1:], color=dots[0].get_color(), label=name)
            ax.set_title(title, fontsize=9)
            ax.grid(alpha=0.3)
        axes[0, 0].legend()
        figure.supxlabel("RMS acceleration of the joints [rad/s²]")
        figure.supylabel("RMS gaze error [deg]")
        return figure


main = Command("fronts", FrontsSettings, __doc__, fronts).main

if __name__ == "__main__":
    raise SystemExit(main())
