"""Compare gazes over many recordings: `python -m experiments.compare --recordings synthetic --out out/compare`."""

from __future__ import annotations

import csv
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import tyro
from pydantic import BaseModel, ConfigDict, Field

from experiments.aggregate import add_gap_closed, paired_differences, summarise
from experiments.engine.command import run_command
from experiments.engine.jobs import Job, execute
from experiments.engine.pool import run_jobs
from experiments.engine.recordings import find_recordings
from gazempc.neck.spec import load_neck
from gazempc.results.report import LABELS, versions
from gazempc.settings import DEFAULT_PREDICTOR, ControllerName, PlacementName, PredictorName, WalkerSettings
from gazempc.sim.replay import walker_model
from gazempc.sim.sensor import load_sensor

# What the two gazes are compared by, clip by clip: figure, what the report calls it, digits. All but the first are of
# gazes that start aside.
_COMPARED = {
    "rms_deg": ("gaze_error_rms_deg", "RMS gaze error [deg]", 2),
    "stable_contact_s": ("time_to_stable_contact_s", "time to stable contact where both reach it [s]", 3),
    "overshoot_deg": ("overshoot_deg", "overshoot where both reach the person [deg]", 2),
}


class CompareSettings(BaseModel):
    """Settings of `python -m experiments.compare`."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    recordings: tuple[str, ...] = Field(
        min_length=1, description="'synthetic' (14 x 6), folders, files or synthetic names"
    )
    controllers: tuple[ControllerName, ...] = Field(
        default=("reactive", "lookahead", "mpc", "perfect"), min_length=1, description="What to compare"
    )
    predictors: tuple[PredictorName | Literal["default"], ...] = Field(
        default=("default",), min_length=1, description="Forecasts; default is the run command's"
    )
    necks: tuple[str, ...] = Field(default=("reference",), min_length=1, description="Shipped necks or .toml files")
    sensor: str | None = Field(
        default=None, description="Shipped sensor or .toml file; without it what fits each recording"
    )
    placement: PlacementName | None = Field(
        default=None, description="Where the robot stands; without it what fits each recording"
    )
    distance_m: float = Field(default=2.5, gt=0, description="Distance from the walk, for placement side")
    height_m: float = Field(default=1.2, description="Height above the floor, for placement side")
    seed: int = Field(default=0, ge=0, description="Seed of the sensor's noise")
    start_offset_deg: float = Field(
        default=0.0,
        ge=-360,
        le=360,
        description="Where the pan starts, beside the person; then contact is compared, too",
    )
    walker: WalkerSettings = WalkerSettings()
    jobs: int = Field(default=os.cpu_count() or 1, ge=1, description="Worker processes")
    out: Path = Field(default=Path("out/compare"), description="Where to write; an interrupted run goes on there")
    figures: bool = Field(default=True, description="Draw figures")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status: 0, 1 if runs failed or left the limits, 2 on bad input, 130 if interrupted.
    """
    settings = tyro.cli(CompareSettings, args=arguments, prog="python -m experiments.compare", description=__doc__)
    return run_command("compare", lambda: compare(settings))


def compare(settings: CompareSettings) -> int:
    """Do all runs and write tables and figures.

    Args:
        settings: What to compare.

    Returns:
        Exit status, see `main`.

    Raises:
        GazempcError: On bad input, before anything runs.
    """
    jobs = make_jobs(settings)
    started_s = time.monotonic()
    runs_folder = settings.out / "runs"
    before = {path.name for path in runs_folder.glob("*.json")}
    rows = run_jobs(jobs, runs_folder, settings.jobs, execute)
    wall_s = time.monotonic() - started_s
    simulated_s = sum(
        row.get("simulated_s", 0.0) for job, row in zip(jobs, rows, strict=True) if f"{job.key()}.json" not in before
    )

    add_gap_closed(rows)
    done = [row for row in rows if not row["left_out"] and not row["failed"]]
    _write_results(settings.out / "results.csv", rows)
    summary = _summary(settings, rows, done)
    (settings.out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    text = report(summary, done)
    (settings.out / "summary.md").write_text(text, encoding="utf-8")
    if settings.figures and done:
        from experiments.compare_figures import draw_all  # noqa: PLC0415

        draw_all(summary["rows"], done, settings.out)
    print(text)
    if simulated_s:
        rate = simulated_s / wall_s
        print(
            f"{simulated_s:.0f} simulated seconds in {wall_s:.0f} s: {rate:.1f} a second, "
            f"{rate / settings.jobs:.1f} a second and worker"
        )
    print(f"Written to {settings.out}/: results.csv, summary.json, summary.md and figures")
    bad = [row for row in rows if row["failed"] or row.get("limit_violations")]
    return 1 if bad else 0


def make_jobs(settings: CompareSettings) -> list[Job]:
    """Every combination on every recording, after checking all that can be checked before.

    Args:
        settings: What to compare.

    Returns:
        The jobs; the perfect forecast is run once for each neck, as it has no predictor.

    Raises:
        GazempcError: If a recording, neck or sensor does not exist.
    """
    recordings = find_recordings(settings.recordings)
    for neck in settings.necks:
        load_neck(neck)
    if settings.sensor is not None:
        load_sensor(settings.sensor)
    if settings.walker.fitted is not None:
        walker_model(settings.walker.fitted, "")  # before anything runs
    predictors = dict.fromkeys(DEFAULT_PREDICTOR if p == "default" else p for p in settings.predictors)
    jobs = [
        Job(
            recording=recording,
            controller=controller,
            predictor="perfect" if controller == "perfect" else predictor,
            neck=neck,
            sensor=settings.sensor,
            placement=settings.placement,
            distance_m=settings.distance_m,
            height_m=settings.height_m,
            seed=settings.seed,
            fitted=None if settings.walker.fitted is None else str(settings.walker.fitted),
            start_offset_deg=settings.start_offset_deg,
        )
        for recording in recordings
        for neck in settings.necks
        for predictor in predictors
        for controller in settings.controllers
    ]
    return list(dict.fromkeys(jobs))


def _write_results(path: Path, rows: list[dict[str, Any]]) -> None:
    columns = list(dict.fromkeys(name for row in rows for name in row))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)


