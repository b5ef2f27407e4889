"""Jobs of a comparison of rivals; rows with each rival at its best constants, tables and plots."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from experiments.aggregate import grouped, with_interval
from experiments.engine.job import Row
from experiments.pages import with_ends
from experiments.plots import Plot, points
from experiments.rivals.jobs import FIGURES, NAMES, OURS, ModelError, RivalJob
from experiments.rivals.laws import RIVALS
from experiments.rivals.trials import ALONE, LOSS, POSTURES, STILL, TRIALS, WALKS, takes
from gazempc.neck.spec import NeckSpec
from gazempc.recordings.load import load
from gazempc.results.contact import CONTACT_DEG
from gazempc.results.figures.style import styles
from gazempc.results.page.content import PageTable
from gazempc.sim.sensor import SensorSpec

# Names of combined trials.
ALL_STILL, ALL_WALKS = "still", "walks"
_COMBINED = {ALL_STILL: STILL, ALL_WALKS: WALKS}
# Share of the time: smaller differences of eye contact are regarded as ties.
_LEVEL = 0.01
# This project's default controller, and the metric of its lead in eye contact over a rival, paired by clip.
OUR_DEFAULT, BEHIND = "mpc", "eye_contact_behind_mpc"
_LABELS = ("rival", "trial", "neck", "sensor")


def make_jobs(
    rivals: Iterable[str],
    recordings: Sequence[str],
    necks: Sequence[NeckSpec],
    sensors: Sequence[SensorSpec],
    seed: int,
    trials: Iterable[str] = TRIALS,
    standing: Sequence[str] = (),
) -> list[RivalJob]:
    """All jobs of a comparison.

    Args:
        rivals: Names of `experiments.rivals.jobs.NAMES`.
        recordings: Walks, by name or path.
        necks: The necks.
        sensors: The sensors, on the head.
        seed: Seed of all errors.
        trials: Names of `experiments.rivals.trials.TRIALS`.
        standing: Recordings of standing or sitting people, by name or path.

    Returns:
        The jobs.
    """
    walks, stays = ({name: load(name).labels for name in names} for names in (recordings, standing))
    people: list[tuple[str, str | None]] = []
    for trial in trials:
        if trial in ALONE:
            people.append((trial, None))
        else:
            found = stays if trial in POSTURES else walks
            people += [(trial, name) for name, labels in found.items() if takes(trial, labels)]
    return [
        RivalJob(rival, trial, recording, neck, sensor, seed, constants)
        for neck in necks
        for sensor in sensors
        for rival in rivals
        for constants in (RIVALS[rival].free if rival in RIVALS else ({},))
        for trial, recording in people
    ]


def labelled(jobs: Sequence[RivalJob], results: Sequence[Row]) -> list[Row]:
    """Results with the labels of their jobs."""
    return [
        {
            "rival": job.rival,
            "trial": job.trial,
            "neck": job.neck.name,
            "sensor": job.sensor.name,
            "recording": job.recording or job.trial,
            "constants": ", ".join(f"{name}={value:g}" for name, value in job.constants.items()),
            "error": job.error,
            **result,
        }
        for job, result in zip(jobs, results, strict=True)
    ]


def at_their_best(runs: Sequence[Row]) -> list[Row]:
    """Select the runs of each rival at the constants with the most eye contact on walks.

    Ties, within one percent of the time, are resolved by smoothness. Constants are selected for each neck and sensor on
    the evaluated walks (in-sample), in favour of the rivals.

    Args:
        runs: Runs with metrics.

    Returns:
        The selected runs.
    """
    walks = {run["trial"] for run in runs} & {*WALKS}
    evaluated = [run for run in runs if run["trial"] in walks or not walks]
    best = {place: _best(candidates) for place, candidates in grouped(evaluated, "rival", "neck", "sensor").items()}
    return [run for run in runs if run["constants"] == best.get((run["rival"], run["neck"], run["sensor"]))]


def _best(runs: Sequence[Row]) -> str:
    candidates = grouped(runs, "constants")
    contact, error_deg, acceleration = (
        {str(constants): sum(run[name] for run in own) / len(own) for (constants,), own in candidates.items()}
        for name in ("eye_contact_2p6", "gaze_error_rms_deg", "rms_acceleration_rad_s2")
    )
    most = max(contact.values())
    # Without contact, the smallest gaze error.
    if most < _LEVEL:
        return min(contact, key=error_deg.__getitem__)
    return min((each for each in contact if contact[each] > most - _LEVEL), key=acceleration.__getitem__)


def summarise(runs: Sequence[Row]) -> list[Row]:
    """Means over clips, with intervals over people.

    Args:
        runs: Runs with metrics, none left out or failed.

    Returns:
        One row per trial or combined trial, neck, sensor and rival: labels, ``constants``, ``n_clips``, ``n_people``,
        each of `FIGURES` and `BEHIND` (None if undefined) and its interval under ``<name>_ci95``.
        Sorted within a trial, neck and sensor, best first: by eye contact, after a loss by the time to contact, else by
        settling time, with laws that settle off the face last.
    """
    rows = []
    names = [*dict.fromkeys(run["trial"] for run in runs)]
    combined = [name for name, parts in _COMBINED.items() if {*names} & {*parts}]
    for trial in [*names, *combined]:
        of_trial = [run for run in runs if run["trial"] in _COMBINED.get(trial, (trial,))]
        for here in grouped(of_trial, "neck", "sensor").values():
            by_rival = grouped(here, "rival")
            default_contact = {_clip(run): run["eye_contact_2p6"] for run in by_rival.get((OUR_DEFAULT,), ())}
            part = [_row(trial, by_rival[name,], default_contact) for name in NAMES if (name,) in by_rival]
            rows += sorted(part, key=_rank)
    return rows


def _clip(run: Row) -> tuple[Any, ...]:
    return run["trial"], run["recording"]


def _row(trial: str, runs: Sequence[Row], our_contact: Mapping[tuple[Any, ...], float]) -> Row:
    first = runs[0]
    row: Row = {**{name: first[name] for name in _LABELS}, "trial": trial, "constants": first["constants"]}
    people = [run["subject"] for run in runs]
    row |= {"n_clips": len(runs), "n_people": len(set(people))}
    columns = {name: [run[name] for run in runs] for name in FIGURES}
    columns[BEHIND] = [our_contact.get(_clip(run), math.nan) - run["eye_contact_2p6"] for run in runs]
    for name, values in columns.items():
        row |= with_interval(name, values, people)
    return row


def _rank(row: Row) -> tuple[bool, float]:
    if row["trial"] == LOSS:
        return False, float(row["recontact_s"])
    if row["settling_s"] is not None:
        return bool(row["rest_error_deg"] > CONTACT_DEG[0]), float(row["settling_s"])
    return False, -float(row["eye_contact_2p6"])


# Controllers with a model of the neck, or of the camera's latency.
WITH_MODEL = ("smith", "smith_feedforward", *OURS)
WITHOUT_MODEL = tuple(name for name in NAMES if name not in WITH_MODEL)
DEAD_TIME, SERVO, LATENCY = "dead time", "servo", "latency"
LABELS = {
    DEAD_TIME: "modelled dead time, % off the true one",
    SERVO: "modelled servo frequency, % off the true one",
    LATENCY: "modelled minus true latency of the camera (ms)",
}
_ERRORS: dict[str, dict[float, ModelError]] = {
    DEAD_TIME: {by: ModelError(dead_time_scale=1.0 + by / 100.0) for by in (-30.0, -15.0, 0.0, 15.0, 30.0)},
    SERVO: {by: ModelError(servo_scale=1.0 + by / 100.0) for by in (-20.0, 0.0, 20.0)},
    LATENCY: {by: ModelError(latency_error_s=by / 1000.0) for by in (-50.0, 0.0, 50.0)},
}
ERRORS = tuple(dict.fromkeys(error for errors in _ERRORS.values() for error in errors.values()))


def wrong_jobs(jobs: Sequence[RivalJob], results: Sequence[Row]) -> list[RivalJob]:
    """Jobs with each model mismatch, for controllers with a model.

    Constants are the best ones without mismatch.

    Args:
        jobs: Jobs without mismatch.
        results: Their results, from `labelled`.

    Returns:
        The jobs.
    """
    known = [run for run in results if not run["failed"] and not run["left_out"]]
    chosen = {(run["rival"], run["constants"]) for run in at_their_best(known)}
    return [
        replace(job, error=error)
        for error in ERRORS
        for job, run in zip(jobs, results, strict=True)
        if job.rival in WITH_MODEL and error != ModelError() and (run["rival"], run["constants"]) in chosen
    ]


def by_error(runs: Sequence[Row]) -> dict[str, list[dict[str, Any]]]:
    """Rows by model mismatch.

    Args:
        runs: Runs with metrics, of one neck and sensor.

    Returns:
        By mismatched parameter: rows of `summarise` with ``error`` (its name) and ``by`` (percent, or milliseconds).
    """
    right = at_their_best([run for run in runs if run["error"] == ModelError()])
    chosen = {(run["rival"], run["constants"]) for run in right}
    runs = [run for run in runs if (run["rival"], run["constants"]) in chosen]
    return {
        name: [
            {**row, "error": name, "by": by}
            for by, error in errors.items()
            for row in summarise([run for run in runs if run["error"] == error])
        ]
        for name, errors in _ERRORS.items()
    }


# Heading, metric, factor, format.
_Column = tuple[str, str, float, str]
_ANSWERS: tuple[_Column, ...] = (
    ("overshoot (deg)", "overshoot_deg", 1.0, ".2f"),
    ("settling to 1 deg (s)", "settling_s", 1.0, ".2f"),
    ("to 2.6 deg (s)", "settling_2p6_s", 1.0, ".2f"),
    ("reversals", "reversals", 1.0, ".1f"),
    ("steady-state error (deg)", "rest_error_deg", 1.0, ".2f"),
)
_GAZES: tuple[_Column, ...] = (
    ("contact (%)", "eye_contact_2p6", 100.0, ".1f"),
    ("RMS error (deg)", "gaze_error_rms_deg", 1.0, ".2f"),
    ("RMS acceleration (rad/s2)", "rms_acceleration_rad_s2", 1.0, ".2f"),
)
_BEHIND_MPC: _Column = ("behind the MPC (points)", BEHIND, 100.0, ".1f")
_COLUMNS: dict[str, tuple[_Column, ...]] = {
    ALL_STILL: (*_ANSWERS, *_GAZES[:1]),
    "step": _ANSWERS,
    "ramp": (*_ANSWERS, *_GAZES),
    **dict.fromkeys((*POSTURES, ALL_WALKS), (*_GAZES[:1], _BEHIND_MPC, *_GAZES[1:])),
    LOSS: (("renewed contact after (s)", "recontact_s", 1.0, ".2f"), *_GAZES),
}


def page_tables(rows: Sequence[Row]) -> list[PageTable]:
    """All tables, the best first.

    Args:
        rows: Rows of `summarise`.

    Returns:
        One table per trial, neck and sensor; the first column is the rival.
    """
    found = []
    for trial, columns in _COLUMNS.items():
        of_trial = [row for row in rows if row["trial"] == trial]
        for (neck, sensor), here in grouped(of_trial, "neck", "sensor").items():
            cells = tuple(
                (row["rival"], *(with_ends(row[name], row[f"{name}_ci95"], form, by) for _, name, by, form in columns))
                for row in here
            )
            headings = ("", *(heading for heading, *_ in columns))
            found.append(PageTable(f"{trial}, neck {neck}, sensor {sensor}", headings, cells))
    return found


# Colour-blind safe colours (Paul Tol's muted scheme); combinations with markers exceed the number of rivals.
_COLOURS = ("#332288", "#999933", "#882255", "#44AA99", "#117733", "#AA4499", "#DDCC77")


def contact_plots(rows: Sequence[Row]) -> list[Plot]:
    """Eye contact on walks against acceleration, one point per rival, one plot per neck.

    Args:
        rows: Rows of `summarise`, of one sensor.
    """
    colours = {name: _COLOURS[k % len(_COLOURS)] for k, name in enumerate(NAMES)}
    colours |= {f"ours: {name}": look.colour for name, look in styles(OURS).items()}
    walks = sorted((row for row in rows if row["trial"] == ALL_WALKS), key=lambda row: NAMES.index(row["rival"]))
    plots = []
    for (neck,), of_neck in grouped(walks, "neck").items():
        here = {f"{'ours: ' * (r['rival'] in OURS)}{r['rival']}": r for r in of_neck}
        lines = points(here, "rms_acceleration_rad_s2", "eye_contact_2p6", 100.0, colours)
        x, y = "RMS joint acceleration (rad/s$^2$)", "eye contact within 2.6 deg (% of the time)"
        plots.append(Plot(f"neck {neck}", x, y, lines))
    return plots


def error_tables(by_label: Mapping[str, Sequence[Row]], level: Sequence[Row]) -> list[PageTable]:
    """Eye contact under model mismatch.

    Args:
        by_label: Rows with ``rival``, ``by`` and ``eye_contact_2p6``, by label of the mismatch.
        level: Rows of rivals without a model.

    Returns:
        One table per mismatch, and one of the laws without a model.
    """
    tables = []
    for label, of_error in by_label.items():
        ticks = sorted({row["by"] for row in of_error})
        lines = []
        for (rival,), of_rival in grouped(of_error, "rival").items():
            percent = {row["by"]: 100.0 * row["eye_contact_2p6"] for row in of_rival}
            lines.append((rival, *(f"{percent[by]:.1f}" if by in percent else "-" for by in ticks)))
        tables.append(PageTable(f"Eye contact in %, by {label}", ("", *(f"{by:+g}" for by in ticks)), tuple(lines)))
    without = tuple((row["rival"], f"{100.0 * row['eye_contact_2p6']:.1f}") for row in level)
    return [*tables, PageTable("Eye contact in % of laws without a model", ("", "all errors"), without)]
