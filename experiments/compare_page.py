"""Tables, plots and report of a comparison of gazes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from experiments.aggregate import COMPARED, DIFFERENCES, file_name, sensors_of
from experiments.engine.job import Row
from experiments.pages import count, failures, left_out, survived
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
    if violations := sum(run["limit_violations"] or 0 for run in done):
        yield Unusual(f"{violations} violations of a neck's limits")
    if people := summary["people_seen_in_fitting"]:
        yield Unusual(
            f"the predictor walker was fitted on {count(len(people), 'person', 'people')} of these recordings",
            "Its figures are optimistic; for people left out see --walker.fitted.",
        )
    yield from failures(summary["failed"])
    yield from survived(summary["faults"])
    yield from left_out(summary["left_out"])
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
    has_eyes = any(r["eye_eccentricity_p95_deg"] is not None for r in rows)
    # Of people who start, and of people who stay on the spot.
    has_starts, has_stays = (
        any(r[name] is not None for r in rows) for name in ("time_from_start_to_contact_s", "false_starts_per_min")
    )
    columns = [
        *("group", *(["kind"] if has_kinds else []), "clips", "people", "neck", "gaze", "filter and forecast"),
        *("gaze error RMS [deg]", "eye contact 2.6 deg [%]", "gap closed", "RMS acceleration [rad/s^2]"),
        *(["of the head [rad/s^2]"] if has_more else []),
        *(["eyes aside, 95 % below [deg]"] if has_eyes else []),
        *(["start to contact [s]"] if has_starts else []),
        *(["false starts [1/min]"] if has_stays else []),
    ]
    lines = []
    for r in rows:
        cells = [
            *(r["group"], *([r["kind"]] if has_kinds else []), str(r["n_clips"]), str(r["n_people"]), r["neck"]),
            *(label(r["controller"]), r["predictor"]),
            *(_cell(r, "gaze_error_rms_deg", 2), _cell(r, "eye_contact_2p6", 1, 100.0)),
            *(_cell(r, "gap_closed", 3), _cell(r, "rms_acceleration_rad_s2", 2)),
            *([_cell(r, "head_rms_acceleration_rad_s2", 2)] if has_more else []),
            *([_cell(r, "eye_eccentricity_p95_deg", 1)] if has_eyes else []),
            *([_cell(r, "time_from_start_to_contact_s", 2)] if has_starts else []),
            *([_cell(r, "false_starts_per_min", 1)] if has_stays else []),
        ]
        lines.append(tuple(cells))
    return PageTable(title, tuple(columns), tuple(lines))


def difference_table(differences: list[Row], digits: int, title: str) -> PageTable:
    """MPC minus look-ahead on the same clips; below 0 the MPC is better.

    Args:
        differences: Of one sensor, as of `experiments.aggregate.paired_differences`.
        digits: After the point.
        title: What stands above.

    Returns:
        The table.
    """
    columns = ("clips", "filter and forecast", "neck", "difference", "number of clips", "less in", "more in")
    rows = tuple(
        (
            _clips(d),
            d["predictor"],
            d["neck"],
            _interval(d, digits),
            *(str(d[n]) for n in ("n_clips", "n_less", "n_more")),
        )
        for d in differences
    )
    return PageTable(title, columns, rows, "On the same clips; below 0 the MPC is better.")


def _cell(row: Row, name: str, digits: int, factor: float = 1.0) -> str:
    if row[name] is None:
        return "-"
    text = f"{factor * row[name]:.{digits}f}"
    if interval := row[f"{name}_ci95"]:
        text += f" [{factor * interval[0]:.{digits}f}, {factor * interval[1]:.{digits}f}]"
    return text


def _clips(d: Row) -> str:
    return str(d["group"] if d["kind"] == "all" else d["kind"])


def _interval(d: Row, digits: int) -> str:
    interval = f" [{d['ci95'][0]:+.{digits}f}, {d['ci95'][1]:+.{digits}f}]" if d["ci95"] else ""
    return f"{d['difference']:+.{digits}f}{interval}"
