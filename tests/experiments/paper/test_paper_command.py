"""The command of the paper: its report compared with the rows, and recorded people."""

import csv
import json

import numpy as np
import pytest
from builders.paper import execute, line_m, made_errors
from scipy.stats import wilcoxon

from experiments.paper.filters import SLOW_TIME_S, TUNED_TIME_S
from experiments.paper.findings import side_by_side
from experiments.paper.frames import RULES, FrameJob, frames_of
from experiments.paper.reproduction import analyse, main
from experiments.paper.validation import exact_weight
from gazempc.recordings.readers.tables.mapping import COLUMNS
from gazempc.recordings.synthetic.walks import generate

pytestmark = pytest.mark.usefixtures("in_this_process")

SWEPT_S = (TUNED_TIME_S, SLOW_TIME_S, 2.0)


WALKS = ("subject01_R1", "subject01_R4", "subject02_R2", "subject02_R6", "subject03_R3", "subject03_R5")


def write_walks(folder):
    """Write the first frames as CSV files; subject and group are in the index."""
    folder.mkdir()
    lines = ["clip,subject,group"]
    for name in WALKS:
        walk = generate(name)
        values = np.column_stack([walk.times_s, *vars(walk.truth).values()])[:100]
        np.savetxt(folder / f"{name}.csv", values, "%.6f", ",", header=",".join(COLUMNS), comments="")
        lines.append(f"{name},{walk.labels.subject},{walk.labels.group}")
    (folder / "index.csv").write_text("\n".join(lines))
    return folder


@pytest.fixture(scope="module")
def validated(tmp_path_factory, in_this_process):
    """Folder and output of six walks of three people, validated once with three of the filters."""
    folder = write_walks(tmp_path_factory.mktemp("paper") / "six")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("experiments.paper.filters.FILTER_TIMES_S", SWEPT_S)
        words = ["--recordings", str(folder), "--jobs", "1", "--trials", "5", "--out", str(folder / "out")]
        assert main(words) == 0
    return folder, folder / "out"


@pytest.mark.slow
def test_the_report_equals_statistics_of_the_rows(validated):
    """Means and tests recomputed from rows of jobs with the saved weights."""
    folder, out = validated
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert {"groups", "w_mean", "w_sd", "people", "filters", "nearest", "turns", "rules"} <= set(summary)
    rows = [execute(FrameJob(str(folder / f"{clip}.csv"), TUNED_TIME_S, ("paper",), 0)) for clip in WALKS]
    weights = summary["weights"]
    assert set(weights) == {r["subject"] for r in rows}
    assert summary["w_mean"] == pytest.approx(np.mean(list(weights.values())))
    assert [g["group"] for g in summary["groups"]] == ["R12", "R34", "R56"]
    people = {p["group"]: p for p in summary["people"]}
    for g in summary["groups"]:
        own = [v for v in frames_of(rows) if v.group == g["group"]]
        errors_mm = [(v.error_mm(0.0), v.error_mm(weights[v.subject])) for v in own]
        baseline, proposed = (np.concatenate(each) for each in zip(*errors_mm, strict=True))
        assert (g["n_videos"], g["n_people"], g["n_frames"]) == (2, 2, baseline.size)
        assert (g["baseline_mm"], g["proposed_mm"]) == pytest.approx((baseline.mean(), proposed.mean()))
        library = wilcoxon(baseline, proposed, alternative="greater", method="approx")
        assert (g["wilcoxon_statistic"], g["p_value"]) == pytest.approx((library.statistic, library.pvalue))
        assert g["baseline_mm_ci95"] == pytest.approx(sorted(b.mean() for b, _ in errors_mm))
        assert people[g["group"]]["difference_mm"] == pytest.approx(
            np.mean([p.mean() - b.mean() for b, p in errors_mm])
        )
    assert people["R34+R56"]["n_people"] == 3
    assert summary["w_exact_all_subjects"] == pytest.approx(exact_weight(frames_of(rows)), abs=1e-6)
    assert (out / "error_bars.png").stat().st_size > 5000
    text = (out / "summary.md").read_text(encoding="utf-8")
    assert "7.51" in text
    assert f"{summary['groups'][0]['wilcoxon_statistic']:,.0f}" in text


@pytest.mark.slow
def test_both_data_sets_are_tabulated_beside_published_values(validated):
    summary = json.loads((validated[1] / "summary.json").read_text(encoding="utf-8"))
    few = summary | {"groups": summary["groups"][:2]}
    lines = {line.split(" | ")[0].strip("| "): line for line in side_by_side({"all": summary, "few": few}).split("\n")}
    assert [c.strip() for c in lines["R34 frames"].split("|")[1:-1]][1:] == [
        "2808 (implied)",
        *[str(summary["groups"][1]["n_frames"])] * 2,
    ]
    assert "at least 1582 (implied)" in lines["R12 frames"]
    assert lines["R56 baseline [mm]"].rstrip("| ").endswith("-")
    assert "1,990,900" in lines["R56 Wilcoxon statistic"]
    assert f"| {summary['w_mean']:.2f} |" in lines["w, mean"]


@pytest.mark.slow
def test_a_standing_person_has_no_yaw_against_travel(monkeypatch):
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
    # Published values are tested separately.
    json.dumps({k: v for k, v in summary.items() if k != "published"}, allow_nan=False)


@pytest.mark.slow
def test_on_real_straight_walks_the_papers_rule_has_larger_errors_than_the_other(walks_dir):
    with (walks_dir / "index.csv").open(newline="", encoding="utf-8") as file:
        clips = {r["subject"]: r["clip"] for r in csv.DictReader(file) if r["group"] == "straight"}.values()
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
