"""The validation of the paper's forecasts: all that the command prints, draws and saves, as plain data."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from scipy.stats import spearmanr
from tqdm import tqdm

from experiments.aggregate import bootstrap_mean
from experiments.paper.filters import AGAINST, SLOW_TIME_S, Rows, closest_time_s, mean_mm, misfit, nearest_at, sweep
from experiments.paper.frames import HORIZONS_S, RULES, Frames, frames_of
from experiments.paper.published import (
    PUBLISHED,
    SIGNIFICANCE_LEVEL,
    W_MEAN,
    W_READINGS,
    W_SD,
    implied_frames,
)
from experiments.paper.turns import turns_needed
from experiments.paper.validation import (
    ALTERNATIVE,
    ZERO_METHOD,
    Judged,
    PersonTest,
    as_row,
    exact_weight,
    frame_test,
    leave_one_subject_out,
    person_test,
)
from gazempc.types import FloatArray

TURNING = ("R34", "R56")
YAW_WEIGHT = W_READINGS[1]
# Tuning hardly ever ends at exactly 0; a rule that is switched off to this is no worse than none.
_NEGLIGIBLE_MM = 0.1


def analyse(rows_by_time: Mapping[float, Rows], filter_time_s: float, seed: int, trials: int) -> dict[str, Any]:
    """Validate the two forecasts as the paper does, and look for what makes its figures.

    Args:
        rows_by_time: For each time constant of the filter the rows of `experiments.paper.frames.labelled`.
        filter_time_s: The filter of the validation; one of the keys.
        seed: Seed of the tuning.
        trials: Optuna's trials for each subject left out.

    Returns:
        Plain data, ready to be saved.

    Raises:
        GazempcError: If there are fewer than two subjects.
    """
    table = sweep(rows_by_time)
    smooth = {against: closest_time_s(table, against) for against in AGAINST}
    ways = [("filtered", filter_time_s), *smooth.items()]
    rule_times_s = tuple(dict.fromkeys((filter_time_s, SLOW_TIME_S)))
    total = len(ways) + 1 + len(rule_times_s) * len(RULES)
    bar = tqdm(total=total, unit="validation", file=sys.stderr, mininterval=1.0)

    def validate(videos: Sequence[Frames], balanced: bool = False) -> list[Judged]:
        judged = leave_one_subject_out(videos, seed, trials, balanced)
        bar.update()
        return judged

    main, *others = [(a, t, validate(frames_of(rows_by_time[t], a))) for a, t in ways]
    rules = [
        (time_s, rule, validate(frames_of(rows_by_time[time_s], rule=rule)))
        for time_s in rule_times_s
        for rule in RULES
    ]
    videos = frames_of(rows_by_time[filter_time_s])
    balanced = validate(videos, balanced=True)
    bar.close()
    return {
        **_validated(main[2]),
        "w_exact_all_subjects": exact_weight(videos),
        "test": {"zero_method": ZERO_METHOD, "alternative": f"baseline {ALTERNATIVE}", "level": SIGNIFICANCE_LEVEL},
        "balanced": {**_validated(balanced), "w_exact_all_subjects": exact_weight(videos, balanced=True)},
        "published_weights": [{"weight": w, **_validated(_with_weight(videos, w))} for w in W_READINGS],
        "rules": [row for time_s, rule, own in rules for row in _rule_rows(time_s, rule, own)],
        "yaw": _yaw(rows_by_time[filter_time_s]),
        "published": {
            "groups": [{**asdict(p), "implied_frames": _without_nan(asdict(implied_frames(p)))} for p in PUBLISHED],
            "w_mean": W_MEAN,
            "w_sd": W_SD,
        },
        "filters": [asdict(row) for row in table],
        "nearest": [
            {
                "against": against,
                "filter_time_s": time_s,
                "misfit": misfit(table, time_s, against),
                **_validated(own),
            }
            for against, time_s, own in others
        ],
        "nearest_at_one_second": nearest_at(table, HORIZONS_S[1]),
        "turns": turns_needed(rows_by_time[filter_time_s]),
    }


def _validated(judged: Sequence[Judged]) -> dict[str, Any]:
    """Means over frames, the tests over people, the answers to the hypotheses, and the weights."""
    people = _person_tests(judged)
    return {
        "groups": _groups(judged),
        **_weights(judged),
        "people": [{"group": group, **as_row(test)} for group, test in people.items()],
        "hypotheses": _hypotheses(people),
    }


def _groups(judged: Sequence[Judged]) -> list[dict[str, Any]]:
    rows = []
    for published in PUBLISHED:
        own = [j for j in judged if j.group == published.group]
        if not own:
            continue
        test = frame_test(own)
        people = [j.subject for j in own for _ in j.baseline_mm]
        row: dict[str, Any] = {"group": published.group, "n_videos": len(own), "n_people": len(set(people))}
        for name in ("baseline_mm", "proposed_mm"):
            # As in the paper every frame weighs the same; people are the independent draws.
            row[name], low, high = bootstrap_mean(np.concatenate([getattr(j, name) for j in own]).tolist(), people)
            row[f"{name}_ci95"] = [low, high] if np.isfinite(low) else None
        as_dict = as_row(test)
        rows.append({**row, "wilcoxon_statistic": as_dict.pop("statistic"), **as_dict})
    return rows


def _weights(judged: Sequence[Judged]) -> dict[str, Any]:
    weights = {j.subject: j.weight for j in judged}
    values = np.array(list(weights.values()))
    return {"w_mean": float(values.mean()), "w_sd": float(values.std(ddof=1)), "weights": weights}


def _person_tests(judged: Sequence[Judged]) -> dict[str, PersonTest]:
    pools = {p.group: (p.group,) for p in PUBLISHED} | {"R34+R56": TURNING}
    chosen = {name: [j for j in judged if j.group in groups] for name, groups in pools.items()}
    return {name: person_test(own) for name, own in chosen.items() if own}


def _hypotheses(people: Mapping[str, PersonTest]) -> list[dict[str, str]]:
    """The paper's two hypotheses, answered by the exact tests over people."""
    answers = []
    for group, claim in (
        ("R34", "better"),
        ("R56", "better"),
        ("R34+R56", "better"),
        ("R12", "no different"),
    ):
        test = people.get(group)
        if test is None:
            continue
        if abs(test.difference_mm) < _NEGLIGIBLE_MM:
            answer = "no different"
        elif test.smallest_p > SIGNIFICANCE_LEVEL:
            answer = f"undecided: the smallest p value of so few people ({test.n_people}) is {test.smallest_p:.2g}"
        elif claim == "better" and test.p_better < SIGNIFICANCE_LEVEL:
            answer = "better"
        elif test.p_two_sided < SIGNIFICANCE_LEVEL:
            # What was not claimed is asked with both tails.
            answer = "worse" if test.difference_mm > 0.0 else "better"
        else:
            answer = "no difference found"
        change = f"{test.difference_mm:+.1f} mm"
        answers.append({"group": group, "claim": claim, "answer": f"{answer} ({change})"})
    return answers


