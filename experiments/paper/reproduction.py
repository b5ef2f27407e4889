"""Reproduce the paper's validation: `python -m experiments.paper --recordings synthetic`.

`analyse` returns all results that the command prints, draws and saves, as plain data.
"""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field
from scipy.stats import spearmanr
from tqdm import tqdm

from experiments.aggregate import with_interval
from experiments.engine.command import Command, WorkSettings, check_optuna, exit_status, find_recordings, in_place
from experiments.engine.engine import Engine
from experiments.engine.job import Row
from experiments.paper import filters, validation
from experiments.paper.filters import TUNED_TIME_S, Rows, mean_mm
from experiments.paper.findings import error_plots, report, side_by_side
from experiments.paper.frames import GROUPS, HORIZONS_S, RULES, FrameJob, frames_of, labelled
from experiments.paper.published import PUBLISHED, SIGNIFICANCE_LEVEL, W_MEAN, W_READINGS, W_SD, implied_frames
from experiments.paper.validation import ALTERNATIVE, ZERO_METHOD, Judged, exact_weight, frame_test, person_test
from experiments.plots import draw
from gazempc.errors import GazempcError
from gazempc.files.whole import write_whole
from gazempc.results.contact import of_known
from gazempc.results.run_summary import versions, without_nan

TURNING = ("R34", "R56")
YAW_WEIGHT = W_READINGS[1]


def analyse(rows_by_time: Mapping[float, Rows], filter_time_s: float, seed: int, trials: int) -> dict[str, Any]:
    """Validate the two forecasts by the paper's method, and search for causes of its errors.

    Args:
        rows_by_time: Rows of `experiments.paper.frames.labelled` by time constant of the filter.
        filter_time_s: Time constant of the validation; one of the keys.
        seed: Seed of the tuning.
        trials: Optuna trials for each subject left out.

    Returns:
        JSON-serialisable values.

    Raises:
        GazempcError: If there are fewer than two subjects.
    """
    table = filters.sweep(rows_by_time)
    smooth = {against: filters.closest_time_s(table, against) for against in filters.AGAINST}
    ways = [("filtered", filter_time_s), *smooth.items()]
    ruled = [(time_s, rule) for time_s in dict.fromkeys((filter_time_s, filters.SLOW_TIME_S)) for rule in RULES]
    videos = frames_of(rows_by_time[filter_time_s])
    sets = [(frames_of(rows_by_time[time_s], against), False) for against, time_s in ways]
    sets += [(frames_of(rows_by_time[time_s], rule=rule), False) for time_s, rule in ruled] + [(videos, True)]
    main, *judged, balanced = (
        validation.leave_one_subject_out(frames, seed, trials, equally)
        for frames, equally in tqdm(sets, unit="validation", file=sys.stderr, mininterval=1.0)
    )
    others = [(*way, own) for way, own in zip(ways[1:], judged, strict=False)]
    rules = [(*key, own) for key, own in zip(ruled, judged[len(others) :], strict=True)]
    return {
        **_validated(main),
        "w_exact_all_subjects": exact_weight(videos),
        "test": {"zero_method": ZERO_METHOD, "alternative": f"baseline {ALTERNATIVE}", "level": SIGNIFICANCE_LEVEL},
        "balanced": {**_validated(balanced), "w_exact_all_subjects": exact_weight(videos, balanced=True)},
        "published_weights": [
            {"weight": w, **_validated([validation.judge(video, w) for video in videos])} for w in W_READINGS
        ],
        "rules": [
            {"filter_time_s": time_s, "rule": rule, "w_mean": _weights(own)["w_mean"], **row}
            for time_s, rule, own in rules
            for row in _person_tests(own)
        ],
        "yaw": _yaw(rows_by_time[filter_time_s]),
        "published": {
            "groups": [{**asdict(p), "implied_frames": without_nan(asdict(implied_frames(p)))} for p in PUBLISHED],
            "w_mean": W_MEAN,
            "w_sd": W_SD,
        },
        "filters": table,
        "nearest": [
            {"against": against, "filter_time_s": t, "misfit": filters.misfit(table, t, against), **_validated(own)}
            for against, t, own in others
        ],
        "nearest_at_one_second": filters.nearest_at(table, HORIZONS_S[1]),
        "turns": filters.turns_needed(rows_by_time[filter_time_s]),
    }


def _validated(judged: Sequence[Judged]) -> dict[str, Any]:
    """Means over frames, tests over people, and weights."""
    return {"groups": _groups(judged), **_weights(judged), "people": _person_tests(judged)}


def _groups(judged: Sequence[Judged]) -> list[dict[str, Any]]:
    rows = []
    for published in PUBLISHED:
        own = [j for j in judged if j.group == published.group]
        if not own:
            continue
        people = [j.subject for j in own for _ in j.baseline_mm]
        row: dict[str, Any] = {"group": published.group, "n_videos": len(own), "n_people": len(set(people))}
        for name in ("baseline_mm", "proposed_mm"):
            # Frames have equal weight, as in the paper; the bootstrap resamples people.
            row |= with_interval(name, np.concatenate([getattr(j, name) for j in own]).tolist(), people)
        test = frame_test(own)
        rows.append({**row, "wilcoxon_statistic": test.pop("statistic"), **test})
    return rows


def _weights(judged: Sequence[Judged]) -> dict[str, Any]:
    weights = {j.subject: j.weight for j in judged}
    values = np.array(list(weights.values()))
    return {"w_mean": float(values.mean()), "w_sd": float(values.std(ddof=1)), "weights": weights}


