"""The report of a comparison of gazes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from experiments.clips import sensors_of
from experiments.compare_report import COMPARED, DIFFERENCES, about, difference_table, gaze_table
from experiments.engine.job import Row
from experiments.page_parts import failures, left_out, shares, survived
from gazempc.results.figures.style import styles
from gazempc.results.page.content import Chart, Page, PageTable, Unusual
from gazempc.results.run_summary import label


def compare_page(summary: Row, done: Sequence[Row], pictures: Iterable[Path], command: str) -> Page:
    """The report of a comparison.

    Args:
        summary: What is in `summary.json`.
        done: Runs with metrics.
        pictures: Figures.
        command: What repeats it.

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
        charts=tuple(_charts(done)),
        pictures={path: path.stem.replace("_", " ") for path in pictures},
        unusual=tuple(_unusual(summary, done)),
        command=command,
        settings=chosen,
    )


def _answers(rows: Sequence[Row]) -> Iterator[str]:
    overall = [row for row in rows if (row["group"], row["kind"]) == ("all", "all")]
    several = len({row["predictor"] for row in overall if row["controller"] != "perfect"}) > 1
    for sensor, neck in dict.fromkeys((row["sensor"], row["neck"]) for row in overall):
        said = []
        for row in overall:
            if (row["sensor"], row["neck"]) == (sensor, neck) and row["eye_contact_2p6"] is not None:
                forecast = f" ({row['predictor']})" if several and row["controller"] != "perfect" else ""
                said.append(f"{label(row['controller'])}{forecast} {100.0 * row['eye_contact_2p6']:.1f} %")
        yield f"Time with eye contact (2.6 deg), neck {neck}, sensor {sensor}: {', '.join(said)}."


def _tables(summary: Row) -> Iterator[PageTable]:
    for sensor in sensors_of(summary["rows"]):
        yield gaze_table([row for row in summary["rows"] if row["sensor"] == sensor], f"Sensor {sensor}")
        for name, (_, what, digits) in COMPARED.items():
            if of_sensor := [d for d in summary.get(DIFFERENCES + name, ()) if d["sensor"] == sensor]:
                yield difference_table(of_sensor, digits, f"Sensor {sensor}: MPC minus look-ahead, {what}")


def _charts(done: Sequence[Row]) -> Iterator[Chart]:
    several = len({run["predictor"] for run in done if run["controller"] != "perfect"}) > 1
    looks = styles(dict.fromkeys(run["controller"] for run in done))
    places = dict.fromkeys((run["sensor"], run["neck"]) for run in done)
    for sensor, neck in places:
        clips: dict[tuple[str, str], dict[str, float]] = {}
        for run in done:
            if (run["sensor"], run["neck"]) != (sensor, neck) or run["gaze_error_rms_deg"] is None:
                continue
            name = label(run["controller"])
            name += f", {run['predictor']}" if several and run["controller"] != "perfect" else ""
            clips.setdefault((name, looks[run["controller"]].colour), {})[run["recording"]] = run["gaze_error_rms_deg"]
        yield shares(f"Clips by gaze error: neck {neck}, sensor {sensor}", "RMS gaze error of a clip (deg)", clips)


def _unusual(summary: Row, done: Sequence[Row]) -> Iterator[Unusual]:
    if violations := sum(run["limit_violations"] or 0 for run in done):
        yield Unusual(f"{violations} violations of a neck's limits")
    if people := summary["people_seen_in_fitting"]:
        yield Unusual(
            f"the predictor walker was fitted on {len(people)} of those who walk here, which flatters it",
            "For people left out see --walker.fitted.",
        )
    yield from failures(summary["failed"])
    yield from survived(summary["faults"])
    yield from left_out(summary["left_out"])
    noted = dict.fromkeys((run["recording"], run["notes"]) for run in done if run["notes"])
    yield from (Unusual(f"note on {name}", note) for name, note in noted)
