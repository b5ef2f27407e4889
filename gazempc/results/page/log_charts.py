"""Curves of a log: gaze error, and joints where the error is unknown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from gazempc.results.contact import CONTACT_DEG
from gazempc.results.figures.people import are_alike, away_in_all, person_colour, turns
from gazempc.results.figures.style import COLOURS, styles
from gazempc.results.log import Log
from gazempc.results.metrics import SCORED_FROM_S, gaze_error_deg
from gazempc.results.page.chart import Chart, Curve, Span


def error_chart(logs: Mapping[str, Log]) -> Chart:
    """The gaze error of each controller over time.

    Args:
        logs: Controller -> log of the same recording.

    Returns:
        The chart; curves have gaps where the true head or the joints are not known.
    """
    looks = styles(logs)
    curves = tuple(
        Curve(looks[name].label, looks[name].colour, log.time_s - log.time_s[0], gaze_error_deg(log))
        for name, log in logs.items()
    )
    levels = ((CONTACT_DEG[0], f"eye contact, {CONTACT_DEG[0]:g}°"),)
    spans = (Span(0.0, SCORED_FROM_S, "not scored"), *_people(logs))
    return Chart("Gaze error over time", "time (s)", "gaze error (deg)", curves, levels, spans)


def _people(logs: Mapping[str, Log]) -> Iterator[Span]:
    """When contact is not due, and whom the gazes were for, where these are alike."""
    yield from (Span(from_s, to_s, "looks away") for from_s, to_s in away_in_all(logs))
    if any(log.attended_time_s.size for log in logs.values()) and are_alike(logs):
        for turn in turns(next(iter(logs.values()))):
            yield Span(turn.from_s, turn.to_s, turn.texts[0], person_colour(turn.number))


def joints_chart(log: Log) -> Chart:
    """Where the joints were: for runs in which the gaze error is unknown.

    Args:
        log: The run.

    Returns:
        The chart.
    """
    time_s, angles_deg = log.time_s - log.time_s[0], np.rad2deg(log.joint_position_rad)
    curves = tuple(
        Curve(name.replace("_", " "), colour, time_s, angles_deg[:, k])
        for k, (name, colour) in enumerate(zip(log.neck.joint_names, COLOURS, strict=False))
    )
    spans = tuple(_people({log.run.controller: log}))
    return Chart("Joints over time", "time (s)", "angle (deg)", curves, spans=spans)
