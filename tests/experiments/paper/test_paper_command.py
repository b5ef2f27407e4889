"""The command: what it writes is what the rows say, and it goes on where it was interrupted."""

import json
import shutil

import numpy as np
import pytest
from builders.paper import PEOPLE, WALKS, execute, write_walks
from scipy.stats import wilcoxon

from experiments.paper.figures import draw_routes
from experiments.paper.filters import SLOW_TIME_S, TUNED_TIME_S
from experiments.paper.findings import side_by_side
from experiments.paper.frames import (
    FrameJob,
    frames_of,
)
from experiments.paper.reproduction import main
from experiments.paper.validation import exact_weight
from gazempc.recordings.synthetic.routes import ROUTES
from gazempc.recordings.synthetic.walks import generate

pytestmark = pytest.mark.usefixtures("in_this_process")

SWEPT_S = (TUNED_TIME_S, SLOW_TIME_S, 2.0)


def run(folder, out, drawn=False):
    """The command with three of its filters, figures only where wanted."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("experiments.paper.reproduction.FILTER_TIMES_S", SWEPT_S)
        if not drawn:
            patch.setattr("experiments.paper.figures.draw_bars", lambda *_: None)
        return main(["--recordings", str(folder), "--jobs", "1", "--trials", "5", "--out", str(out)])


def stamps(out):
    return {p.name: p.stat().st_mtime_ns for p in (out / "runs").iterdir()}


@pytest.fixture(scope="module")
def validated(tmp_path_factory, in_this_process):
    """Six walks of three people, validated once: folder, output and exit status."""
    folder = write_walks(tmp_path_factory.mktemp("paper") / "six", frame_count=100)
    out = folder.with_name("out")
    status = run(folder, out)
    return folder, out, status


@pytest.mark.slow
def test_the_command_writes_what_the_rows_say(validated):
    """Means, statistics and weights recomputed from the rows of jobs done here, w from the saved weights."""
    folder, out, status = validated
    assert status == 0
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert {"groups", "w_mean", "w_sd", "people", "hypotheses", "filters", "nearest", "turns", "rules"} <= set(summary)
    rows = [execute(FrameJob(str(folder / f"{clip}.csv"), TUNED_TIME_S, ("paper",), 0)) for clip in WALKS]
    assert {r["subject"] for r in rows} == set(PEOPLE.values())
    weights = summary["weights"]
    assert set(weights) == set(PEOPLE.values())
    assert summary["w_mean"] == pytest.approx(np.mean(list(weights.values())))
    assert summary["w_sd"] == pytest.approx(np.std(list(weights.values()), ddof=1))
    assert [g["group"] for g in summary["groups"]] == ["R12", "R34", "R56"]
    labels = {"R12": "straight", "R34": "turn", "R56": "sharp"}
    for g in summary["groups"]:
        own = [r for r in rows if r["group"] == labels[g["group"]]]
        base = [np.array(r["horizons"][0]["filtered"]) for r in own]
        turn = [np.array(r["horizons"][0]["turn"]["paper"]["turn_m"]) for r in own]
        baseline = [1e3 * np.linalg.norm(b, axis=1) for b in base]
        proposed = [
            1e3 * np.linalg.norm(b + weights[r["subject"]] * t, axis=1) for r, b, t in zip(own, base, turn, strict=True)
        ]
        assert (g["n_videos"], g["n_people"]) == (2, 2)
        assert g["n_frames"] == sum(b.size for b in baseline)
        assert g["baseline_mm"] == pytest.approx(np.concatenate(baseline).mean())
        assert g["proposed_mm"] == pytest.approx(np.concatenate(proposed).mean())
        library = wilcoxon(np.concatenate(baseline), np.concatenate(proposed), alternative="greater", method="approx")
        assert g["wilcoxon_statistic"] == pytest.approx(library.statistic)
        assert g["p_value"] == pytest.approx(library.pvalue)
        assert g["baseline_mm_ci95"] == pytest.approx(sorted(b.mean() for b in baseline))
        person = next(p for p in summary["people"] if p["group"] == g["group"])
        changes = [p.mean() - b.mean() for b, p in zip(baseline, proposed, strict=True)]
        assert person["difference_mm"] == pytest.approx(np.mean(changes))
        assert (person["n_people"], person["smallest_p"]) == (2, 0.25)
    pooled = next(p for p in summary["people"] if p["group"] == "R34+R56")
    assert pooled["n_people"] == 3
    turning = [v for v in frames_of(rows) if v.group != "R12"]
    means = []
    for who in weights:
        own = [v.error_mm(weights[who]) - v.error_mm(0.0) for v in turning if v.subject == who]
        means.append(np.concatenate(own).mean())
    assert pooled["difference_mm"] == pytest.approx(np.mean(means))
    assert all("undecided" in h["answer"] for h in summary["hypotheses"])
    best = exact_weight(frames_of(rows))
    assert summary["w_exact_all_subjects"] == pytest.approx(best, abs=1e-6)
    text = (out / "summary.md").read_text(encoding="utf-8")
    assert "7.51" in text
    assert f"{summary['groups'][0]['wilcoxon_statistic']:,.0f}" in text
    for answer in summary["hypotheses"]:
        assert answer["answer"] in text


@pytest.mark.slow
def test_both_data_sets_stand_beside_what_is_published(validated):
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
def test_an_interrupted_run_goes_on_and_ends_the_same(validated, tmp_path):
    folder, out, _ = validated
    for path in sorted((out / "runs").iterdir())[::3]:
        (tmp_path / "runs").mkdir(exist_ok=True)
        shutil.copy2(path, tmp_path / "runs")
    kept = stamps(tmp_path)
    assert run(folder, tmp_path, drawn=True) == 0
    after = stamps(tmp_path)
    assert {name: after[name] for name in kept} == kept
    assert after.keys() == stamps(out).keys()
    for name in after:
        assert (tmp_path / "runs" / name).read_bytes() == (out / "runs" / name).read_bytes()
    for name in ("summary.json", "summary.md"):
        assert (tmp_path / name).read_bytes() == (out / name).read_bytes()
    assert (tmp_path / "error_bars.png").stat().st_size > 5000


@pytest.mark.slow
def test_the_routes_of_synthetic_walks_are_drawn(tmp_path):
    draw_routes([generate(f"subject01_{route}") for route in ROUTES], tmp_path / "routes.png")
    assert (tmp_path / "routes.png").stat().st_size > 5000


@pytest.mark.slow
def test_a_broken_recording_is_named_and_the_rest_validated(validated, tmp_path):
    folder, out, _ = validated
    shutil.copytree(out / "runs", tmp_path / "runs")
    broken = folder / "zed_1.csv"
    broken.write_text("t,head_x\n0,1\n", encoding="utf-8")
    try:
        assert run(folder, tmp_path) == 4
    finally:
        broken.unlink()
    summary, whole = (json.loads((o / "summary.json").read_text(encoding="utf-8")) for o in (tmp_path, out))
    assert list(summary["failed"]) == [str(broken)]
    assert "missing column" in summary["failed"][str(broken)]
    assert summary["n_recordings"] == 7
    assert summary["groups"] == whole["groups"]
    assert "1 failed" in (tmp_path / "summary.md").read_text(encoding="utf-8")


def test_a_folder_that_is_not_there_is_refused(tmp_path, capsys):
    assert run(tmp_path / "nowhere", tmp_path / "out") == 2
    assert "nowhere" in capsys.readouterr().err
