"""Small pictures of what an example did, for the gallery. They have no background: they are read on light and dark."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gazempc import Log, measure
from gazempc.neck.kinematics import gaze_ray
from gazempc.results.contact import CONTACT_DEG
from gazempc.results.figures.style import COLOURS, CONTACT_COLOUR
from gazempc.results.metrics import SCORED_FROM_S, gaze_error_deg

# Read on white and on black.
_GREY = "#888888"
_LOOK = {
    "font.size": 9,
    "axes.edgecolor": _GREY,
    "axes.labelcolor": _GREY,
    "axes.prop_cycle": mpl.cycler(color=[COLOURS[k] for k in (1, 5, 2, 3)]),
    "axes.spines.right": False,
    "axes.spines.top": False,
    "lines.linewidth": 2.0,
    "text.color": _GREY,
    "xtick.color": _GREY,
    "ytick.color": _GREY,
}
_RAYS = 9

Draw = Callable[[Axes, Sequence[Any]], None]


def thumbnail(logs: Sequence[Any], draw: Draw, path: Path) -> None:
    """Write the picture of an example.

    Args:
        logs: The runs of the example, at least one.
        draw: One of the functions below.
        path: Picture to write.
    """
    with mpl.rc_context(_LOOK):
        figure = Figure(figsize=(3.2, 2.0), dpi=160, layout="constrained")
        draw(figure.subplots(), logs)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, transparent=True)


def error_over_time(ax: Axes, logs: Sequence[Log]) -> None:
    """Gaze error of those runs that are of the first run's walk."""
    shown = [log for log in logs if log.run.recording == logs[0].run.recording]
    same_controller = len({log.run.controller for log in shown}) == 1
    for log in shown:
        label = log.run.predictor if same_controller and len(shown) > 2 else log.run.controller
        ax.plot(log.time_s - log.time_s[0], gaze_error_deg(log), label=label)
    ax.axhspan(0.0, CONTACT_DEG[0], color=CONTACT_COLOUR, alpha=0.2, lw=0)
    ax.set(xlabel="time (s)", ylabel="gaze error (deg)", xlim=(SCORED_FROM_S, None), ylim=(0.0, None))
    _name_lines(ax)


def from_above(ax: Axes, logs: Sequence[Log]) -> None:
    """Walk and gaze of the last run from above; the robot looks up."""
    log = logs[-1]
    head_m = log.head_true_base_m
    ticks = np.linspace(0, log.time_s.size - 1, _RAYS).astype(int)
    eye_m, direction = gaze_ray(log.neck.geometry, log.joint_position_rad[ticks])
    tip_m = eye_m + np.linalg.norm(head_m[ticks] - eye_m, axis=1, keepdims=True) * direction
    ax.plot(head_m[:, 1], head_m[:, 0], color=_GREY)
    ax.plot(np.stack([eye_m[:, 1], tip_m[:, 1]]), np.stack([eye_m[:, 0], tip_m[:, 0]]), color=COLOURS[5], lw=1.2)
    ax.plot(0, 0, "^", color=_GREY, ms=9)
    ax.set_aspect("equal", adjustable="datalim")
    ax.xaxis.set_inverted(True)
    ax.axis("off")


def command_and_joint(ax: Axes, logs: Sequence[Log]) -> None:
    """Pan of the last run: what was sent, and where the joint was."""
    log = logs[-1]
    time_s = log.time_s - log.time_s[0]
    ax.plot(time_s, np.degrees(log.command_position_rad[:, 0]), color=COLOURS[5], label="command")
    ax.plot(time_s, np.degrees(log.joint_position_rad[:, 0]), color=COLOURS[1], label="joint")
    ax.set(xlabel="time (s)", ylabel="pan (deg)")
    _name_lines(ax)


def who_is_looked_at(ax: Axes, logs: Sequence[Log]) -> None:
    """Who is looked at over time, and looks away."""
    log = logs[-1]
    starts_s, lasts_s = log.attended_time_s - log.time_s[0], log.time_s[-1] - log.time_s[0]
    ends_s = np.append(starts_s, lasts_s)[1:]
    for start_s, end_s, person in zip(starts_s, ends_s, log.attended_person, strict=True):
        ax.barh(-person, end_s - start_s, 0.6, start_s, color=COLOURS[(1, 5)[person % 2]])
    for start_s, end_s in zip(log.away_start_s - log.time_s[0], log.away_end_s - log.time_s[0], strict=True):
        ax.axvspan(start_s, end_s, color=_GREY, alpha=0.5, lw=0)
    people = np.unique(log.attended_person)
    ax.set_yticks(-people, [f"person {person}" for person in people])
    ax.set(xlabel="time (s); grey: looks away", xlim=(0.0, lasts_s))


def error_against_acceleration(ax: Axes, logs: Sequence[Log]) -> None:
    """One point a run."""
    found = [measure(log) for log in logs]
    ax.plot([each.rms_acceleration_rad_s2 for each in found], [each.gaze_error_rms_deg for each in found], "o-")
    ax.set(xlabel="RMS acceleration (rad/s²)", ylabel="gaze error (deg)", xlim=(0, None))
    ax.set_ylim(0.0, 1.2 * ax.get_ylim()[1])


def _name_lines(ax: Axes) -> None:
    look = {"frameon": False, "labelcolor": "linecolor", "fontsize": "small", "handlelength": 0.8}
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.0, **look)


def planned_angles(ax: Axes, motions: Sequence[np.ndarray]) -> None:
    """A plan of one joint: command and joint at the ends of its steps, as rows 2 and 0 of z."""
    z = np.rad2deg(motions[0])
    ax.step(range(z.shape[1]), z[2], label="command")
    ax.plot(z[0], label="joint, one dead time later")
    ax.set(xlabel="step", ylabel="pan [deg]")
    ax.legend(frameon=False)
