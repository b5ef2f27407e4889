"""Compare gazes over many recordings: `python -m experiments.compare --recordings synthetic --out out/compare`."""

from __future__ import annotations

if __name__ == "__main__":  # before the other imports, which are slow
    from gazempc.signals import end_during_imports

    end_during_imports("compare")

import itertools
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from pydantic import Field

from experiments import aggregate
from experiments.aggregate import COMPARED, DIFFERENCES, grouped, sensors_of
from experiments.engine.command import (
    ChoiceSettings,
    Command,
    each_sensor,
    exit_status,
    labels_of,
    name_parts,
    options_of,
)
from experiments.engine.engine import Engine
from experiments.engine.job import Row
from experiments.engine.replays import ReplayJob, all_faults
from experiments.pages import count, seen_in_fitting, table_of, unusual, with_ends, write_csv, write_results
from experiments.plots import Plot, draw, share_of_clips
from gazempc.loop.build import walker_model
from gazempc.neck.spec import load_neck
from gazempc.parts import gaze_of
from gazempc.recordings.recording import truth_of
from gazempc.results.figures.style import styles
from gazempc.results.page.content import Page, PageTable, Unusual
from gazempc.results.run_summary import label, versions
from gazempc.settings import GAZES, GazeChoice
from gazempc.sim.replay import ReplaySettings
from gazempc.sim.scene import PlaceSettings


class CompareSettings(ChoiceSettings, PlaceSettings):
    """Settings of `python -m experiments.compare`."""

    controllers: tuple[GazeChoice, ...] = Field(
        default=GAZES, min_length=1, description="Gazes to compare; module:Class for a user-defined one"
    )
    necks: tuple[str, ...] = Field(default=("reference",), min_length=1, description="Shipped necks or .toml files")
    out: Path = Field(default=Path("out/compare"), description="Output folder; an interrupted run resumes from it")
    figures: bool = Field(default=True, description="Draw figures")


def compare(**settings: Any) -> list[Row]:
    """Execute all runs and write tables and figures.

    Args:
        **settings: Any of `CompareSettings`, such as ``recordings=["synthetic"], controllers=["lookahead", "mpc"]``.

    Returns:
        One row per run: labels, ``left_out`` and ``failed`` (the reason, or None), all metrics, and ``faults``, the
        caught exceptions, if any.

    Raises:
        GazempcError: On invalid input, before any run.
    """
    checked = CompareSettings.of("compare", settings)
    rows = _replay_all(checked)
    words = ", ".join(f"{name}={value!r}" for name, value in settings.items())
    write(checked, rows, f"experiments.compare.compare({words})")
    return rows


def _run(settings: CompareSettings, command: str) -> int:
    rows = _replay_all(settings)
    text, written = write(settings, rows, command)
    print(text)
    print(f"Written to {settings.out}/: {', '.join(written)}")
    return exit_status(any(row.get("limit_violations") for row in rows), any(row["failed"] for row in rows))


def _replay_all(settings: CompareSettings) -> list[Row]:
    labels, jobs = zip(*runs_of(settings), strict=True)
    with Engine(settings.out / "runs", settings.jobs, settings.dask) as engine:
        results = engine.run(jobs)
    rows = [named | result for named, result in zip(labels, results, strict=True)]
    for part in ("controller", "predictor"):
        name_parts(rows, part)
    aggregate.add_gap_closed(rows)
    return rows


def runs_of(settings: CompareSettings) -> list[tuple[Row, ReplayJob]]:
    """Every combination on every recording, after validation of the settings.

    Args:
        settings: Settings of the comparison.

    Returns:
        Labels and job of each run; the run with the true future, which has no predictor, once for each neck and sensor.

    Raises:
        GazempcError: If a recording, neck, sensor or part does not exist.
    """
    recordings = settings.recordings_in_place()
    necks = {name: load_neck(name) for name in settings.necks}
    sensors = each_sensor(settings.sensors)
    predictors = settings.checked_predictors(*settings.controllers)
    place = {name: getattr(settings, name) for name in PlaceSettings.model_fields}
    names = dict(zip(recordings, labels_of(list(recordings)), strict=True))
    runs: dict[tuple[str | None, ...], tuple[Row, ReplayJob]] = {}
    for (recording, path), (sensor, by_name), (neck_name, neck), predictor, controller in itertools.product(
        recordings.items(), sensors.items(), necks.items(), predictors, settings.controllers
    ):
        shown = gaze_of(controller)[1] or predictor
        options = options_of(controller, shown, settings.options)
        chosen = ReplaySettings(predictor=shown, walker=settings.walker, options=options, sensor=sensor, **place)
        labels = {
            **{"recording": names[recording], "source": recording},
            **dict.fromkeys(("data_kind", "subject", "group", "kind")),
            **{"controller": controller, "predictor": shown, "neck": neck_name},
            **{"sensor": None if sensor is None else by_name[sensor].name, "seed": settings.seed, "notes": None},
        }
        job = ReplayJob(path, controller, chosen, neck, neck, by_name)
        runs.setdefault((recording, sensor, neck_name, shown, controller), (labels, job))
    return list(runs.values())


