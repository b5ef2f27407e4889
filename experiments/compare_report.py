"""The text of a comparison of gazes."""

from __future__ import annotations

from collections import Counter

from experiments.clips import sensors_of
from experiments.engine.job import Row
from experiments.engine.replays import fault_lines
from gazempc.recordings.recording import truth_of
from gazempc.results.report import label

# What the two gazes are compared by, clip by clip: metric, what the report calls it, digits. All but the first are of
# gazes that start aside.
COMPARED = {
    "rms_deg": ("gaze_error_rms_deg", "RMS gaze error [deg]", 2),
    "stable_contact_s": ("time_to_stable_contact_s", "time to stable contact where both reach it [s]", 3),
    "overshoot_deg": ("overshoot_deg", "overshoot where both reach the person [deg]", 2),
}
# Begins the names of the differences in `summary.json`.
_DIFFERENCES = "mpc_minus_lookahead_"


def report(summary: Row, done: list[Row]) -> str:
    """The summary as a Markdown text.

    Args:
        summary: What is in `summary.json`.
        done: Runs with metrics.

    Returns:
        The text.
    """
    chosen = summary["settings"]
    counted = Counter({r["source"]: r["data_kind"] for r in done}.values())
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
        f"{_count(len({r['subject'] for r in done}), 'person', 'people')}; placement "
        f"{chosen['placement'] or 'that fits each recording'}, seed {chosen['seed']}. Means over clips; in brackets "
        "95 % bootstrap intervals over people (none where one person walks).",
        f"{summary['n_left_out']} recordings left out, {len(summary['failed'])} runs failed.",
        *(f"Of {kind} recordings the gaze error is against {truth_of(kind)}." for kind in counted if truth_of(kind)),
        *seen,
    ]
    for sensor in sensors_of(summary["rows"]):
        of_sensor = {
            name: [row for row in rows if row["sensor"] == sensor]
            for name, rows in summary.items()
            if name == "rows" or name.startswith(_DIFFERENCES)
        }
        lines += ["", f"## Sensor {sensor}", "", *_table(of_sensor["rows"])]
        for name, (_, what, digits) in COMPARED.items():
            if differences := of_sensor.get(_DIFFERENCES + name):
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


def _table(rows: list[Row]) -> list[str]:
    # Most recordings do not say of what kind they are.
    has_kinds = any(r["kind"] != "all" for r in rows)
    # Without body and eyes, the head's acceleration is that of all joints.
    has_more = any(r["head_rms_acceleration_rad_s2"] != r["rms_acceleration_rad_s2"] for r in rows)
    has_eyes = any(r["eye_eccentricity_p95_deg"] is not None for r in rows)
    columns = [
        *("group", *(["kind"] if has_kinds else []), "clips", "people", "neck", "gaze", "filter and forecast"),
        *("gaze error RMS [deg]", "eye contact 2.6 deg [%]", "gap closed", "RMS acceleration [rad/s^2]"),
        *(["of the head [rad/s^2]"] if has_more else []),
        *(["eyes aside, 95 % below [deg]"] if has_eyes else []),
    ]
    lines = [f"| {' | '.join(columns)} |", "|" + "---|" * len(columns)]
    for r in rows:
        cells = [
            *(r["group"], *([r["kind"]] if has_kinds else []), str(r["n_clips"]), str(r["n_people"]), r["neck"]),
            *(label(r["controller"]), r["predictor"]),
            *(_cell(r, "gaze_error_rms_deg", 2), _cell(r, "eye_contact_2p6", 1, 100.0)),
            *(_cell(r, "gap_closed", 3), _cell(r, "rms_acceleration_rad_s2", 2)),
            *([_cell(r, "head_rms_acceleration_rad_s2", 2)] if has_more else []),
            *([_cell(r, "eye_eccentricity_p95_deg", 1)] if has_eyes else []),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _cell(row: Row, name: str, digits: int, factor: float = 1.0) -> str:
    if row[name] is None:
        return "-"
    text = f"{factor * row[name]:.{digits}f}"
    if interval := row[f"{name}_ci95"]:
        text += f" [{factor * interval[0]:.{digits}f}, {factor * interval[1]:.{digits}f}]"
    return text


def _difference(d: Row, digits: int) -> str:
    interval = f" [{d['ci95'][0]:+.{digits}f}, {d['ci95'][1]:+.{digits}f}]" if d["ci95"] else ""
    clips = d["group"] if d["kind"] == "all" else d["kind"]
    return (
        f"- {clips}, {d['predictor']}, neck {d['neck']}: {d['difference']:+.{digits}f}{interval} "
        f"({d['n_clips']} clips: less in {d['n_less']}, more in {d['n_more']})"
    )


def _count(n: int, one: str, many: str | None = None) -> str:
    return f"{n} {one if n == 1 else many or one + 's'}"
