"""The text of a comparison of gazes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from experiments.clips import sensors_of
from experiments.engine.job import Row
from experiments.engine.replays import fault_lines
from gazempc.recordings.recording import truth_of
from gazempc.results.page.content import PageTable
from gazempc.results.run_summary import label

# What the two gazes are compared by, clip by clip: metric, what the report calls it, digits. All but the first are of
# gazes that start aside.
COMPARED = {
    "rms_deg": ("gaze_error_rms_deg", "RMS gaze error [deg]", 2),
    "stable_contact_s": ("time_to_stable_contact_s", "time to stable contact where both reach it [s]", 3),
    "overshoot_deg": ("overshoot_deg", "overshoot where both reach the person [deg]", 2),
}
# Begins the names of the differences in `summary.json`.
DIFFERENCES = "mpc_minus_lookahead_"


def about(summary: Row, done: Sequence[Row]) -> list[str]:
    """What a reader must know of the means, in sentences.

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
        f"{_count(len({r['source'] for r in done}), 'recording')} ({kinds or 'none'}) of "
        f"{_count(len({r['subject'] for r in done}), 'person', 'people')}; placement {placement}, seed "
        f"{summary['settings']['seed']}. Means over clips; in brackets 95 % bootstrap intervals over people (none where"
        " one person walks).",
        f"{summary['n_left_out']} recordings left out, {len(summary['failed'])} runs failed.",
        *(f"Of {kind} recordings the gaze error is against {truth_of(kind)}." for kind in counted if truth_of(kind)),
    ]


def report(summary: Row, done: list[Row]) -> str:
    """The summary as a Markdown text.

    Args:
        summary: What is in `summary.json`.
        done: Runs with metrics.

    Returns:
        The text.
    """
    n_seen = len(summary["people_seen_in_fitting"])
    seen = [
        "",
        f"The predictor walker was fitted on {_count(n_seen, 'person', 'people')} of those who walk here, which "
        "flatters it: for people left out see --walker.fitted.",
    ]
    seen = seen if n_seen else []
    lines = ["# Comparison of gazes", "", *about(summary, done), *seen]
    for sensor in sensors_of(summary["rows"]):
        of_sensor = {
            name: [row for row in rows if row["sensor"] == sensor]
            for name, rows in summary.items()
            if name == "rows" or name.startswith(DIFFERENCES)
        }
        lines += ["", f"## Sensor {sensor}", "", *gaze_table(of_sensor["rows"]).markdown()]
        for name, (_, what, digits) in COMPARED.items():
            if differences := of_sensor.get(DIFFERENCES + name):
                lines += ["", f"MPC minus look-ahead on the same clips, {what}; below 0 the MPC is better:", ""]
                lines += [_difference(d, digits) for d in differences]
    left_out = [f"- left out {name}: {reason}" for name, reason in summary["left_out"].items()]
    lines += ["", *left_out] if left_out else []
    reasons = dict.fromkeys((f["recording"], f["failed"]) for f in summary["failed"])
    lines += ["", *[f"- failed {name}: {reason}" for name, reason in reasons]] if reasons else []
    survived = fault_lines(summary["faults"])
    lines += ["", *[f"- survived {line}" for line in survived]] if survived else []
    violations = sum(r["limit_violations"] or 0 for r in done)
    lines += ["", f"Limit violations in all runs: {violations}.", ""]
    return "\n".join(lines)


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


def _difference(d: Row, digits: int) -> str:
    return (
        f"- {_clips(d)}, {d['predictor']}, neck {d['neck']}: {_interval(d, digits)} "
        f"({d['n_clips']} clips: less in {d['n_less']}, more in {d['n_more']})"
    )


def _clips(d: Row) -> str:
    return str(d["group"] if d["kind"] == "all" else d["kind"])


def _interval(d: Row, digits: int) -> str:
    interval = f" [{d['ci95'][0]:+.{digits}f}, {d['ci95'][1]:+.{digits}f}]" if d["ci95"] else ""
    return f"{d['difference']:+.{digits}f}{interval}"


def _count(n: int, one: str, many: str | None = None) -> str:
    return f"{n} {one if n == 1 else many or one + 's'}"
