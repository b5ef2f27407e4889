"""Figures of the controllers on one recording over the seeds of the noise: the printed table and its conclusion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from gazempc.neck.spec import AXES, NeckSpec
from gazempc.parts import TRUE_FUTURE
from gazempc.results.contact import of_known
from gazempc.results.log import ComputeTimes, Log
from gazempc.results.metrics import measure
from gazempc.results.run_summary import Row, label, make_rows, measure_compute


@dataclass(frozen=True)
class Repeats:
    """Figures of one controller on one recording for each seed.

    Attributes:
        seeds: Seeds of the noise; logs and figures are of the first one.
        rows: Figures under each seed.
    """

    seeds: tuple[int, ...]
    rows: tuple[Row, ...]

    @property
    def first(self) -> Row:
        """The figures under the first seed."""
        return self.rows[0]

    def values(self, name: str) -> list[float]:
        """A figure under each seed, by its name in `summary.json`."""
        return [float(row.as_dict()[name]) for row in self.rows]

    def mean(self, name: str) -> float:
        """Mean over the seeds with a defined figure; NaN if undefined for all."""
        return of_known(np.array(self.values(name)))

    def sd(self, name: str) -> float:
        """Standard deviation over the seeds with a defined figure; NaN for fewer than two."""
        values = np.array(self.values(name))
        return of_known(values, partial(np.std, ddof=1)) if np.isfinite(values).sum() > 1 else math.nan

    def as_dict(self) -> dict[str, Any]:
        """Content of `summary.json`: mean, s.d. and the values under each seed, by figure."""
        names = [name for name in self.first.as_dict() if name not in {"controller", "predictor"}]
        return {
            "controller": self.first.controller,
            "predictor": self.first.predictor,
            "mean": {name: self.mean(name) for name in names},
            "sd": {name: self.sd(name) for name in names},
            "per_seed": {name: self.values(name) for name in names},
        }


def by_controller(seeds: tuple[int, ...], rounds: list[list[Row]]) -> list[Repeats]:
    """The figures of each controller.

    Args:
        seeds: The seeds.
        rounds: For each seed the figures of all controllers, always in the same order.

    Returns:
        One entry a controller.
    """
    return [Repeats(seeds, rows) for rows in zip(*rounds, strict=True)]


def measured_again(log: Log) -> Repeats:
    """Figures of a log; computing times are NaN, as a log contains none.

    Args:
        log: The log.

    Returns:
        The figures of its one run.
    """
    times = measure_compute(ComputeTimes(*(np.empty(0),) * 3), log.neck.control_period_s)
    return Repeats((log.run.seed,), tuple(make_rows([(log.run.controller, log.run.predictor, measure(log), times)])))


# Relevant differences to the reactive gaze: more than this share of its error, or this share of the time.
_ERROR_LEVEL = 0.02
_CONTACT_LEVEL = 0.003
# They must also exceed this many standard errors of the paired differences over the seeds of the noise.
_STANDARD_ERRORS = 2.0


def table_lines(repeats: Sequence[Repeats], neck: NeckSpec) -> list[tuple[str, list[str]]]:
    """The cells of the table, one controller a column.

    With several seeds: means and standard deviations; maxima of peaks, sums of violations, means of times.

    Args:
        repeats: The figures.
        neck: The neck; its limits are printed beside the peaks.

    Returns:
        Name of each line, with leading spaces if it continues the one above, and one cell per controller; the
        controllers' names first.
    """
    seeds = repeats[0].seeds

    def spread(name: str, digits: int = 2, unit: str = "") -> list[str]:
        factor = 100.0 if unit == " %" else 1.0
        return [_spread(factor * r.mean(name), factor * r.sd(name), digits, unit) for r in repeats]

    def peak(what: str, suffix: str, unit: str, digits: int) -> tuple[str, list[str]]:
        limits = getattr(neck, f"{what}_max_{suffix}")
        span = f"{limits.min():g}" if limits.min() == limits.max() else f"{limits.min():g}/{limits.max():g}"
        most = [f"{max(r.values(f'peak_{what}_{suffix}')):.{digits}f}" for r in repeats]
        return f"peak {what} [{unit}], limit {span}", most

    lines: list[tuple[str, list[str]]] = [
        ("", [label(r.first.controller) for r in repeats]),
        ("filter and forecast", [r.first.predictor for r in repeats]),
        ("gaze error RMS [deg]", spread("gaze_error_rms_deg")),
        ("           median [deg]", spread("gaze_error_median_deg")),
        ("           95 % below [deg]", spread("gaze_error_p95_deg")),
        ("eye contact within 2.6 deg", spread("eye_contact_2p6", 1, " %")),
        ("            within 4 deg", spread("eye_contact_4", 1, " %")),
        ("            within 9 deg", spread("eye_contact_9", 1, " %")),
        ("gap to perfect closed", spread("gap_closed", 1, " %")),
        ("RMS acceleration [rad/s^2]", spread("rms_acceleration_rad_s2")),
        peak("velocity", "rad_s", "rad/s", 2),
        peak("acceleration", "rad_s2", "rad/s^2", 1),
        peak("jerk", "rad_s3", "rad/s^3", 0),
        ("limit violations", [f"{sum(r.values('limit_violations')):.0f}" for r in repeats]),
        ("step time, median [ms]", [_spread(r.mean("step_ms_p50"), math.nan, 2, "") for r in repeats]),
        ("           99 % below [ms]", [_spread(r.mean("step_ms_p99"), math.nan, 2, "") for r in repeats]),
    ]
    if neck.eyes:
        lines.insert(10, ("eye eccentricity, 95 % below [deg]", spread("eye_eccentricity_p95_deg", 1)))
    if neck.joints > len(AXES):
        lines.insert(10, ("           of the head [rad/s^2]", spread("head_rms_acceleration_rad_s2")))
    if len(seeds) > 1:
        of_first = [f"{r.first.metrics.gaze_error_rms_deg:.2f}" for r in repeats]
        lines.insert(3, (f"           seed {seeds[0]}, as in the figures", of_first))
    return lines


def table(repeats: Sequence[Repeats], neck: NeckSpec, against: str = "") -> str:
    """A readable table, see `table_lines`.

    Args:
        repeats: The figures.
        neck: The neck; its limits are printed beside the peaks.
        against: Reference in place of an unknown true head; printed below the table.

    Returns:
        Lines of text.
    """
    text = aligned([[name, *cells] for name, cells in table_lines(repeats, neck)])
    text.insert(2, "-" * max(map(len, text)))
    if against:
        text.append(f"Gaze error and eye contact are against {against}: the true head was not measured.")
    return "\n".join(text)


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table of texts: the first column flush left, the others flush right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    padded = ([f"{name:<{widths[0]}}", *map(str.rjust, cells, widths[1:])] for name, *cells in rows)
    return ["  ".join(cells).rstrip() for cells in padded]


def sentence(repeats: Sequence[Repeats]) -> str:
    """The conclusion of the table, in one or two sentences.

    Args:
        repeats: The figures; means over the seeds are compared.

    Returns:
        The sentences. They compare the controllers with the reactive gaze and with the perfect forecast.
    """

    def contact(r: Repeats) -> str:
        return _spread(100.0 * r.mean("eye_contact_2p6"), math.nan, 1, " %")

    by_name = {r.first.controller: r for r in repeats}
    predictive = [by_name[name] for name in ("lookahead", "mpc") if name in by_name]
    if "reactive" not in by_name or not predictive:
        best = min(repeats, key=lambda r: r.mean("gaze_error_rms_deg"))
        name = label(best.first.controller)
        return f"The {name} gaze is on the person's eyes (within 2.6 deg) {contact(best)} of the time."
    reactive = by_name["reactive"]
    claims = []
    for r in predictive:
        ratio = reactive.mean("gaze_error_rms_deg") / r.mean("gaze_error_rms_deg")
        change = f"{ratio:.1f} times smaller" if ratio > 1 else f"{1 / ratio:.1f} times larger"
        claims.append(f"{label(r.first.controller)} {contact(r)} (RMS error {change})")
    text = f"Eye contact (within 2.6 deg): reactive {contact(reactive)} of the time, {', '.join(claims)}."
    if TRUE_FUTURE in by_name:
        limit = by_name[TRUE_FUTURE]
        error_deg = limit.mean("gaze_error_rms_deg")
        text += f" With a perfect forecast, the same neck has {contact(limit)}, at {error_deg:.2f} deg."
    return " ".join([text, *_costs(predictive, reactive, by_name.get(TRUE_FUTURE))])


def _costs(predictive: Sequence[Repeats], reactive: Repeats, perfect: Repeats | None) -> list[str]:
    """Costs of forecasts against the reactive gaze, and remedies."""

    def beyond_noise(r: Repeats, name: str, sign: float, least: float) -> float:
        """Mean difference to the reactive gaze if it is more than twice its standard error, else 0."""
        differences = sign * (np.array(r.values(name)) - np.array(reactive.values(name)))
        mean = float(np.mean(differences))
        error = float(np.std(differences, ddof=1)) / math.sqrt(differences.size) if differences.size > 1 else 0.0
        return mean if mean > max(least, _STANDARD_ERRORS * error) else 0.0

    costs, forecasts = [], set()
    for r in predictive:
        lost = beyond_noise(r, "eye_contact_2p6", -1.0, _CONTACT_LEVEL)
        reactive_deg = reactive.mean("gaze_error_rms_deg")
        more_deg = beyond_noise(r, "gaze_error_rms_deg", 1.0, _ERROR_LEVEL * reactive_deg)
        parts = [f"{100.0 * lost:.1f} points less contact"] if lost else []
        parts += [f"{more_deg:.2f} deg more RMS error"] if more_deg else []
        if parts:
            costs.append(f"{label(r.first.controller)} has {' and '.join(parts)} than the reactive gaze.")
            forecasts.add(r.first.predictor)
    if not costs:
        return []
    if perfect is not None and perfect.mean("gaze_error_rms_deg") < reactive.mean("gaze_error_rms_deg"):
        costs.append("On this recording the forecast costs more than it gains.")
    tries = [] if forecasts == {"last_position"} else ["--predictor last_position"]
    tries += ["the noise of your own tracker (gazempc identify --tracker)", "--controllers reactive"]
    return [*costs, f"Try {', '.join(tries[:-1])} or {tries[-1]}."]


def _spread(mean: float, sd: float, digits: int, unit: str) -> str:
    if math.isnan(mean):
        return "-"
    return f"{mean:.{digits}f}{'' if math.isnan(sd) else f' ± {sd:.{digits}f}'}{unit}"
