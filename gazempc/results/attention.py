"""Metrics of attention to several people and of gaze aversion, from the log alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, get_type_hints

import numpy as np

from gazempc.results.contact import CONTACT_DEG, of_known, overshoot_deg, p95, time_to
from gazempc.results.log import Log
from gazempc.results.metrics import SCORED_FROM_S, gaze_error_deg
from gazempc.types import BoolArray, FloatArray


@dataclass(frozen=True)
class AttentionMetrics:
    """Metrics of attention and of gaze aversion; NaN where undefined.

    Each field is annotated with its display name and scale factor.

    Attributes:
        contact_attended: Share of the scored time outside aversions with eye contact (2.6 deg) with the attended
            person.
        switches_per_minute: Changes of the attended person a minute.
        time_to_contact_after_switch_s: Median time from a switch to contact, seconds, over switches with contact.
        switches_without_contact: Switches after which there was no contact before the next one.
        switch_overshoot_deg: Largest lateral overshoot of the gaze after a switch, degrees; see
            `gazempc.results.contact.overshoot_deg`.
        identity_swaps: Number of first assignments of one person's observations to another person; an exchange of
            numbers counts twice.
        away_share: Share of the scored time without contact during looks away.
        away_share_planned: Share of it that was planned.
        away_duration_ratio: Mean realised over mean planned duration of looks away, from contact to contact.
        away_interval_ratio: The same ratio for the intervals between the starts of successive aversions.
        return_late_s: Median delay of contact after its planned return, seconds.
        return_late_p95_s: 95th percentile of this delay, seconds.
    """

    contact_attended: Annotated[float, "eye contact with the attended person [%]", 100.0]
    switches_per_minute: Annotated[float, "switches a minute", 1.0]
    time_to_contact_after_switch_s: Annotated[float, "contact after a switch, median [s]", 1.0]
    switches_without_contact: Annotated[float, "switches without contact", 1.0]
    switch_overshoot_deg: Annotated[float, "overshoot after a switch, at most [deg]", 1.0]
    identity_swaps: Annotated[float, "identity swaps", 1.0]
    away_share: Annotated[float, "looked away [%]", 100.0]
    away_share_planned: Annotated[float, "            as planned [%]", 100.0]
    away_duration_ratio: Annotated[float, "looks away, realised / planned duration", 1.0]
    away_interval_ratio: Annotated[float, "            interval", 1.0]
    return_late_s: Annotated[float, "contact back after plan, median [ms]", 1e3]
    return_late_p95_s: Annotated[float, "            95 % within [ms]", 1e3]


WORDS: Mapping[str, tuple[str, float]] = {
    name: hint.__metadata__ for name, hint in get_type_hints(AttentionMetrics, include_extras=True).items()
}


def measure_attention(log: Log) -> AttentionMetrics:
    """Compute the metrics.

    Args:
        log: The run.

    Returns:
        The metrics.
    """
    error_deg = gaze_error_deg(log)
    contact = error_deg <= CONTACT_DEG[0]
    scored = (log.time_s >= log.time_s[0] + SCORED_FROM_S - 1e-9) & np.isfinite(error_deg)
    away = log.looks_away
    known, turns = bool(np.isfinite(error_deg).any()), _turns(log)
    # Within the period of the first person and of each switch to a person; NaN without contact.
    to_contact_s = np.array([time_to(contact[ticks], log.time_s[ticks]) for ticks in turns])
    minutes = (log.time_s[-1] - log.time_s[0]) / 60.0
    realised, planned_s = _realised(log, contact)
    late_s = realised[:, 1] - planned_s[:, 1]
    chosen = bool(log.attended_time_s.size)
    return AttentionMetrics(
        contact_attended=of_known(contact[scored & ~away]),
        switches_per_minute=max(to_contact_s.size - 1, 0) / minutes if minutes > 0 else float("nan"),
        time_to_contact_after_switch_s=of_known(to_contact_s[1:], np.median),
        switches_without_contact=float(np.isnan(to_contact_s[1:]).sum()) if known else float("nan"),
        switch_overshoot_deg=of_known(np.array([overshoot_deg(log, ticks) for ticks in turns[1:]]), np.max),
        identity_swaps=float(log.identity_swap_time_s.size) if known and chosen else float("nan"),
        away_share=of_known((away & ~contact)[scored]),
        away_share_planned=of_known(away[scored]),
        away_duration_ratio=_ratio(np.ptp(realised, axis=1), np.ptp(planned_s, axis=1)),
        away_interval_ratio=_ratio(np.diff(realised[:, 0]), np.diff(planned_s[:, 0])),
        return_late_s=of_known(late_s, np.median),
        return_late_p95_s=of_known(late_s, p95),
    )


def attention_lines(found: AttentionMetrics) -> list[str]:
    """The metrics as sentences.

    Args:
        found: The metrics.

    Returns:
        A line on the attended people, and one on gaze aversion, if any.
    """
    lines = []
    if found.switches_per_minute > 0:
        line = f"{found.switches_per_minute:.1f} switches a minute"
        if np.isfinite(found.contact_attended):
            line = f"eye contact with the attended person {found.contact_attended:.1%} of the time; {line}"
        if np.isfinite(found.time_to_contact_after_switch_s):
            line += f", contact after {found.time_to_contact_after_switch_s:.2f} s"
        if found.switches_without_contact > 0:
            line += f", {found.switches_without_contact:.0f} without contact"
        lines.append(line)
    if found.identity_swaps > 0:
        lines.append(f"identity swaps: {found.identity_swaps:.0f}")
    if np.isfinite(found.return_late_s):
        lines.append(
            f"looked away {found.away_share:.1%} of the time (planned {found.away_share_planned:.1%}); contact came "
            f"back {1e3 * found.return_late_s:.0f} ms after plan (95 % within {1e3 * found.return_late_p95_s:.0f} ms)"
        )
    return lines


def _turns(log: Log) -> list[slice]:
    """Ticks of each period of attention to a person."""
    starts = np.searchsorted(log.time_s, log.attended_time_s - 1e-9).tolist()
    ends = [*starts, log.time_s.size][1:]
    return [
        slice(start, end)
        for start, end, person in zip(starts, ends, log.attended_person.tolist(), strict=True)
        if person and start < end
    ]


def _realised(log: Log, contact: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Realised and planned end and return of contact for each completed aversion, shape (W, 2), seconds."""
    realised, planned_s = [], []
    for start_s, end_s in zip(log.away_start_s.tolist(), log.away_end_s.tolist(), strict=True):
        middle = int(np.searchsorted(log.time_s, 0.5 * (start_s + end_s)))
        before, after = np.flatnonzero(contact[:middle]), np.flatnonzero(contact[middle:])
        if before.size and after.size and after[0] > 0:
            realised.append((log.time_s[before[-1]], log.time_s[middle + after[0]]))
            planned_s.append((start_s, end_s))
    return np.array(realised).reshape(-1, 2), np.array(planned_s).reshape(-1, 2)


def _ratio(realised_s: FloatArray, planned_s: FloatArray) -> float:
    return float(np.mean(realised_s) / np.mean(planned_s)) if realised_s.size else float("nan")