def write(settings: CompareSettings, rows: list[Row], command: str) -> tuple[str, list[str]]:
    """Write ``results.csv``, ``summary.json``, ``summary.md``, ``report.html`` and figures.

    Args:
        settings: Settings of the comparison.
        rows: Result of `compare`.
        command: Command line that reproduces it.

    Returns:
        The text of ``summary.md``, and the names of the files.
    """
    done = [row for row in rows if not row["left_out"] and not row["failed"]]
    write_csv(settings.out / "results.csv", rows)
    summary = _summary(settings, rows, done)
    plots = dict(_plots(done))
    drawn = {settings.out / name: plot for name, plot in plots.items() if settings.figures}
    for path, plot in drawn.items():
        draw([plot], path, "")
    text = write_results(_page(summary, done, plots.values(), drawn, command), settings.out, summary)
    files = ["report.html", "results.csv", "summary.json", "summary.md"]
    return text, [*files, *(path.name for path in drawn)]


def _summary(settings: CompareSettings, rows: list[Row], done: list[Row]) -> dict[str, Any]:
    left_out = {row["recording"]: row["left_out"] for row in rows if row["left_out"]}
    named = ("recording", "controller", "predictor", "neck", "sensor", "failed")
    failed = [{name: row[name] for name in named} for row in rows if row["failed"]]
    compared = list(COMPARED.items())[: None if settings.start_offset_deg else 1]
    return {
        "rows": aggregate.summarise(done),
        **{
            f"{DIFFERENCES}{name}": aggregate.paired_differences(done, metric, "mpc", "lookahead")
            for name, (metric, _, _) in compared
        },
        "n_left_out": len(left_out),
        "left_out": left_out,
        "failed": failed,
        "faults": all_faults(rows),
        "people_seen_in_fitting": _seen_in_fitting(settings, done),
        "seed": settings.seed,
        "settings": settings.saved("figures"),
        "versions": versions(),
    }


def _seen_in_fitting(settings: CompareSettings, done: list[Row]) -> list[str]:
    people = sorted({str(row["subject"]) for row in done if row["predictor"] == "walker"})
    fitted = settings.walker.fitted
    return [p for p in people if p in walker_model(fitted, p).about.get("people", ())]


def _about(summary: Row, done: Sequence[Row]) -> list[str]:
    """Description of the averages, in sentences."""
    placement = summary["settings"]["placement"] or "by recording"
    counted = Counter({r["source"]: r["data_kind"] for r in done}.values())
    kinds = ", ".join(f"{n} {kind}" for kind, n in sorted(counted.items()))
    return [
        f"{count(len({r['source'] for r in done}), 'recording')} ({kinds or 'none'}) of "
        f"{count(len({r['subject'] for r in done}), 'person', 'people')}; placement {placement}, seed "
        f"{summary['settings']['seed']}. Means over clips; in brackets 95 % bootstrap intervals over people (none where"
        " one person walks).",
        f"{summary['n_left_out']} recordings left out, {len(summary['failed'])} runs failed. Limit violations in all "
        f"runs: {sum(run['limit_violations'] or 0 for run in done)}.",
        *(f"Of {kind} recordings the gaze error is against {truth_of(kind)}." for kind in counted if truth_of(kind)),
    ]


def _page(summary: Row, done: Sequence[Row], plots: Iterable[Plot], pictures: Iterable[Path], command: str) -> Page:
    """The report of a comparison."""
    rows, chosen = summary["rows"], summary["settings"]
    return Page(
        title="Comparison of gazes",
        question="Which gaze keeps eye contact with walking people, and by how much is it better?",
        answer=tuple(_answers(rows)),
        setup={
            "recordings": ", ".join(chosen["recordings"]),
            "gazes": ", ".join(map(label, chosen["controllers"])),
            "forecasts": ", ".join(chosen["predictors"]),
            "necks": ", ".join(chosen["necks"]),
            "sensors": ", ".join(sensors_of(rows)),
            "seed": str(summary["seed"]),
            "how": " ".join(_about(summary, done)),
        },
        tables=tuple(_tables(summary)),
        charts=tuple(plots),
        pictures={path: path.stem.replace("_", " ") for path in pictures},
        unusual=tuple(_unusual(summary, done)),
        command=command,
        settings=chosen,
    )


def _answers(rows: Sequence[Row]) -> Iterator[str]:
    overall = [row for row in rows if (row["group"], row["kind"]) == ("all", "all")]
    several = len({row["predictor"] for row in overall if row["predictor"] != "perfect"}) > 1
    for (sensor, neck), here in grouped(overall, "sensor", "neck").items():
        contacts = []
        for row in here:
            if row["eye_contact_2p6"] is not None:
                forecast = f" ({row['predictor']})" if several and row["predictor"] != "perfect" else ""
                contacts.append(f"{label(row['controller'])}{forecast} {100.0 * row['eye_contact_2p6']:.1f} %")
        yield f"Time with eye contact (2.6 deg), neck {neck}, sensor {sensor}: {', '.join(contacts)}."


