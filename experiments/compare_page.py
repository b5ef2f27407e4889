"""Tables, plots and report of a comparison of gazes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from experiments.aggregate import COMPARED, DIFFERENCES, file_name, sensors_of
from experiments.engine.job import Row
from experiments.pages import count, seen_in_fitting, table_of, unusual, with_ends
from experiments.plots import Plot, share_of_clips
from gazempc.recordings.recording import truth_of
from gazempc.results.figures.style import styles
from gazempc.results.page.content import Page, PageTable, Unusual
from gazempc.results.run_summary import label


def about(summary: Row, done: Sequence[Row]) -> list[str]:
    """How the means were made, in sentences.

    Args:
        summary: What is in `summary.json`.
        done: Runs with metrics.

    Returns:
        The sentences.
    """
    placement = summary["settings"]["placement"] or "that fits each recording"
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


def compare_page(
    summary: Row, done: Sequence[Row], plots: Iterable[Plot], pictures: Iterable[Path], command: str
) -> Page:
    """The report of a comparison.

    Args:
        summary: What is in `summary.json`.
        done: Runs with metrics.
        plots: Its plots.
        pictures: Their files.
        command: The command that repeats it.

    Returns:
        The report.
    """
    rows, chosen = summary["rows"], summary["settings"]
    return Page(
        title="Comparison of gazes",
        question="Which gaze keeps eye contact with people who walk, and by how much is it better?",
        answer=tuple(_answers(rows)),
        setup={
            "recordings": ", ".join(chosen["recordings"]),
            "gazes": ", ".join(map(label, chosen["controllers"])),
            "forecasts": ", ".join(chosen["predictors"]),
            "necks": ", ".join(chosen["necks"]),
            "sensors": ", ".join(sensors_of(rows)),
            "seed": str(summary["seed"]),
            "how": " ".join(about(summary, done)),
        },
        tables=tuple(_tables(summary)),
        charts=tuple(plot.chart() for plot in plots),
        pictures={path: path.stem.replace("_", " ") for path in pictures},
        unusual=tuple(_unusual(summary, done)),
        command=command,
        settings=chosen,
    )


def _answers(rows: Sequence[Row]) -> Iterator[str]:
    overall = [row for row in rows if (row["group"], row["kind"]) == ("all", "all")]
    several = len({row["predictor"] for row in overall if row["predictor"] != "perfect"}) > 1
    for sensor, neck in dict.fromkeys((row["sensor"], row["neck"]) for row in overall):
        contacts = []
        for row in overall:
            if (row["sensor"], row["neck"]) == (sensor, neck) and row["eye_contact_2p6"] is not None:
                forecast = f" ({row['predictor']})" if several and row["predictor"] != "perfect" else ""
                contacts.append(f"{label(row['controller'])}{forecast} {100.0 * row['eye_contact_2p6']:.1f} %")
        yield f"Time with eye contact (2.6 deg), neck {neck}, sensor {sensor}: {', '.join(contacts)}."


def _tables(summary: Row) -> Iterator[PageTable]:
    for sensor in sensors_of(summary["rows"]):
        yield gaze_table([row for row in summary["rows"] if row["sensor"] == sensor], f"Sensor {sensor}")
        for name, (_, what, digits) in COMPARED.items():
            if of_sensor := [d for d in summary.get(DIFFERENCES + name, ()) if d["sensor"] == sensor]:
                yield difference_table(of_sensor, digits, f"Sensor {sensor}: MPC minus look-ahead, {what}")


def plots_of(done: Sequence[Row]) -> Iterator[tuple[str, Plot]]:
    """Shares of clips by gaze error, a plot for each sensor and neck.

    Args:
        done: Runs with metrics.

    Yields:
        Name of the file without its ending, and the plot.
    """
    several = len({run["predictor"] for run in done if run["predictor"] != "perfect"}) > 1
    looks = styles(dict.fromkeys(run["controller"] for run in done))
    places = dict.fromkeys((run["sensor"], run["neck"]) for run in done)
    for sensor, neck in places:
        clips: dict[tuple[str, str], dict[str, float]] = {}
        for run in done:
            if (run["sensor"], run["neck"]) != (sensor, neck) or run["gaze_error_rms_deg"] is None:
                continue
            name = label(run["controller"])
            name += f", {run['predictor']}" if several and run["predictor"] != "perfect" else ""
            clips.setdefault((name, looks[run["controller"]].colour), {})[run["recording"]] = run["gaze_error_rms_deg"]
        title = f"Clips by gaze error: neck {neck}, sensor {sensor}"
        plot = share_of_clips(title, "RMS gaze error of a clip (deg)", clips)
        yield file_name("gaze_error", *([sensor, Path(neck).stem] if len(places) > 1 else [])), plot


def _unusual(summary: Row, done: Sequence[Row]) -> Iterator[Unusual]:
    yield from seen_in_fitting(len(summary["people_seen_in_fitting"]))
    yield from unusual(summary, sum(run["limit_violations"] or 0 for run in done))
    noted = dict.fromkeys((run["recording"], run["notes"]) for run in done if run["notes"])
    yield from (Unusual(f"note on {name}", note) for name, note in noted)


def gaze_table(rows: list[Row], title: str = "") -> PageTable:
    """Means of each gaze.

    Args:
        rows: Of one sensor, as of `experiments.aggregate.summarise`.
        title: What stands above.

    Returns:
        The table.
    """
    # Most recordings do not say of what kind they are.
    has_kinds = any(r["kind"] != "all" for r in rows)
    # Without body and eyes, the head's acceleration is that of all joints.
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
    # Of eyes; of people who start, and of people who stay on the spot.
    for heading, name, form in (
        ("eyes aside, 95 % below [deg]", "eye_eccentricity_p95_deg", ".1f"),
        ("start to contact [s]", "time_from_start_to_contact_s", ".2f"),
        ("false starts [1/min]", "false_starts_per_min", ".1f"),
    ):
        if any(r[name] is not None for r in rows):
            columns[heading] = mean(name, form)
    return table_of(title, rows, columns)


def difference_table(differences: list[Row], digits: int, title: str) -> PageTable:
    """MPC minus look-ahead on the same clips; below 0 the MPC is better.

    Args:
        differences: Of one sensor, as of `experiments.aggregate.paired_differences`.
        digits: After the point.
        title: What stands above.

    Returns:
        The table.
    """
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
