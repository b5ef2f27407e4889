"""The walk from above, the gaze error over time, the attended person, and the three of them in one picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Patch
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from gazempc.neck.kinematics import gaze_ray
from gazempc.results.contact import CONTACT_DEG
from gazempc.results.figures.known import (
    HEAD_LINE,
    Part,
    contact_shares,
    draw_known,
    finish,
    head_alone,
    head_error_deg,
    known_title,
    parts,
    shown_head,
)
from gazempc.results.figures.people import (
    are_alike,
    away_in_all,
    draw_turns,
    has_attention,
    person_colour,
    question,
    turns,
)
from gazempc.results.figures.style import (
    CONTACT_COLOUR,
    DPI,
    OBSERVED,
    Logs,
    readable,
    recording_title,
    say,
    setup_title,
    shade_unscored,
    styles,
)
from gazempc.results.log import Log
from gazempc.results.metrics import SCORED_FROM_S, gaze_error_deg
from gazempc.types import FloatArray

_PLAN_WIDTH = 7.2
_RAYS_AT_MOST = 5
# Head and body are drawn so far of the way to the person: beyond, they would cross the gazes.
_PART_REACH = 0.45
# Labels need about this share of the drawing in the overview.
_LABEL_GAP = 0.1
# Of the person who is looked at, below their path.
_BAND: dict[str, Any] = {"lw": 8.0, "solid_capstyle": "round", "zorder": 2}


def birds_eye(logs: Logs, path: Path) -> None:
    """Draw the walk from above with the gaze rays of each controller.

    Args:
        logs: The runs.
        path: Picture to write.
    """
    with readable(_PLAN_WIDTH):
        figure = Figure(figsize=(_PLAN_WIDTH, 6.6), dpi=DPI, layout="constrained")
        ax = figure.subplots()
        draw_birds_eye(ax, logs, detailed=True)
        if ax.get_legend_handles_labels()[0]:
            figure.legend(loc="outside lower center", ncols=2, frameon=False)
        finish(figure, logs, path)


def draw_birds_eye(ax: Axes, logs: Logs, *, detailed: bool) -> tuple[Part, ...]:
    """Draw the walk from above, the robot, and where each controller's gaze was at some instants.

    A gaze ray ends as far from the eye as the head is; a dotted line joins its end to the head at that time.
    The robot looks up the page and its left is on the left. Of a neck with eyes or a body, shorter lines show where
    head and body pointed.

    Args:
        ax: Axes to draw on.
        logs: The runs.
        detailed: The observed heads beside the true one, too; else only where that is unknown.

    Returns:
        Parts drawn beside the gaze, such as the robot's head.
    """
    heads = {name: shown_head(log) for name, log in logs.items()}
    shown = next(iter(heads.values()))
    time_s, head = shown.log.time_s - shown.log.time_s[0], shown.log.head_true_base_m
    end_s = float(time_s[-1])
    ax.set_aspect("equal", adjustable="datalim")
    observed = next(iter(logs.values())).head_observed_base_m
    if len(observed) and (detailed or not shown.known.any()):
        ax.plot(observed[:, 1], observed[:, 0], **OBSERVED, zorder=3, label="observed head")
    path_m = _whom_by_whom(ax, shown.log)
    if shown.known.any():
        draw_known(ax, path_m[:, 1], path_m[:, 0], shown, color="0.25", lw=1.5, zorder=4, label=shown.label)
    if not np.isfinite(head).any():
        say(ax, "no person was seen")
        _finish_plan(ax)
        return ()
    marks_s = np.arange(0.0, end_s + 1e-6)
    at = np.searchsorted(time_s, marks_s - 1e-6)
    # Rings, because the tip of a good gaze lies on the head and would hide a dot.
    ax.plot(head[at, 1], head[at, 0], "o", mfc="w", mec="0.25", mew=1.5, ms=11, ls="", zorder=5, label="each second")

    rays_s = marks_s[marks_s >= SCORED_FROM_S] if end_s >= SCORED_FROM_S else np.array([end_s])
    chosen = np.linspace(0, len(rays_s) - 1, min(len(rays_s), _RAYS_AT_MOST)).round().astype(int)
    looks, beside, gazes = styles(logs), dict[str, Part](), False
    for name, each in heads.items():
        look, log = looks[name], each.log
        tick = np.searchsorted(log.time_s, log.time_s[0] + rays_s[chosen] - 1e-6)
        eye, direction = gaze_ray(log.neck.geometry, log.joint_position_rad[tick])
        reach = np.linalg.norm(log.head_true_base_m[tick] - eye, axis=1, keepdims=True)
        tip = eye + reach * direction
        if not np.isfinite(tip).any():
            continue
        gazes = True
        ax.plot([eye[:, 1], tip[:, 1]], [eye[:, 0], tip[:, 0]], color=look.colour, lw=0.5 * look.width)
        for part in parts(log):
            end = eye + _PART_REACH * reach * part.direction[tick]
            ax.plot([eye[:, 1], end[:, 1]], [eye[:, 0], end[:, 0]], color=look.colour, lw=1.3, ls=part.line)
            beside[part.label] = part
        missed = np.stack([tip, log.head_true_base_m[tick]])
        ax.plot(missed[..., 1], missed[..., 0], color=look.colour, lw=1.0, ls=":")
        ax.plot(tip[:, 1], tip[:, 0], "D", color=look.colour, ms=5.5, mec="w", mew=0.5, zorder=6)
        ax.plot([], [], "D-", color=look.colour, ms=5.5, lw=0.5 * look.width, label=f"gaze, {look.label}")

    for part in beside.values():
        ax.plot([], [], color="0.3", lw=1.3, ls=part.line, label=part.label)
    if not gazes:
        say(ax, "no gaze: the joints were not read", 0.95)
    _label_times(ax, head, at, marks_s)
    _finish_plan(ax)
    return tuple(beside.values())


def _whom_by_whom(ax: Axes, log: Log) -> FloatArray:
    """Draw a band along each person's path while they were looked at.

    Returns:
        The head with a gap at each change of the attended person, shape (M, 3), metres.
    """
    head = log.head_true_base_m.copy()
    if not log.attended_time_s.size:
        return head
    labelled = set[int]()
    for turn in turns(log):
        span = np.searchsorted(log.time_s - log.time_s[0], [turn.from_s - 1e-6, turn.to_s - 1e-6])
        mine = head[slice(*span)]
        if turn.number and np.isfinite(mine).any():
            label = None if turn.number in labelled else f"person {turn.number}"
            labelled.add(turn.number)
            ax.plot(mine[:, 1], mine[:, 0], color=person_colour(turn.number), label=label, **_BAND)
        head[span[0]] = np.nan
    return head


def _finish_plan(ax: Axes) -> None:
    """Draw the robot; leave room for labels; name the axes."""
    ax.add_patch(FancyArrowPatch((0, 0), (0, 0.55), arrowstyle="-|>", mutation_scale=16, lw=2.5, fc="k", zorder=7))
    ax.plot(0, 0, "o", color="k", ms=11, zorder=7)
    ax.annotate("robot", (0, 0), (12, -3), textcoords="offset points", va="center")
    # Room for labels beside the path. Margins would not do, because equal aspect may take them away again.
    low, high = np.array(ax.dataLim.min), np.array(ax.dataLim.max)
    pad = _LABEL_GAP * float(np.max(high - low))
    ax.update_datalim([low - pad, high + pad])
    ax.margins(0.0)
    ax.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    ax.yaxis.set_major_locator(MaxNLocator(8, integer=True))
    ax.xaxis.set_inverted(True)
    ax.set(xlabel="to the robot's left, y (m)", ylabel="ahead of the robot, x (m)")
    ax.grid(color="0.9", lw=0.6)
    ax.set_axisbelow(True)


def _label_times(ax: Axes, head: FloatArray, at: NDArray[np.intp], marks_s: FloatArray) -> None:
    """Name start, end and the seconds that have room, beside the path on the side away from the robot.

    Args:
        ax: Axes to draw on.
        head: True head, shape (M, 3), metres.
        at: Ticks of the marks, shape (K,).
        marks_s: Times of the marks, shape (K,), seconds from the start.
    """
    known = np.flatnonzero(np.isfinite(head).all(axis=1))
    first, last = int(known[0]), int(known[-1])
    # The drawing spans walk and robot.
    gap_m = _LABEL_GAP * float(np.max(np.ptp(np.append(head[known, :2], [[0.0, 0.0]], axis=0), axis=0)))
    texts = {first: "start", last: "end"}
    if np.linalg.norm(head[last, :2] - head[first, :2]) < gap_m:
        texts = {first: "start, end"}
    for tick, mark_s in zip(at[1:], marks_s[1:], strict=True):
        if all(np.linalg.norm(head[tick, :2] - head[other, :2]) >= gap_m for other in texts):
            texts[int(tick)] = f"{mark_s:.0f} s"
    for tick, text in texts.items():
        along = np.nan_to_num(head[min(tick + 10, last), :2] - head[max(tick - 10, first), :2])
        outward = head[tick, :2]
        normal = np.array([-along[1], along[0]])
        if np.linalg.norm(normal) < 0.01:  # standing: no direction of travel
            normal = outward
        if normal @ outward < 0:
            normal = -normal
        normal = normal / max(float(np.linalg.norm(normal)), 1e-9)
        # The horizontal axis is y and points to the left.
        right, up = -normal[1], normal[0]
        ax.annotate(
            text,
            (head[tick, 1], head[tick, 0]),
            (10 * right, 10 * up),
            textcoords="offset points",
            ha="left" if right > 0.5 else "right" if right < -0.5 else "center",
            va="bottom" if up > 0.5 else "top" if up < -0.5 else "center",
            zorder=8,
        )


_ERROR_WIDTH = 8.0


def gaze_error(logs: Logs, path: Path) -> None:
    """Draw the gaze error over time with the contact cones and the share of eye contact.

    Args:
        logs: The runs.
        path: Picture to write.
    """
    with readable(_ERROR_WIDTH):
        figure = Figure(figsize=(_ERROR_WIDTH, 5.6), dpi=DPI, layout="constrained")
        ax = figure.subplots()
        draw_gaze_error(ax, logs, detailed=True)
        cones = " / ".join(f"{cone:g}" for cone in CONTACT_DEG)
        known = any(np.isfinite(gaze_error_deg(log)).any() for log in logs.values())
        title = f"eye contact: share within {cones} deg" if known else None
        figure.legend(loc="outside lower center", ncols=2, frameon=False, title=title)
        finish(figure, logs, path)


def draw_gaze_error(ax: Axes, logs: Logs, *, detailed: bool) -> bool:
    """Draw the gaze error over time, the contact cones and the part that is not scored.

    The legend entries name the share of the scored window within each cone.

    Args:
        ax: Axes to draw on.
        logs: The runs.
        detailed: All cones, and tenths of degrees beside tens of them; else the main cone and a linear scale.

    Returns:
        Whether the error of the robot's head alone is drawn, too, as of a neck with eyes.
    """
    cones = CONTACT_DEG if detailed else CONTACT_DEG[:1]
    for inner, outer, alpha in zip((0.0, *cones), cones, (0.28, 0.16, 0.08), strict=False):
        ax.axhspan(inner, outer, color=CONTACT_COLOUR, alpha=alpha, lw=0)
        ax.text(1.01, outer, f"{outer:g}°", transform=ax.get_yaxis_transform(), va="center", color="#00664B")
    top, end_s = 0.0, 0.0
    looks, heads_alone = styles(logs), False
    for name, log in logs.items():
        look, head = looks[name], shown_head(log)
        shown = head.log if head.rare else log
        error, alone = gaze_error_deg(shown), head_error_deg(shown)
        time_s = log.time_s - log.time_s[0]
        if alone is not None and np.isfinite(alone).any():
            ax.plot(time_s, alone, color=look.colour, lw=1.1, ls=HEAD_LINE)
            top, heads_alone = max(top, float(np.nanmax(alone))), True
        if np.isfinite(error).any():
            draw_known(ax, time_s, error, head, color=look.colour, lw=look.width, label=_shares(look.label, log))
        top, end_s = max(top, float(np.nanmax(error, initial=0.0))), max(end_s, float(time_s[-1]))
    if heads_alone:
        ax.plot([], [], color="0.3", lw=1.1, ls=HEAD_LINE, label="of the robot's head alone")
    _say_if_unknown(ax, logs)
    shade_unscored(ax, end_s, away_in_all(logs))
    ax.set(xlim=(0.0, end_s), ylim=(0.0, max(1.05 * top, 8.0)), xlabel="time (s)", ylabel="gaze error (deg)")
    if detailed:
        # On a logarithmic scale each passage through zero would be a spike of no meaning.
        ax.set_yscale("function", functions=(lambda v: np.sqrt(np.maximum(v, 0.0)), np.square))
        top = max(1.1 * top, 10.0)
        ticks = [0.0]
        for tick in (0.1, 0.5, 1, 2, 3, 5, 10, 15, 20, 30, 50, 100, 150):
            if np.sqrt(tick) - np.sqrt(ticks[-1]) > 0.05 * np.sqrt(top):
                ticks.append(tick)
        ax.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        ax.set(ylim=(0.0, top), ylabel="gaze error (deg, square-root scale)")
        ax.grid(axis="y", color="0.85", lw=0.6)
    return heads_alone


def _say_if_unknown(ax: Axes, logs: Logs) -> None:
    """Say in the place of gaze errors why there are none."""
    if not any(np.isfinite(log.head_true_base_m).any() for log in logs.values()):
        why = "no gaze error: the true head is unknown"
    elif not any(np.isfinite(gaze_error_deg(log)).any() for log in logs.values()):
        why = "no gaze error: the joints were not read"
    else:
        return
    say(ax, why)


def _shares(label: str, log: Log) -> str:
    shares = contact_shares(log)
    if not np.isfinite(shares).all():
        return f"{label}: not known"
    return f"{label}: {' / '.join(f'{100 * share:.0f}' for share in shares)} %"


_ATTENDED_WIDTH = 8.0
# Letters that have room in the time line, and heights of the bars of a run: who is looked at, and below it contact.
_ATTENDED_LETTERS = 75
_WHO, _CONTACT = 0.5, 0.18


def attended(logs: Logs, path: Path) -> None:
    """Draw a time line a run.

    Args:
        logs: The runs.
        path: Picture to write.
    """
    with readable(_ATTENDED_WIDTH):
        figure = Figure(figsize=(_ATTENDED_WIDTH, 1.6 + 0.8 * len(logs)), dpi=DPI, layout="constrained")
        ax = figure.subplots()
        looks, end_s = styles(logs), 0.0
        for row, (_, log) in enumerate(logs.items()):
            draw_turns(ax, log, -float(row), _WHO, _ATTENDED_LETTERS)
            _draw_contact(ax, log, -row - 0.5 * _WHO - _CONTACT)
            end_s = max(end_s, float(log.time_s[-1] - log.time_s[0]))
        ax.set_yticks([-float(row) for row in range(len(logs))], [looks[name].label for name in logs])
        ax.set(xlim=(0.0, end_s), ylim=(0.45 - len(logs), 0.4), xlabel="time (s)")
        numbers = sorted({turn.number for log in logs.values() for turn in turns(log)} - {0})
        legend = [Patch(color=person_colour(number), label=f"person {number}") for number in numbers]
        legend.append(Patch(facecolor="w", edgecolor="k", hatch="////", label="looks away"))
        if any(np.isfinite(gaze_error_deg(log)).any() for log in logs.values()):
            legend.append(Patch(color=CONTACT_COLOUR, label=f"contact (within {CONTACT_DEG[0]:g} deg)"))
        figure.legend(handles=legend, loc="outside lower center", ncols=4, frameon=False)
        finish(figure, logs, path)


def _draw_contact(ax: Axes, log: Log, at: float) -> None:
    start_s, end_s = float(log.time_s[0]), float(log.time_s[-1])
    contact = gaze_error_deg(log) <= CONTACT_DEG[0]
    edges = np.flatnonzero(np.diff(contact, prepend=False, append=False))
    times_s = np.append(log.time_s, end_s) - start_s
    spans = [(times_s[a], times_s[b] - times_s[a]) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    ax.broken_barh(spans, (at, _CONTACT), color=CONTACT_COLOUR, lw=0)


_OVERVIEW_WIDTH = 32 / 3
# Beside a bar of a larger share its words have no room.
_LONG_BAR = 0.75
_OF_ROBOT = "robot's"
# Letters that have room in the time line of the attended person.
_LETTERS = 52
_LONGEST_TITLE = 100


def draw_contact_bars(ax: Axes, logs: Logs) -> None:
    """Draw the share of the scored window with eye contact, a bar for each controller.

    Of a neck with eyes a second bar has the share of the head alone.

    Args:
        ax: Axes to draw on.
        logs: The runs.
    """
    looks = styles(logs)
    for row, (name, log) in enumerate(logs.items()):
        alone, colour = head_alone(log), looks[name].colour
        # Below the gaze of eyes and head together that of the head, if the eyes looked where it points.
        height, at = (0.72, float(row)) if alone is None else (0.44, row - 0.14)
        _bar(ax, at, height, contact_shares(log)[0], {"color": colour}, {"fontsize": "large", "fontweight": "bold"})
        if alone is not None:
            hatched = {"facecolor": "none", "edgecolor": colour, "hatch": "////"}
            text = _bar(ax, row + 0.24, 0.24, contact_shares(alone)[0], hatched, {"fontsize": "small"})
            text.set_text(f"{text.get_text()}, the head alone")
            if contact_shares(alone)[0] > _LONG_BAR:
                # Inside, as there is no room beside it.
                text.set(x=98.0 * contact_shares(alone)[0], ha="right", bbox={"fc": "w", "ec": "none", "pad": 0.5})
    ax.set_yticks(range(len(logs)), [look.label.replace(" with ", "\nwith ") for look in looks.values()])
    ax.set_ylim(len(logs) - 0.4, -0.6)
    # Room for the figure beside a full bar.
    ax.set(xlim=(0, 118), xticks=[0, 25, 50, 75, 100], xlabel="time with eye contact (% of the scored window)")
    ax.spines[["top", "right"]].set_visible(False)


def overview(logs: Logs, path: Path) -> None:
    """Draw the walk from above, the gaze error over time and the eye contact of each controller.

    Args:
        logs: The runs: controller name -> log of the same recording.
        path: Picture to write, 1600 x 900 pixels.
    """
    # Few inches and many dots make letters that still read at half size.
    with readable(_OVERVIEW_WIDTH):
        figure = Figure(figsize=(_OVERVIEW_WIDTH, 6.0), dpi=DPI, layout="constrained")
        rows, heights = ["error", "bars"], [1.0, 0.25 + 0.13 * len(logs)]
        people = _time_lines(logs) if has_attention(logs) else {}
        if people:
            rows, heights = ["people", *rows], [0.06 + 0.09 * len(people), *heights]
        # The right half has the names of the controllers.
        halves = figure.add_gridspec(1, 2, width_ratios=[1.0, 1.3])
        column = halves[1].subgridspec(len(rows), 1, height_ratios=heights)
        axes = {row: figure.add_subplot(column[k]) for k, row in enumerate(rows)}
        axes["walk"] = figure.add_subplot(halves[0])
        beside = draw_birds_eye(axes["walk"], logs, detailed=False)
        axes["walk"].set_title(_walk_title(beside), fontsize="medium")
        heads_alone = draw_gaze_error(axes["error"], logs, detailed=False)
        legend = (
            "; dashed: error of the head alone" if heads_alone else f" (within {CONTACT_DEG[0]:g}°); grey: not scored"
        )
        axes["error"].set_title(f"green: eye contact{legend}", fontsize="medium")
        if people:
            _draw_people(axes["people"], people, axes["error"].get_xlim())
        draw_contact_bars(axes["bars"], logs)
        about = f"{recording_title(logs)}; {setup_title(logs)}"
        if len(about) > _LONGEST_TITLE:
            about = f"{recording_title(logs)}\n{setup_title(logs)}"
        lines = filter(None, (question(logs), about, known_title(logs)))
        figure.suptitle("\n".join(lines))
        figure.savefig(path, dpi=DPI)


def _time_lines(logs: Logs) -> dict[str, Log]:
    """Whose time lines are drawn: one of all gazes where these are alike."""
    if are_alike(logs):
        return {"": next(iter(logs.values()))}
    return {look.label.split(" with ")[0]: logs[name] for name, look in styles(logs).items()}


def _draw_people(ax: Axes, people: dict[str, Log], shown_s: tuple[float, float]) -> None:
    for row, log in enumerate(people.values()):
        draw_turns(ax, log, float(row), 0.9, _LETTERS)
    ax.set_title("attended person; hatched: looks away", fontsize="medium")
    ax.set_yticks(range(len(people)), list(people) if len(people) > 1 else [""] * len(people))
    ax.tick_params(left=False)
    ax.set(xticks=[], xlim=shown_s, ylim=(len(people) - 0.5, -0.5))
    ax.spines[:].set_visible(False)


def _walk_title(beside: tuple[Part, ...]) -> str:
    if not beside:
        return "the walk from above, and where the robot looks"
    lines = (f"{part.line_name}: {part.label.replace(_OF_ROBOT, 'its')}" for part in beside)
    return f"where the robot looks; {', '.join(lines)}"


def _bar(ax: Axes, at: float, height: float, share: float, look: dict[str, Any], font: dict[str, Any]) -> Text:
    percent = 100.0 * share
    ax.barh(at, percent, height=height, **look)
    text = f"{percent:.0f} %" if np.isfinite(percent) else "not known"
    return ax.text(np.nan_to_num(percent) + 1.5, at, text, va="center", **font)