def _tables(summary: Row) -> Iterator[PageTable]:
    for sensor in sensors_of(summary["rows"]):
        yield _gaze_table([row for row in summary["rows"] if row["sensor"] == sensor], f"Sensor {sensor}")
        for name, (_, what, digits) in COMPARED.items():
            if of_sensor := [d for d in summary.get(DIFFERENCES + name, ()) if d["sensor"] == sensor]:
                yield _difference_table(of_sensor, digits, f"Sensor {sensor}: MPC minus look-ahead, {what}")


def _plots(done: Sequence[Row]) -> Iterator[tuple[str, Plot]]:
    """Cumulative distribution of the gaze error over clips, one plot per sensor and neck."""
    several = len({run["predictor"] for run in done if run["predictor"] != "perfect"}) > 1
    looks = styles(dict.fromkeys(run["controller"] for run in done))
    places = grouped(done, "sensor", "neck")
    for (sensor, neck), here in places.items():
        clips: dict[tuple[str, str], dict[str, float]] = {}
        for run in here:
            if run["gaze_error_rms_deg"] is None:
                continue
            name = label(run["controller"])
            name += f", {run['predictor']}" if several and run["predictor"] != "perfect" else ""
            clips.setdefault((name, looks[run["controller"]].colour), {})[run["recording"]] = run["gaze_error_rms_deg"]
        title = f"Clips by gaze error: neck {neck}, sensor {sensor}"
        plot = share_of_clips(title, "RMS gaze error of a clip (deg)", clips)
        yield aggregate.file_name("gaze_error", *([sensor, Path(neck).stem] if len(places) > 1 else [])), plot


def _unusual(summary: Row, done: Sequence[Row]) -> Iterator[Unusual]:
    yield from seen_in_fitting(len(summary["people_seen_in_fitting"]))
    yield from unusual(summary, sum(run["limit_violations"] or 0 for run in done))
    noted = dict.fromkeys((run["recording"], run["notes"]) for run in done if run["notes"])
    yield from (Unusual(f"note on {name}", note) for name, note in noted)


def _gaze_table(rows: list[Row], title: str = "") -> PageTable:
    """Means of each gaze."""
    # Most recordings have no kind.
    has_kinds = any(r["kind"] != "all" for r in rows)
    # Without body and eyes, the accelerations of head and joints are equal.
    has_more = any(r["head_rms_acceleration_rad_s2"] != r["rms_acceleration_rad_s2"] for r in rows)

    def mean(name: str, form: str, factor: float = 1.0) -> Callable[[Row], str]:
        return lambda r: with_ends(r[name], r[f"{name}_ci95"], form, factor)

    columns: dict[str, Callable[[Row], str]] = {
        "group": lambda r: r["group"],
        **({"kind": lambda r: r["kind"]} if has_kinds else {}),
        "clips": lambda r: str(r["n_clips"]),
        "people": lambda r: str(r["n_people"]),
        "neck": lambda r: r["neck"],
        "gaze": lambda r: label(r["controller"]),
        "filter and forecast": lambda r: r["predictor"],
        "gaze error RMS [deg]": mean("gaze_error_rms_deg", ".2f"),
        "eye contact 2.6 deg [%]": mean("eye_contact_2p6", ".1f", 100.0),
        "gap closed": mean("gap_closed", ".3f"),
        "RMS acceleration [rad/s^2]": mean("rms_acceleration_rad_s2", ".2f"),
        **({"of the head [rad/s^2]": mean("head_rms_acceleration_rad_s2", ".2f")} if has_more else {}),
    }
    # Optional columns: for eyes, for people who start to walk, for people who stay.
    for heading, name, form in (
        ("eyes aside, 95 % below [deg]", "eye_eccentricity_p95_deg", ".1f"),
        ("start to contact [s]", "time_from_start_to_contact_s", ".2f"),
        ("false starts [1/min]", "false_starts_per_min", ".1f"),
    ):
        if any(r[name] is not None for r in rows):
            columns[heading] = mean(name, form)
    return table_of(title, rows, columns)


def _difference_table(differences: list[Row], digits: int, title: str) -> PageTable:
    """MPC minus look-ahead on the same clips; below 0 the MPC is better."""
    columns: dict[str, Callable[[Row], str]] = {
        "clips": lambda d: str(d["group"] if d["kind"] == "all" else d["kind"]),
        "filter and forecast": lambda d: d["predictor"],
        "neck": lambda d: d["neck"],
        "difference": lambda d: with_ends(d["difference"], d["ci95"], f"+.{digits}f"),
        "number of clips": lambda d: str(d["n_clips"]),
        "less in": lambda d: str(d["n_less"]),
        "more in": lambda d: str(d["n_more"]),
    }
    return table_of(title, differences, columns, "On the same clips; below 0 the MPC is better.")


main = Command("compare", CompareSettings, __doc__, _run).main

if __name__ == "__main__":
    sys.exit(main())
