"""Reproduce the paper's validation: `python -m experiments.paper --recordings synthetic`."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import Field

from experiments.engine.choices import find_recordings, in_place
from experiments.engine.command import Command, WorkSettings, check, exit_status
from experiments.engine.engine import Engine
from experiments.engine.job import Row
from experiments.paper.analysis import analyse
from experiments.paper.filters import FILTER_TIMES_S, SLOW_TIME_S, TUNED_TIME_S, known_groups
from experiments.paper.findings import report, side_by_side
from experiments.paper.frames import RULES, FrameJob, labelled
from experiments.paper.validation import check_optuna
from gazempc.errors import GazempcError
from gazempc.files.whole import write_whole
from gazempc.results.run_summary import versions
from gazempc.sim.scene import make_scene


class PaperSettings(WorkSettings):
    """Settings of `python -m experiments.paper`."""

    recordings: tuple[str, ...] = Field(
        default=("synthetic",),
        min_length=1,
        description="'synthetic' (14 x 6) or a folder; each word is a data set of its own",
    )
    filter_time_s: float = Field(
        default=TUNED_TIME_S, ge=0.02, le=10, description="Time constant of the Kalman filter of the validation"
    )
    trials: int = Field(default=60, ge=1, description="Optuna's trials for each subject left out")
    seed: int = Field(default=0, ge=0, description="Seed of Optuna's sampler and of the sensor's noise")
    out: Path = Field(default=Path("out/paper"), description="Where to write; an interrupted run goes on there")


def validate(**settings: Any) -> dict[str, Row]:
    """Validate each data set as the paper does, and write tables and figures.

    Args:
        **settings: Any of `PaperSettings`, such as ``recordings=["synthetic"], out="out/paper"``.

    Returns:
        The content of ``summary.json`` by the name of the data set.

    Raises:
        GazempcError: If no recording of a data set can be scored, or it has fewer than two subjects.
        MissingOptionalDependencyError: Without Optuna.
    """
    return _validate(check(PaperSettings, "paper", settings))


def _run(settings: PaperSettings, _: str) -> int:
    summaries = _validate(settings)
    print(f"Written to {settings.out}/")
    return exit_status(False, any(s["failed"] for s in summaries.values()))


def _validate(settings: PaperSettings) -> dict[str, Row]:
    check_optuna()
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
    """A short name for each data set, each its own."""
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
    groups = known_groups(first)
    if not groups:
        raise GazempcError(
            f"{word}: no recording can be scored; needed: groups straight, turn or sharp and more than half a second "
            f"within the sensor's range"
            + "".join(f"\n{source}: {why}" for source, why in {**failed, **left_out}.items())
        )
    summary = {
        "data": word,
        "kinds": sorted({r["kind"] for r in first if r["kind"]}),
        "n_recordings": len(recordings),
        "without_group": [r["source"] for r in first if not r["failed"] and r["group"] not in _LABELS],
        "left_out": left_out,
        "failed": failed,
        **analyse(rows_by_time, settings.filter_time_s, settings.seed, settings.trials),
        "settings": settings.saved(),
        "versions": versions(),
    }
    write_whole(folder / "summary.json", json.dumps(summary, indent=1) + "\n")
    text = report(summary)
    write_whole(folder / "summary.md", text)
    from experiments.paper.figures import draw_bars, draw_routes  # noqa: PLC0415  (slow to import)

    draw_bars(summary, folder / "error_bars.png")
    scored = [make_scene(r["source"]).walk for r in first if not r["failed"] and not r["left_out"]]
    if all(walk.kind == "synthetic" for walk in scored):
        draw_routes(scored, folder / "routes.png")
    print(text)
    print(f"{word}: {time.monotonic() - started:.0f} s; tables and figures in {folder}/\n")
    return summary


_LABELS = ("straight", "turn", "sharp")


def _rows(recordings: Sequence[str], folder: Path, settings: PaperSettings) -> dict[float, list[dict[str, Any]]]:
    times_s = sorted({*FILTER_TIMES_S, settings.filter_time_s})
    with_all_rules = {settings.filter_time_s, SLOW_TIME_S}
    # Recording by recording, so that a worker reads each file once.
    asked = [(name, time_s) for name in recordings for time_s in times_s]
    jobs = [
        FrameJob(in_place(name), time_s, tuple(RULES) if time_s in with_all_rules else ("paper",), settings.seed)
        for name, time_s in asked
    ]
    with Engine(folder / "runs", settings.jobs, settings.dask) as engine:
        results = engine.run(jobs)
    rows = [labelled(name, result) for (name, _), result in zip(asked, results, strict=True)]
    return {time_s: rows[i :: len(times_s)] for i, time_s in enumerate(times_s)}


main = Command("paper", PaperSettings, __doc__, _run).main