def _summary(settings: CompareSettings, rows: list[dict[str, Any]], done: list[dict[str, Any]]) -> dict[str, Any]:
    left_out = {row["recording"]: row["left_out"] for row in rows if row["left_out"]}
    failed = [
        {k: row[k] for k in ("recording", "controller", "predictor", "neck", "failed")} for row in rows if row["failed"]
    ]
    compared = list(_COMPARED.items())[: None if settings.start_offset_deg else 1]
    return {
        "rows": summarise(done),
        **{
            f"mpc_minus_lookahead_{name}": paired_differences(done, figure, "mpc", "lookahead")
            for name, (figure, _, _) in compared
        },
        "n_left_out": len(left_out),
        "left_out": left_out,
        "failed": failed,
        "people_seen_in_fitting": _seen_in_fitting(settings, done),
        "seed": settings.seed,
        # Where and with how many workers it ran does not change the figures.
        "settings": settings.model_dump(mode="json", exclude={"jobs", "out", "figures"}),
        "versions": versions(),
    }


def _seen_in_fitting(settings: CompareSettings, done: list[dict[str, Any]]) -> list[str]:
    people = sorted({str(row["subject"]) for row in done if row["predictor"] == "walker"})
    fitted = settings.walker.fitted
    return [p for p in people if p in walker_model(fitted, p).about.get("people", ())]


def report(summary: dict[str, Any], done: list[dict[str, Any]]) -> str:
    """The summary as a Markdown text.

    Args:
        summary: What is in `summary.json`.
        done: Runs with figures.

    Returns:
        The text.
    """

    def cell(row: dict[str, Any], name: str, digits: int, factor: float = 1.0) -> str:
        if row[name] is None:
            return "-"
        text = f"{factor * row[name]:.{digits}f}"
        if interval := row[f"{name}_ci95"]:
            text += f" [{factor * interval[0]:.{digits}f}, {factor * interval[1]:.{digits}f}]"
        return text

    chosen = summary["settings"]
    counted = Counter({r["source"]: r["kind"] for r in done}.values())
    kinds = ", ".join(f"{n} {kind}" for kind, n in sorted(counted.items()))
    n_seen = len(summary["people_seen_in_fitting"])
    seen = [
        "",
        f"The predictor walker was fitted on {_count(n_seen, 'person', 'people')} of those who walk here, which "
        "flatters it: for people left out see --walker.fitted.",
    ]
    seen = seen if n_seen else []
    lines = [
        "# Comparison of gazes",
        "",
        f"{_count(len({r['source'] for r in done}), 'recording')} ({kinds or 'none'}) of "
        f"{_count(len({r['subject'] for r in done}), 'person', 'people')}; sensor "
        f"{chosen['sensor'] or 'that fits each recording'}, placement "
        f"{chosen['placement'] or 'that fits each recording'}, seed {chosen['seed']}. Means over clips; in brackets "
        "95 % bootstrap intervals over people (none where one person walks).",
        f"{summary['n_left_out']} recordings left out, {len(summary['failed'])} runs failed.",
        *seen,
        "",
        "| group | clips | people | neck | gaze | filter and forecast | gaze error RMS [deg] | eye contact 2.6 deg [%] "
        "| gap closed | RMS acceleration [rad/s^2] |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {r['group']} | {r['n_clips']} | {r['n_people']} | {r['neck']} | {LABELS[r['controller']]} "
        f"| {r['predictor']} | {cell(r, 'gaze_error_rms_deg', 2)} | {cell(r, 'eye_contact_2p6', 1, 100.0)} "
        f"| {cell(r, 'gap_closed', 3)} | {cell(r, 'rms_acceleration_rad_s2', 2)} |"
        for r in summary["rows"]
    ]
    for name, (_, what, digits) in _COMPARED.items():
        if not (differences := summary.get(f"mpc_minus_lookahead_{name}")):
            continue
        lines += ["", f"MPC minus look-ahead on the same clips, {what}; below 0 the MPC is better:", ""]
        for d in differences:
            interval = f" [{d['ci95'][0]:+.{digits}f}, {d['ci95'][1]:+.{digits}f}]" if d["ci95"] else ""
            lines.append(
                f"- {d['group']}, {d['predictor']}, neck {d['neck']}: {d['difference']:+.{digits}f}{interval} "
                f"({d['n_clips']} clips: less in {d['n_less']}, more in {d['n_more']})"
            )
    lines += [f"- left out {name}: {reason}" for name, reason in summary["left_out"].items()]
    reasons = dict.fromkeys((f["recording"], f["failed"]) for f in summary["failed"])
    lines += ["", *[f"- failed {name}: {reason}" for name, reason in reasons]] if reasons else []
    violations = sum(r["limit_violations"] or 0 for r in done)
    lines += ["", f"Limit violations in all runs: {violations}.", ""]
    return "\n".join(lines)


def _count(n: int, one: str, many: str | None = None) -> str:
    return f"{n} {one if n == 1 else many or one + 's'}"


if __name__ == "__main__":
    sys.exit(main())
