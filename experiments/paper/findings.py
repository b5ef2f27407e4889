"""The validation as Markdown tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from experiments.pages import markdown
from experiments.paper.published import PUBLISHED, SIGNIFICANCE_LEVEL, VIDEOS_PER_GROUP, PublishedGroup, implied_frames

_RULE_NAMES = {
    "paper": "head against waist (the paper's)",
    "offset removed": "the same, mean yaw so far removed",
    "travel direction": "head against direction of travel",
    "both": "direction of travel, mean yaw removed",
    "waist itself": "control: waist in place of the head, direction of travel",
}


def _table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> list[str]:
    return markdown(head, lines).split("\n")


def _number(value: float | None, digits: int = 0) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _p(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:.3f}" if value >= 1e-3 else f"{value:.2e}"


def _interval(pair: Sequence[float] | None, digits: int = 0) -> str:
    return "" if pair is None else f" [{pair[0]:.{digits}f}, {pair[1]:.{digits}f}]"


def report(summary: Mapping[str, Any]) -> str:
    """All tables of one data set.

    Args:
        summary: As saved in `summary.json`.

    Returns:
        The text.
    """
    settings = summary["settings"]
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
        *_groups_table(summary["groups"]),
        f"w: mean {summary['w_mean']:.3f}, s.d. {summary['w_sd']:.3f} over people left out (exact minimum over all: "
        f"{summary['w_exact_all_subjects']:.3f}); the paper prints 7.51 and 0.36, which w in [0, 1] cannot have.",
        f"Test: Wilcoxon signed-rank, zero_method {summary['test']['zero_method']}, alternative: "
        f"{summary['test']['alternative']}; thinned: every 15th frame only, as frames 33 ms apart are not independent "
        "(median over the 15 ways to begin).",
        "",
        "## The test that is right: one pair a person",
        "",
        *_people_table(summary["people"]),
        f"Exact Wilcoxon; effect: rank-biserial, 1 if the rule helps all people, -1 if none. "
        f"[ ]: 95 % bootstrap over people. Level {SIGNIFICANCE_LEVEL}.",
        "",
        "## The same with each group of routes counting alike in the tuning",
        "",
        *_groups_table(summary["balanced"]["groups"]),
        *_people_table(summary["balanced"]["people"]),
        f"w: mean {summary['balanced']['w_mean']:.3f}, s.d. {summary['balanced']['w_sd']:.3f} (exact minimum over all: "
        f"{summary['balanced']['w_exact_all_subjects']:.3f}).",
        "",
        "## The hypotheses",
        "",
        "By the exact tests over people; in brackets the mean over people of proposed minus baseline.",
        "",
        *_hypotheses_table(summary),
        "## With the paper's w, not tuned",
        "",
        *(line for fixed in summary["published_weights"] for line in _fixed_lines(fixed)),
        "## Other yaws to turn by",
        "",
        "Proposed minus baseline, mm (negative: the rule helps), mean over people.",
        "",
        *_rules_table(summary["rules"]),
        *_yaw_lines(summary["yaw"]),
        "## A slower filter",
        "",
        *_filters_table(summary["filters"]),
        *_nearest_lines(summary),
        "## What the published errors would need",
        "",
        *_turns_table(summary["turns"]),
    ]
    return "\n".join(lines).rstrip() + "\n"


def _groups_table(groups: Sequence[Mapping[str, Any]]) -> list[str]:
    head = ("routes", "videos", "people", "frames", "baseline [mm]", "proposed [mm]", "W", "p", "p thinned")
    return _table(
        head,
        [
            (
                g["group"],
                str(g["n_videos"]),
                str(g["n_people"]),
                str(g["n_frames"]),
                _number(g["baseline_mm"]) + _interval(g["baseline_mm_ci95"]),
                _number(g["proposed_mm"]) + _interval(g["proposed_mm_ci95"]),
                f"{g['wilcoxon_statistic']:,.0f}",
                _p(g["p_value"]),
                _p(g["p_value_thinned"]),
            )
            for g in groups
        ],
    )


def _people_table(people: Sequence[Mapping[str, Any]]) -> list[str]:
    head = ("routes", "people", "proposed - baseline [mm]", "p better", "p worse", "p either", "effect")
    return _table(
        head,
        [
            (
                p["group"],
                str(p["n_people"]),
                _number(p["difference_mm"], 1) + _interval(p["difference_ci95_mm"], 1),
                _p(p["p_better"]),
                _p(p["p_worse"]),
                _p(p["p_two_sided"]),
                _number(p["effect"], 2) + _interval(p["effect_ci95"], 2),
            )
            for p in people
        ],
    )


def _hypotheses_table(summary: Mapping[str, Any]) -> list[str]:
    fixed = summary["published_weights"]
    columns = [summary["hypotheses"], summary["balanced"]["hypotheses"], *(f["hypotheses"] for f in fixed)]
    weights = (f"found, w = {f['weight']:g}" for f in fixed)
    head = ("routes", "claimed", "found, w tuned", "found, w tuned on groups alike", *weights)
    return _table(
        head, [(own[0]["group"], own[0]["claim"], *(h["answer"] for h in own)) for own in zip(*columns, strict=True)]
    )


def _fixed_lines(fixed: Mapping[str, Any]) -> list[str]:
    return [f"w = {fixed['weight']:g}:", "", *_groups_table(fixed["groups"]), *_people_table(fixed["people"])]


def _rules_table(rules: Sequence[Mapping[str, Any]]) -> list[str]:
    groups = list(dict.fromkeys(r["group"] for r in rules))
    lines = []
    for time_s, rule in dict.fromkeys((r["filter_time_s"], r["rule"]) for r in rules):
        own = {r["group"]: r for r in rules if (r["filter_time_s"], r["rule"]) == (time_s, rule)}
        cells = [
            f"{own[g]['difference_mm']:+.1f}{_interval(own[g]['difference_ci95_mm'], 1)}" if g in own else "-"
            for g in groups
        ]
        w_mean = next(iter(own.values()))["w_mean"]
        lines.append((f"{time_s:.2g}", _RULE_NAMES[rule], f"{w_mean:.2f}", *cells))
    return _table(("filter [s]", "yaw", "mean w", *groups), lines)


def _yaw_lines(yaw: Mapping[str, Any]) -> list[str]:
    if not yaw["people"]:
        return []
    angles = sorted(yaw["mean_yaw_deg"])
    correlation = yaw["rank_correlation_of_offset_and_cost"]
    swing = yaw["swing_deg"]
    return [
        f"On straight routes people's heads point {angles[0]:+.1f} to {angles[-1]:+.1f} deg aside of the waist in the "
        f"mean ({len(angles)} people)"
        + (
            "."
            if correlation is None
            else f"; rank correlation of its size with what the rule costs there at w = {yaw['weight']:g}: "
            f"{correlation:.2f}."
        ),
        f"Within a video the yaw has a standard deviation of {_number(swing.get('paper'), 1)} deg against the waist"
        f" and {_number(swing.get('travel direction'), 1)} deg against the filter's direction of travel (medians).",
        "",
    ]


def _filters_table(filters: Sequence[Mapping[str, Any]]) -> list[str]:
    near = [r for r in filters if r["horizon_s"] == min(f["horizon_s"] for f in filters)]
    groups = list(dict.fromkeys(r["group"] for r in near))
    lines = []
    for against, time_s in dict.fromkeys((r["against"], r["filter_time_s"]) for r in near):
        own = {r["group"]: r for r in near if (r["against"], r["filter_time_s"]) == (against, time_s)}
        cells = [f"{own[g]['baseline_mm']:.0f} -> {own[g]['error_at_weight_mm']:.0f}" for g in groups]
        lines.append((against, f"{time_s:.2g}", *cells, f"{own[groups[0]]['weight']:.2f}"))
    published = {p.group: f"{p.baseline_mm:.0f} -> {p.proposed_mm:.0f}" for p in PUBLISHED}
    lines.append(("published", "?", *(published[g] for g in groups), "?"))
    return _table(
        ("error against", "filter's time constant [s]", *(f"{g} [mm]" for g in groups), "best w, all frames"), lines
    )


def _nearest_lines(summary: Mapping[str, Any]) -> list[str]:
    lines = []
    for n in summary["nearest"]:
        lines += [
            f"Nearest to the published baselines, error against the {n['against']} position: time constant "
            f"{n['filter_time_s']:g} s (root mean square of the log ratios {n['misfit']:.2f}); validated with it:",
            "",
            *_groups_table(n["groups"]),
            *_people_table(n["people"]),
            f"w: mean {n['w_mean']:.3f}, s.d. {n['w_sd']:.3f}.",
            "",
        ]
    lines += [
        "If the tracker had delivered 15 frames a second, 15 steps would be 1 s. Nearest to the published baselines "
        "then:",
        "",
    ]
    groups = [g["group"] for g in summary["groups"]]
    return lines + _table(
        ("error against", "filter [s]", *(f"{g} [mm]" for g in groups), "w", "misfit"),
        [
            (
                n["against"],
                f"{n['filter_time_s']:g}",
                *(
                    f"{n['baseline_mm'][g]:.0f} -> {n['proposed_mm'][g]:.0f}" if g in n["baseline_mm"] else "-"
                    for g in groups
                ),
                f"{n['weight']:.2f}",
                f"{n['misfit']:.2f}",
            )
            for n in summary["nearest_at_one_second"]
        ],
    )


def _turns_table(turns: Sequence[Mapping[str, Any]]) -> list[str]:
    head = (
        "routes",
        "median speed [m/s]",
        "turn in 0.5 s: median [deg]",
        "95th percentile [deg]",
        "published error [mm]",
        "turn in 0.5 s that it needs at every frame [deg]",
    )
    return _table(
        head,
        [
            (
                t["group"],
                _number(t["speed_m_s"], 2),
                _number(t["turn_median_deg"]),
                _number(t["turn_p95_deg"]),
                _number(t["published_mm"]),
                "none is enough" if t["turn_needed_deg"] is None else _number(t["turn_needed_deg"]),
            )
            for t in turns
        ],
    )


def side_by_side(summaries: Mapping[str, Mapping[str, Any]]) -> str:
    """Every number that the paper prints, beside ours on each data set.

    Args:
        summaries: Summary of each data set by its name.

    Returns:
        Markdown.
    """
    own = {name: {g["group"]: g for g in s["groups"]} for name, s in summaries.items()}
    lines: list[tuple[str, ...]] = []
    for p in PUBLISHED:
        for what, printed in _printed(p).items():
            cells = (_own(what, groups[p.group]) if p.group in groups else "-" for groups in own.values())
            lines.append((f"{p.group} {what}", printed, *cells))
    lines.append(("w, mean", "7.51", *(f"{s['w_mean']:.2f}" for s in summaries.values())))
    lines.append(("w, s.d.", "0.36", *(f"{s['w_sd']:.2f}" for s in summaries.values())))
    kinds = [f"{name} ({', '.join(s['kinds'])})" for name, s in summaries.items()]
    return "\n".join(["# Side by side", "", *_table(("", "published", *kinds), lines)])


def _printed(p: PublishedGroup) -> dict[str, str]:
    """What the paper prints for a group, or what follows from it."""
    implied = implied_frames(p)
    at_least = "" if implied.most else "at least "
    return {
        "baseline [mm]": f"{p.baseline_mm:.0f}",
        "proposed [mm]": f"{p.proposed_mm:.0f}",
        "Wilcoxon statistic": f"{p.statistic:,.0f}",
        "p": f"{p.p_value:.2e}" if p.p_value < 1.0 else "1.0",
        "frames": f"{at_least}{implied.fewest} (implied)",
        "frames a video": f"{at_least}{implied.per_video:.0f} (of {VIDEOS_PER_GROUP})",
        "p, every 15th frame": f"{_p(implied.thinned_p_value)} (implied)" if implied.most else "-",
    }


def _own(what: str, group: Mapping[str, Any]) -> str:
    texts = {
        "baseline [mm]": _number(group["baseline_mm"]),
        "proposed [mm]": _number(group["proposed_mm"]),
        "Wilcoxon statistic": f"{group['wilcoxon_statistic']:,.0f}",
        "p": _p(group["p_value"]),
        "frames": str(group["n_frames"]),
        "frames a video": f"{group['n_frames'] / group['n_videos']:.0f} (of {group['n_videos']})",
        "p, every 15th frame": _p(group["p_value_thinned"]),
    }
    return texts[what]
