"""The validation as Markdown tables, and plots of the mean errors by group."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from experiments.pages import table_of, with_ends
from experiments.paper.published import PUBLISHED, SIGNIFICANCE_LEVEL, VIDEOS_PER_GROUP, PublishedGroup, implied_frames
from experiments.plots import Line, Plot
from gazempc.results.figures.style import COLOURS

_RULE_NAMES = {
    "paper": "head against waist (the paper's)",
    "offset removed": "the same, running mean of the yaw removed",
    "travel direction": "head against direction of travel",
    "both": "direction of travel, mean yaw removed",
    "waist itself": "control: waist in place of the head, direction of travel",
}
_Row = Mapping[str, Any]
_Columns = Mapping[str, Callable[[_Row], str]]


def _of(columns: _Columns, rows: Iterable[_Row]) -> list[str]:
    return [*table_of("", rows, columns).markdown(), ""]


def _p(value: float | None) -> str:
    return with_ends(value, None, ".3f" if value is None or value >= 1e-3 else ".2e")


def _change(r: _Row, name: str, form: str = ".0f") -> str:
    return with_ends(r[name], r[f"{name}_ci95"], form)


_GROUPS: _Columns = {
    "routes": lambda g: g["group"],
    "videos": lambda g: str(g["n_videos"]),
    "people": lambda g: str(g["n_people"]),
    "frames": lambda g: str(g["n_frames"]),
    "baseline [mm]": lambda g: _change(g, "baseline_mm"),
    "proposed [mm]": lambda g: _change(g, "proposed_mm"),
    "W": lambda g: f"{g['wilcoxon_statistic']:,.0f}",
    "p": lambda g: _p(g["p_value"]),
    "p thinned": lambda g: _p(g["p_value_thinned"]),
}
_PEOPLE: _Columns = {
    "routes": lambda p: p["group"],
    "people": lambda p: str(p["n_people"]),
    "proposed - baseline [mm]": lambda p: with_ends(p["difference_mm"], p["difference_ci95_mm"], ".1f"),
    "p better": lambda p: _p(p["p_better"]),
    "p worse": lambda p: _p(p["p_worse"]),
    "p either": lambda p: _p(p["p_two_sided"]),
    "effect": lambda p: _change(p, "effect", ".2f"),
}
_TURNS: _Columns = {
    "routes": lambda t: t["group"],
    "median speed [m/s]": lambda t: f"{t['speed_m_s']:.2f}",
    "turn in 0.5 s: median [deg]": lambda t: f"{t['turn_median_deg']:.0f}",
    "95th percentile [deg]": lambda t: f"{t['turn_p95_deg']:.0f}",
    "published error [mm]": lambda t: f"{t['published_mm']:.0f}",
    "constant turn in 0.5 s with this error [deg]": lambda t: with_ends(t["turn_needed_deg"], None, ".0f"),
}


def report(summary: _Row) -> str:
    """All tables of one data set.

    Args:
        summary: Content of `summary.json`.

    Returns:
        The text.
    """
    settings, balanced = summary["settings"], summary["balanced"]
    left = [f"{len(summary[k])} {k.replace('_', ' ')}" for k in ("left_out", "failed", "without_group") if summary[k]]
    n = sum(g["n_videos"] for g in summary["groups"])
    lines = [
        f"# Tamaru et al. 2021, section V, on {summary['data']}",
        "",
        f"{n} of {summary['n_recordings']} recordings ({', '.join(summary['kinds'])})"
        + (f"; {', '.join(left)}" if left else "")
        + f". Kalman filter with a time constant of {settings['filter_time_s']:.2g} s, forecast 0.5 s (15 steps) ahead,"
        " error against the filtered position, every frame within 0.5 to 5.46 m. w is tuned on the other people "
        f"(Optuna, {settings['trials']} trials).",
        "",
        "## Mean errors, and the paper's test over frames",
        "",
        *_of(_GROUPS, summary["groups"]),
        f"w: mean {summary['w_mean']:.3f}, s.d. {summary['w_sd']:.3f} over people left out (exact minimum over all: "
        f"{summary['w_exact_all_subjects']:.3f}); the paper prints 7.51 and 0.36, which w in [0, 1] cannot have.",
        f"Test: Wilcoxon signed-rank, zero_method {summary['test']['zero_method']}, alternative: "
        f"{summary['test']['alternative']}; thinned: every 15th frame only, as frames 33 ms apart are not independent "
        "(median over the 15 offsets).",
        "",
        "## Test over people: one pair per person",
        "",
        *_of(_PEOPLE, summary["people"]),
        f"Exact Wilcoxon; effect: rank-biserial, 1 if all people have smaller errors, -1 if none. "
        f"[ ]: 95 % bootstrap over people. Level {SIGNIFICANCE_LEVEL}.",
        "",
        "## The same with equal weights of the groups of routes in the tuning",
        "",
        *_of(_PEOPLE, balanced["people"]),
        f"w: mean {balanced['w_mean']:.3f}, s.d. {balanced['w_sd']:.3f} (exact minimum over all: "
        f"{balanced['w_exact_all_subjects']:.3f}).",
        "",
        "## With the paper's w, not tuned",
        "",
    ]
    for fixed in summary["published_weights"]:
        lines += [f"w = {fixed['weight']:g}:", "", *_of(_PEOPLE, fixed["people"])]
    lines += [
        "## Other definitions of the yaw",
        "",
        "Proposed minus baseline, mm (negative: smaller error), mean over people.",
        "",
        *_rules_table(summary),
        *_yaw_lines(summary["yaw"]),
        "## A slower filter",
        "",
        *_filters_table(summary),
        "At a tracker rate of 15 Hz, 15 steps would be 1 s. Best fit to the published baselines then:",
        "",
        *_one_second_table(summary),
        "## Turns that would explain the published errors",
        "",
        *_of(_TURNS, summary["turns"]),
    ]
    return "\n".join(lines).rstrip() + "\n"


def _rules_table(summary: _Row) -> list[str]:
    own = {(r["filter_time_s"], r["rule"], r["group"]): r for r in summary["rules"]}

    def difference(group: str, key: tuple[float, str]) -> str:
        r = own.get((*key, group))
        return "-" if r is None else with_ends(r["difference_mm"], r["difference_ci95_mm"], "+.1f")

    columns: dict[str, Callable[[tuple[float, str]], str]] = {
        "filter [s]": lambda key: f"{key[0]:.2g}",
        "yaw": lambda key: _RULE_NAMES[key[1]],
        "mean w": lambda key: next(f"{r['w_mean']:.2f}" for k, r in own.items() if k[:2] == key),
    }
    groups = dict.fromkeys(group for *_, group in own)
    columns |= {group: partial(difference, group) for group in groups}
    return [*table_of("", dict.fromkeys(key[:2] for key in own), columns).markdown(), ""]


def _yaw_lines(yaw: _Row) -> list[str]:
    if not yaw["people"]:
        return []
    angles, correlation = sorted(yaw["mean_yaw_deg"]), yaw["rank_correlation_of_offset_and_cost"]
    return [
        f"On straight routes heads point {angles[0]:+.1f} to {angles[-1]:+.1f} deg relative to the waist in the "
        f"mean ({len(angles)} people); rank correlation of its size with the rule's cost at w = "
        f"{yaw['weight']:g}: {with_ends(correlation, None, '.2f')}.",
        "",
    ]


def _filters_table(summary: _Row) -> list[str]:
    rows = [r for r in summary["filters"] if r["horizon_s"] == min(f["horizon_s"] for f in summary["filters"])]
    lines: dict[tuple[str, str], dict[str, str]] = {}
    for r in rows:
        line = lines.setdefault((r["against"], f"{r['filter_time_s']:.2g}"), {})
        line |= {r["group"]: f"{r['baseline_mm']:.0f} -> {r['error_at_weight_mm']:.0f}", "w": f"{r['weight']:.2f}"}
    lines["published", "?"] = {p.group: f"{p.baseline_mm:.0f} -> {p.proposed_mm:.0f}" for p in PUBLISHED} | {"w": "?"}
    columns: dict[str, Callable[[tuple[str, str]], str]] = {
        "error against": lambda key: key[0],
        "filter's time constant [s]": lambda key: key[1],
        **{f"{g} [mm]": lambda key, g=g: lines[key][g] for g in dict.fromkeys(r["group"] for r in rows)},  # type: ignore[misc]
        "best w, all frames": lambda key: lines[key]["w"],
    }
    return [*table_of("", lines, columns).markdown(), ""]


def _one_second_table(summary: _Row) -> list[str]:
    def errors(group: str, n: _Row) -> str:
        known = group in n["baseline_mm"]
        return f"{n['baseline_mm'][group]:.0f} -> {n['proposed_mm'][group]:.0f}" if known else "-"

    columns: _Columns = {
        "error against": lambda n: n["against"],
        "filter [s]": lambda n: f"{n['filter_time_s']:g}",
        **{f"{g['group']} [mm]": partial(errors, g["group"]) for g in summary["groups"]},
        "w": lambda n: f"{n['weight']:.2f}",
        "misfit": lambda n: f"{n['misfit']:.2f}",
    }
    return _of(columns, summary["nearest_at_one_second"])


def side_by_side(summaries: Mapping[str, _Row]) -> str:
    """All published numbers beside the reproduced ones on each data set.

    Args:
        summaries: Summary of each data set by its name.

    Returns:
        Markdown.
    """
    own = [{g["group"]: g for g in s["groups"]} for s in summaries.values()]
    lines: list[tuple[str, ...]] = []
    for p in PUBLISHED:
        for what, (printed, ours) in _beside(p).items():
            cells = (ours(groups[p.group]) if p.group in groups else "-" for groups in own)
            lines.append((f"{p.group} {what}", printed, *cells))
    lines.append(("w, mean", "7.51", *(f"{s['w_mean']:.2f}" for s in summaries.values())))
    lines.append(("w, s.d.", "0.36", *(f"{s['w_sd']:.2f}" for s in summaries.values())))
    kinds = [f"{name} ({', '.join(s['kinds'])})" for name, s in summaries.items()]
    columns = {name: partial(lambda i, line: line[i], i) for i, name in enumerate(("", "published", *kinds))}
    return "\n".join(["# Side by side", "", *table_of("", lines, columns).markdown(), ""])


def _beside(p: PublishedGroup) -> dict[str, tuple[str, Callable[[_Row], str]]]:
    """Published or derived value of each quantity of a group, and the format function of the reproduced one."""
    implied = implied_frames(p)
    at_least = "" if implied.most else "at least "
    return {
        "baseline [mm]": (f"{p.baseline_mm:.0f}", lambda g: f"{g['baseline_mm']:.0f}"),
        "proposed [mm]": (f"{p.proposed_mm:.0f}", lambda g: f"{g['proposed_mm']:.0f}"),
        "Wilcoxon statistic": (f"{p.statistic:,.0f}", _GROUPS["W"]),
        "p": (f"{p.p_value:.2e}" if p.p_value < 1.0 else "1.0", _GROUPS["p"]),
        "frames": (f"{at_least}{implied.fewest} (implied)", _GROUPS["frames"]),
        "frames per video": (
            f"{at_least}{implied.per_video:.0f} (of {VIDEOS_PER_GROUP})",
            lambda g: f"{g['n_frames'] / g['n_videos']:.0f} (of {g['n_videos']})",
        ),
        "p, every 15th frame": (
            f"{_p(implied.thinned_p_value)} (implied)" if implied.most else "-",
            _GROUPS["p thinned"],
        ),
    }


def error_plots(summary: _Row) -> list[Plot]:
    """Mean error by group and method: published, with the validation's filter (two w), and with a slow filter.

    Args:
        summary: As saved in `summary.json`.
    """
    groups = tuple(g["group"] for g in summary["groups"])
    nearest = next(n for n in summary["nearest"] if n["against"] == "true")
    fixed = summary["published_weights"][0]
    quick = f"filter of {summary['settings']['filter_time_s']:.2g} s, own positions"
    slow = f"filter of {nearest['filter_time_s']:.2g} s, true positions"
    panels: dict[str, Sequence[_Row]] = {
        "published": [vars(p) for p in PUBLISHED if p.group in groups],
        f"{quick},\nw tuned (mean {summary['w_mean']:.2f})": summary["groups"],
        f"{quick},\nw = {fixed['weight']:g}": fixed["groups"],
        f"{slow},\nw tuned (mean {nearest['w_mean']:.2f})": nearest["groups"],
    }
    methods = {"baseline_mm": "baseline (Kalman)", "proposed_mm": "proposed (head pose)"}
    plots = []
    for title, rows in panels.items():
        lines = []
        for (name, label), colour in zip(methods.items(), COLOURS, strict=False):
            ends = np.array([row.get(f"{name}_ci95") or (np.nan, np.nan) for row in rows])
            errors_mm = np.array([row[name] for row in rows])
            lines.append(Line(label, colour, np.arange(len(rows), dtype=np.float64), errors_mm, ends=ends))
        plots.append(Plot(title, "routes", "mean error 0.5 s ahead (mm)", tuple(lines), ticks=groups))
    return plots