def _with_weight(videos: Sequence[Frames], weight: float) -> list[Judged]:
    """The rule as it would be used with a weight from the paper, without tuning."""
    return [Judged(v.recording, v.subject, v.group, weight, v.error_mm(0.0), v.error_mm(weight)) for v in videos]


def _rule_rows(time_s: float, rule: str, judged: Sequence[Judged]) -> list[dict[str, Any]]:
    return [
        {
            "filter_time_s": time_s,
            "rule": rule,
            "group": group,
            "w_mean": _weights(judged)["w_mean"],
            **as_row(test),
        }
        for group, test in _person_tests(judged).items()
    ]


def _yaw(rows: Rows) -> dict[str, Any]:
    """How far and how steadily people's heads point aside on straight routes, and what that costs with w = 0.5."""
    straight = {rule: [v for v in frames_of(rows, rule=rule) if v.group == "R12"] for rule in RULES}
    people = sorted({v.subject for v in straight["paper"]})
    offset_deg, cost_mm = [], []
    for person in people.copy():
        own = [v for v in straight["paper"] if v.subject == person]
        yaw_deg = _known(np.concatenate([v.yaw_deg for v in own]))
        if not yaw_deg.size:
            people.remove(person)
            continue
        offset_deg.append(float(yaw_deg.mean()))
        cost_mm.append(mean_mm(own, YAW_WEIGHT) - mean_mm(own, 0.0))
    several = len(people) > 2
    return {
        "weight": YAW_WEIGHT,
        "people": people,
        "mean_yaw_deg": offset_deg,
        "cost_mm": cost_mm,
        "rank_correlation_of_offset_and_cost": float(spearmanr(np.abs(offset_deg), cost_mm).statistic)
        if several
        else None,
        # Within a video: what is left is the swing of gait, wander and noise.
        "swing_deg": {
            rule: float(np.median(spread))
            for rule, own in straight.items()
            if (spread := [_known(v.yaw_deg).std() for v in own if _known(v.yaw_deg).size])
        },
    }


def _known(values: FloatArray) -> FloatArray:
    return values[np.isfinite(values)]


def _without_nan(figures: dict[str, Any]) -> dict[str, Any]:
    return {k: None if isinstance(v, float) and np.isnan(v) else v for k, v in figures.items()}