def _person_tests(judged: Sequence[Judged]) -> list[dict[str, Any]]:
    pools = {p.group: (p.group,) for p in PUBLISHED} | {"R34+R56": TURNING}
    chosen = {name: [j for j in judged if j.group in groups] for name, groups in pools.items()}
    return [{"group": name, **person_test(own)} for name, own in chosen.items() if own]


def _yaw(rows: Rows) -> dict[str, Any]:
    """Offset of the head's yaw on straight routes, and its effect on the error with w = 0.5."""
    straight = [v for v in frames_of(rows) if v.group == "R12"]
    people, offset_deg, cost_mm = [], [], []
    for person in sorted({v.subject for v in straight}):
        own = [v for v in straight if v.subject == person]
        yaw_deg = of_known(np.concatenate([v.yaw_deg for v in own]))
        if np.isfinite(yaw_deg):
            people.append(person)
            offset_deg.append(yaw_deg)
            cost_mm.append(mean_mm(own, YAW_WEIGHT) - mean_mm(own, 0.0))
    correlation = spearmanr(np.abs(offset_deg), cost_mm).statistic if len(people) > 2 else None
    return {
        "weight": YAW_WEIGHT,
        "people": people,
        "mean_yaw_deg": offset_deg,
        "cost_mm": cost_mm,
        "rank_correlation_of_offset_and_cost": None if correlation is None else float(correlation),
    }


class PaperSettings(WorkSettings):
    """Settings of `python -m experiments.paper`."""

    recordings: tuple[str, ...] = Field(
        default=("synthetic",),
        min_length=1,
        description="'synthetic' (14 x 6) or a folder; each is a separate data set",
    )
    filter_time_s: float = Field(
        default=TUNED_TIME_S, ge=0.02, le=10, description="Time constant of the Kalman filter of the validation"
    )
    trials: int = Field(default=60, ge=1, description="Optuna's trials per left-out subject")
    seed: int = Field(default=0, ge=0, description="Seed of Optuna's sampler and of the sensor's noise")
    out: Path = Field(default=Path("out/paper"), description="Output folder; an interrupted run resumes from it")


def _run(settings: PaperSettings, _: str) -> int:
    summaries = _validate(settings)
    print(f"Written to {settings.out}/")
    return exit_status(False, any(s["failed"] for s in summaries.values()))


def _validate(settings: PaperSettings) -> dict[str, Row]:
    check_optuna("Tuning w")
    found = {word: find_recordings([word]) for word in settings.recordings}
    names = _folder_names(settings.recordings)
    settings.out.mkdir(parents=True, exist_ok=True)
    summaries = {}
    for word, recordings in found.items():
        folder = settings.out / names[word] if len(found) > 1 else settings.out
        summaries[names[word]] = _data_set(word, recordings, folder, settings)
    if len(summaries) > 1:
        text = side_by_side(summaries)
        write_whole(settings.out / "side_by_side.md", text)
        print(text)
    return summaries


def _folder_names(words: Sequence[str]) -> dict[str, str]:
    """A distinct short name for each data set."""
    stems = {word: Path(word).resolve().name if word != "synthetic" else word for word in words}
    counts = Counter(stems.values())
    return {w: s if counts[s] == 1 else f"{s}_{i}" for i, (w, s) in enumerate(stems.items())}


def _data_set(word: str, recordings: Sequence[str], folder: Path, settings: PaperSettings) -> dict[str, Any]:
    started = time.monotonic()
    folder.mkdir(parents=True, exist_ok=True)
    rows_by_time = _rows(recordings, folder, settings)
    first = rows_by_time[settings.filter_time_s]
    failed = {r["source"]: r["failed"] for r in first if r["failed"]}
    left_out = {r["source"]: r["left_out"] for r in first if r["left_out"]}
    if not frames_of(first):
        raise GazempcError(
            f"{word}: no recording can be scored; required: group straight, turn or sharp, and more than half a second "
            f"within the sensor's range"
            + "".join(f"\n{source}: {why}" for source, why in {**failed, **left_out}.items())
        )
    summary = {
        "data": word,
        "kinds": sorted({r["kind"] for r in first if r["kind"]}),
        "n_recordings": len(recordings),
        "without_group": [r["source"] for r in first if not r["failed"] and r["group"] not in GROUPS],
        "left_out": left_out,
        "failed": failed,
        **analyse(rows_by_time, settings.filter_time_s, settings.seed, settings.trials),
        "settings": settings.saved(),
        "versions": versions(),
    }
    write_whole(folder / "summary.json", json.dumps(summary, indent=1) + "\n")
    text = report(summary)
    write_whole(folder / "summary.md", text)
    draw(error_plots(summary), folder / "error_bars.png", f"{word}; 95 % intervals over people")
    print(text)
    print(f"{word}: {time.monotonic() - started:.0f} s; tables and figures in {folder}/\n")
    return summary


def _rows(recordings: Sequence[str], folder: Path, settings: PaperSettings) -> dict[float, list[dict[str, Any]]]:
    times_s = sorted({*filters.FILTER_TIMES_S, settings.filter_time_s})
    with_all_rules = {settings.filter_time_s, filters.SLOW_TIME_S}
    # Ordered by recording: a worker reads each file once.
    requests = [(name, time_s) for name in recordings for time_s in times_s]
    jobs = [
        FrameJob(in_place(name), time_s, tuple(RULES) if time_s in with_all_rules else ("paper",), settings.seed)
        for name, time_s in requests
    ]
    with Engine(folder / "runs", settings.jobs, settings.dask) as engine:
        results = engine.run(jobs)
    rows = [labelled(name, result) for (name, _), result in zip(requests, results, strict=True)]
    return {time_s: rows[i :: len(times_s)] for i, time_s in enumerate(times_s)}


main = Command("paper", PaperSettings, __doc__, _run).main
