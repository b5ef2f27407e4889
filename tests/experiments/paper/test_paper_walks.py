"""Recordings that are unusual but sound, and real people."""

import csv
import json

import numpy as np
import pytest
from builders.paper import (
    execute,
    line_m,
    made_errors,
    strict_json,
)

from experiments.paper.analysis import analyse
from experiments.paper.filters import SLOW_TIME_S, TUNED_TIME_S
from experiments.paper.frames import (
    RULES,
    FrameJob,
    frames_of,
)


def rows_by_time(paths):
    return {t: [execute(FrameJob(str(p), t, tuple(RULES), 0)) for p in paths] for t in (TUNED_TIME_S, SLOW_TIME_S)}


@pytest.mark.slow
def test_somebody_who_stands_does_not_spoil_the_summary(monkeypatch):
    """A standing person is `straight` and has no direction of travel, so never a yaw against it."""
    still_m = np.tile([2.0, 0.5, 0.4], (75, 1))
    walks = {"a": line_m(75), "b": line_m(75, velocity_m_s=(0.5, 0.5, 0.0)), "c": still_m}
    rows = {
        t: [
            made_errors(monkeypatch, path_m, t, tuple(RULES), head_deg=10.0 + k) | {"subject": who}
            for k, (who, path_m) in enumerate(walks.items())
        ]
        for t in (TUNED_TIME_S, SLOW_TIME_S)
    }
    summary = analyse(rows, TUNED_TIME_S, 0, 3)
    # What is published has a test of its own.
    strict_json(json.dumps({k: v for k, v in summary.items() if k != "published"}))


@pytest.mark.slow
def test_on_real_straight_walks_the_papers_rule_costs_and_the_other_one_helps(walks_dir):
    with (walks_dir / "index.csv").open(newline="", encoding="utf-8") as file:
        clips = [r["clip"] for r in csv.DictReader(file) if r["group"] == "straight"]
    jobs = [FrameJob(str(walks_dir / f"{clip}.csv"), TUNED_TIME_S, ("paper", "both"), 0) for clip in clips]
    rows = [execute(job) for job in jobs]
    change_mm = {}
    for rule in ("paper", "both"):
        videos = frames_of(rows, rule=rule)
        change_mm[rule] = {
            subject: np.concatenate([v.error_mm(0.5) - v.error_mm(0.0) for v in videos if v.subject == subject]).mean()
            for subject in {v.subject for v in videos}
        }
    paper, both = (np.array(list(change_mm[rule].values())) for rule in ("paper", "both"))
    assert paper.size == 13
    assert (paper > 0).sum() >= 10
    assert both.mean() < paper.mean() - 5
